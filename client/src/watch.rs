//! For observers: `Telemetry` (every tick), `StatusReader` (ten times per second), `PenWatch` (every pen
//! sample), `JointWatch` (every joint state), `InputWatch` (what a replay needs).

use std::sync::Arc;
use std::time::{Duration, Instant};

use foretrace_shm::{
    Assembly, HeaderBounds, JointState, Message, PenSample, Piece, Rejections, ServiceError, Status,
    Subscriber, Thing, TickInput, TickRecord, Topic, monotonic_now_ns,
};

use crate::Foretrace;
use crate::attach::Leaving;

/// Receives every message of a kind, in order. What comes faster than it is read is lost, and counted.
#[derive(Debug)]
pub struct MessageWatch<T: Message> {
    subscriber: Subscriber<T>,
    _leaving: Arc<Leaving>,
}

/// Receives the records of ticks. Those that the daemon itself had to drop are counted in
/// `TickRecord::counters.telemetry_ring_dropped`.
pub type Telemetry = MessageWatch<TickRecord>;

/// Receives the pen samples that the daemon receives too.
pub type PenWatch = MessageWatch<PenSample>;

/// Receives the joint states that the daemon receives too.
pub type JointWatch = MessageWatch<JointState>;

/// Receives the daemon's status.
#[derive(Debug)]
pub struct StatusReader {
    subscriber: Subscriber<Status>,
    newest: Option<Status>,
    _leaving: Arc<Leaving>,
}

/// Receives what every tick was given, and the settings, weights and states that a replay begins with.
#[derive(Debug)]
pub struct InputWatch {
    inputs: MessageWatch<TickInput>,
    /// None while there is no slot.
    pieces: Option<MessageWatch<Piece>>,
    assembly: Assembly,
}

impl Foretrace {
    pub(crate) fn watch<T: Message>(&self, topic: &Topic<T>) -> Result<MessageWatch<T>, ServiceError> {
        let subscriber = topic.subscriber(T::QOS.buffer, HeaderBounds::DEFAULT)?;
        Ok(MessageWatch { subscriber, _leaving: self.leaving.clone() })
    }

    /// The inputs of all ticks from now on, to be used in this thread: look every few milliseconds. The
    /// daemon sends the settings in force, the newest weights and a state of the law to every new watch.
    ///
    /// # Errors
    ///
    /// `NoSlot` when two others record already.
    pub fn inputs(&self) -> Result<InputWatch, ServiceError> {
        Ok(InputWatch {
            inputs: self.watch(&self.services.inputs)?,
            pieces: Some(self.watch(&self.services.pieces)?),
            assembly: Assembly::default(),
        })
    }

    /// The joint states from now on, to be used in this thread. 256 are kept unread: at 500 Hz, drain at
    /// least twice per second.
    ///
    /// # Errors
    ///
    /// `NoSlot` when three others watch the arm already.
    pub fn joint_watch(&self) -> Result<JointWatch, ServiceError> {
        self.watch(&self.services.joint_state)
    }

    /// The pen samples from now on, to be used in this thread. 256 are kept unread: at 200 Hz, drain at least
    /// once per second.
    ///
    /// # Errors
    ///
    /// `NoSlot` when three others watch the pen already.
    pub fn pen_watch(&self) -> Result<PenWatch, ServiceError> {
        self.watch(&self.services.pen)
    }

    /// The tick records from now on, to be used in this thread. 256 are kept unread: at 500 Hz, drain at
    /// least twice per second.
    ///
    /// # Errors
    ///
    /// `NoSlot` when three others observe already.
    pub fn telemetry(&self) -> Result<Telemetry, ServiceError> {
        self.watch(&self.services.telemetry)
    }

    /// The status, to be used in this thread.
    ///
    /// # Errors
    ///
    /// `NoSlot` when all slots for readers of the status are in use.
    pub fn status(&self) -> Result<StatusReader, ServiceError> {
        let MessageWatch { subscriber, _leaving } = self.watch(&self.services.status)?;
        Ok(StatusReader { subscriber, newest: None, _leaving })
    }
}

