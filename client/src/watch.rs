//! For observers: `Telemetry` (every tick), `StatusReader` (ten times per second), `PenWatch` (every pen
//! sample), `JointWatch` (every joint state).

use std::sync::Arc;
use std::time::{Duration, Instant};

use foretrace_shm::{
    Assembly, HeaderBounds, JointState, Message, PenSample, Piece, Rejections, ServiceError, Status,
    Subscriber, Thing, TickInput, TickRecord, monotonic_now_ns,
};

use crate::Foretrace;
use crate::attach::Leaving;

/// Receives the records of ticks.
#[derive(Debug)]
pub struct Telemetry {
    subscriber: Subscriber<TickRecord>,
    _leaving: Arc<Leaving>,
}

/// Receives the daemon's status.
#[derive(Debug)]
pub struct StatusReader {
    subscriber: Subscriber<Status>,
    newest: Option<Status>,
    _leaving: Arc<Leaving>,
}

/// Receives the pen samples that the daemon receives too.
#[derive(Debug)]
pub struct PenWatch {
    subscriber: Subscriber<PenSample>,
    _leaving: Arc<Leaving>,
}

/// Receives the joint states that the daemon receives too.
#[derive(Debug)]
pub struct JointWatch {
    subscriber: Subscriber<JointState>,
    _leaving: Arc<Leaving>,
}

/// Receives what every tick was given, and the settings, weights and states that a replay begins with.
#[derive(Debug)]
pub struct InputWatch {
    inputs: Subscriber<TickInput>,
    /// None while there is no place.
    pieces: Option<Subscriber<Piece>>,
    assembly: Assembly,
    _leaving: Arc<Leaving>,
}

impl Foretrace {
    /// The inputs of all ticks from now on, to be used in this thread: look every few milliseconds. The
    /// daemon sends the settings in force, the newest weights and a state of the law to whoever begins to
    /// listen.
    ///
    /// # Errors
    ///
    /// `NoPlace` when two others record already.
    pub fn inputs(&self) -> Result<InputWatch, ServiceError> {
        Ok(InputWatch {
            inputs: self.services.inputs.subscriber(TickInput::QOS.buffer, HeaderBounds::DEFAULT)?,
            pieces: Some(self.services.pieces.subscriber(Piece::QOS.buffer, HeaderBounds::DEFAULT)?),
            assembly: Assembly::default(),
            _leaving: self.leaving.clone(),
        })
    }

    /// The joint states from now on, to be used in this thread. 256 are kept unread: at 500 Hz, drain at
    /// least twice per second.
    ///
    /// # Errors
    ///
    /// `NoPlace` when three others watch the arm already.
    pub fn joint_watch(&self) -> Result<JointWatch, ServiceError> {
        let buffer = JointState::QOS.buffer;
        Ok(JointWatch {
            subscriber: self.services.joint_state.subscriber(buffer, HeaderBounds::DEFAULT)?,
            _leaving: self.leaving.clone(),
        })
    }

    /// The pen samples from now on, to be used in this thread. 256 are kept unread: at 200 Hz, drain at least
    /// once per second.
    ///
    /// # Errors
    ///
    /// `NoPlace` when three others watch the pen already.
    pub fn pen_watch(&self) -> Result<PenWatch, ServiceError> {
        let buffer = PenSample::QOS.buffer;
        Ok(PenWatch {
            subscriber: self.services.pen.subscriber(buffer, HeaderBounds::DEFAULT)?,
            _leaving: self.leaving.clone(),
        })
    }

    /// The tick records from now on, to be used in this thread. 256 are kept unread: at 500 Hz, drain at
    /// least twice per second.
    ///
    /// # Errors
    ///
    /// `NoPlace` when three others observe already.
    pub fn telemetry(&self) -> Result<Telemetry, ServiceError> {
        let buffer = TickRecord::QOS.buffer;
        Ok(Telemetry {
            subscriber: self.services.telemetry.subscriber(buffer, HeaderBounds::DEFAULT)?,
            _leaving: self.leaving.clone(),
        })
    }

    /// The status, to be used in this thread.
    ///
    /// # Errors
    ///
    /// `NoPlace`.
    pub fn status(&self) -> Result<StatusReader, ServiceError> {
        let buffer = Status::QOS.buffer;
        Ok(StatusReader {
            subscriber: self.services.status.subscriber(buffer, HeaderBounds::DEFAULT)?,
            newest: None,
            _leaving: self.leaving.clone(),
        })
    }
}