impl InputWatch {
    /// Every unread input, oldest first. Returns how many there were.
    pub fn drain(&mut self, use_input: impl FnMut(&TickInput)) -> usize {
        self.inputs.drain(use_input)
    }

    /// Every snapshot that has arrived whole: settings, weights, a state.
    pub fn snapshots(&mut self, mut use_snapshot: impl FnMut(Thing)) {
        let assembly = &mut self.assembly;
        let Some(pieces) = &mut self.pieces else { return };
        pieces.drain(|piece| {
            if let Some(snapshot) = assembly.add(piece) {
                use_snapshot(snapshot);
            }
        });
    }

    /// Asks for settings, weights and a state once more; inputs go on without a gap. Take what has arrived by
    /// [`Self::snapshots`] before.
    ///
    /// # Errors
    ///
    /// `NoSlot` when another has taken the slot meanwhile: inputs arrive, snapshots do not until this
    /// succeeds.
    pub fn start_again(&mut self, foretrace: &Foretrace) -> Result<(), ServiceError> {
        // The own slot first: there may be no other.
        self.pieces = None;
        self.pieces = Some(foretrace.watch(&foretrace.services.pieces)?);
        self.assembly.restart();
        Ok(())
    }

    /// Inputs lost so far between the daemon's publisher and here.
    pub fn lost(&self) -> u64 {
        self.inputs.lost()
    }

    /// Snapshots of which a part was lost.
    pub fn snapshots_broken(&self) -> u64 {
        self.assembly.broken()
    }

    /// Inputs refused, by reason.
    pub fn rejections(&self) -> &Rejections {
        self.inputs.rejections()
    }
}

impl<T: Message> MessageWatch<T> {
    /// Every unread message, oldest first. Returns how many there were.
    pub fn drain(&mut self, mut use_message: impl FnMut(&T)) -> usize {
        self.subscriber.drain(|message| use_message(&message))
    }

    /// Waits for the next unread message, looking five times per millisecond; `None` when none came in time.
    pub fn next_within(&mut self, timeout: Duration) -> Option<T> {
        // None: for ever.
        let deadline = Instant::now().checked_add(timeout);
        loop {
            // A message that is refused is counted, and the next one looked at.
            while let Some(message) = self.subscriber.take() {
                if let Ok(message) = message {
                    return Some(message);
                }
            }
            if deadline.is_some_and(|deadline| Instant::now() >= deadline) {
                return None;
            }
            std::thread::sleep(Duration::from_micros(200));
        }
    }

    /// Messages lost so far between their publisher and here.
    pub fn lost(&self) -> u64 {
        self.subscriber.dropped()
    }

    /// Messages refused, by reason.
    pub fn rejections(&self) -> &Rejections {
        self.subscriber.rejections()
    }

    /// How often another publisher took over.
    pub fn restarts(&self) -> u64 {
        self.subscriber.restarts()
    }
}

impl StatusReader {
    /// The newest status, if one came since the last call.
    pub fn newest_if_new(&mut self) -> Option<Status> {
        let new = self.subscriber.latest();
        self.newest = new.or(self.newest);
        new
    }

    /// The newest status received, unread or not.
    pub fn latest(&mut self) -> Option<&Status> {
        self.newest_if_new();
        self.newest.as_ref()
    }

    /// Wait for the next unread status; `None` when none came in time.
    pub fn next_within(&mut self, timeout: Duration) -> Option<Status> {
        let deadline = Instant::now() + timeout;
        loop {
            let status = self.newest_if_new();
            if status.is_some() || Instant::now() >= deadline {
                return status;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Age of the newest status; more than a second means that the daemon is gone or stuck.
    pub fn age(&self) -> Option<Duration> {
        self.newest.map(|status| Duration::from_nanos(status.header.age_ns(monotonic_now_ns())))
    }
}