impl InputWatch {
    /// Every unread input, oldest first. Returns how many there were.
    pub fn drain(&mut self, mut use_input: impl FnMut(&TickInput)) -> usize {
        self.inputs.drain(monotonic_now_ns(), |input| use_input(&input))
    }

    /// Every thing that is complete.
    pub fn things(&mut self, mut use_thing: impl FnMut(Thing)) {
        let assembly = &mut self.assembly;
        let Some(pieces) = &mut self.pieces else { return };
        pieces.drain(monotonic_now_ns(), |piece| {
            if let Some(thing) = assembly.add(&piece) {
                use_thing(thing);
            }
        });
    }

    /// Asks for settings, weights and a state once more; inputs go on without a gap. Take what has come by
    /// [`Self::things`] before.
    ///
    /// # Errors
    ///
    /// `NoPlace` when another has taken the place meanwhile: inputs come, things do not until this succeeds.
    pub fn start_again(&mut self, foretrace: &Foretrace) -> Result<(), ServiceError> {
        // The own place first: there may be no other.
        self.pieces = None;
        let pieces = foretrace.services.pieces.subscriber(Piece::QOS.buffer, HeaderBounds::DEFAULT)?;
        self.pieces = Some(pieces);
        self.assembly.listen_anew();
        Ok(())
    }

    /// Inputs lost so far between the daemon's publisher and here.
    pub fn lost(&self) -> u64 {
        self.inputs.dropped()
    }

    /// Things of which a piece was lost.
    pub fn things_broken(&self) -> u64 {
        self.assembly.broken()
    }

    /// Inputs refused, by reason.
    pub fn rejections(&self) -> &Rejections {
        self.inputs.rejections()
    }
}

impl Telemetry {
    /// Every unread record, oldest first. Returns how many there were.
    pub fn drain(&mut self, mut use_record: impl FnMut(&TickRecord)) -> usize {
        self.subscriber.drain(monotonic_now_ns(), |record| use_record(&record))
    }

    /// Records lost so far between the daemon's publisher and here. Records the daemon itself had to drop are
    /// counted in `TickRecord::counters.telemetry_ring_dropped`.
    pub fn lost(&self) -> u64 {
        self.subscriber.dropped()
    }

    /// Records refused, by reason.
    pub fn rejections(&self) -> &Rejections {
        self.subscriber.rejections()
    }

    /// How often another daemon took over.
    pub fn restarts(&self) -> u64 {
        self.subscriber.restarts()
    }
}

impl PenWatch {
    /// Every unread sample, oldest first. Returns how many there were.
    pub fn drain(&mut self, mut use_sample: impl FnMut(&PenSample)) -> usize {
        self.subscriber.drain(monotonic_now_ns(), |sample| use_sample(&sample))
    }

    /// Samples lost so far between the pen's publisher and here.
    pub fn lost(&self) -> u64 {
        self.subscriber.dropped()
    }

    /// Samples refused, by reason.
    pub fn rejections(&self) -> &Rejections {
        self.subscriber.rejections()
    }
}

impl JointWatch {
    /// Every unread state, oldest first. Returns how many there were.
    pub fn drain(&mut self, mut use_state: impl FnMut(&JointState)) -> usize {
        self.subscriber.drain(monotonic_now_ns(), |state| use_state(&state))
    }

    /// States lost so far between the arm's publisher and here.
    pub fn lost(&self) -> u64 {
        self.subscriber.dropped()
    }

    /// States refused, by reason.
    pub fn rejections(&self) -> &Rejections {
        self.subscriber.rejections()
    }
}

impl StatusReader {
    /// The newest status, if one came since the last call.
    pub fn newest_if_new(&mut self) -> Option<Status> {
        let new = self.subscriber.latest(monotonic_now_ns());
        self.newest = new.or(self.newest);
        new
    }

    /// The newest status received, unread or not.
    pub fn latest(&mut self) -> Option<&Status> {
        if let Some(status) = self.subscriber.latest(monotonic_now_ns()) {
            self.newest = Some(status);
        }
        self.newest.as_ref()
    }

    /// Wait for the next unread status; `None` when none came in time.
    pub fn next_within(&mut self, timeout: Duration) -> Option<Status> {
        let deadline = Instant::now() + timeout;
        loop {
            if let Some(status) = self.subscriber.latest(monotonic_now_ns()) {
                self.newest = Some(status);
                return Some(status);
            }
            if Instant::now() >= deadline {
                return None;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Age of the newest status; more than a second means that the daemon is gone or stuck.
    pub fn age(&self) -> Option<Duration> {
        self.newest.map(|status| Duration::from_nanos(status.header.age_ns(monotonic_now_ns())))
    }
}
