//! For the hardware interface: `Commands` in, `JointStates` out, and the evaluation of a command at an
//! instant.

use std::sync::Arc;

use foretrace_shm::{
    ArmNote, HeaderBounds, JOINTS, JointCommand, JointState, Message, NoteWords, PublishError, Publisher,
    RejectReason, Rejection, Rejections, ServiceError, Subscriber, Validate, command_flags, monotonic_now_ns,
};

use crate::Foretrace;
use crate::attach::Leaving;

/// Commands are stamped up to one control period ahead.
const BOUNDS: HeaderBounds = HeaderBounds { future_ns: 20_000_000, age_ns: u64::MAX };

/// Between two times that a note is sent \[ns\].
const REPEAT_NS: u64 = 1_000_000_000;

/// Receives joint commands. Those of another boot, replayed, or malformed are refused and counted.
#[derive(Debug)]
pub struct Commands {
    subscriber: Subscriber<JointCommand>,
    newest: Option<JointCommand>,
    taken_ns: u64,
    _leaving: Arc<Leaving>,
}

/// Sends joint states. One per instance at a time.
#[derive(Debug)]
pub struct JointStates {
    publisher: Publisher<JointState>,
    notes: Publisher<ArmNote>,
    /// The note in force.
    note: Option<ArmNote>,
    /// When it is sent again, for a daemon that came later.
    repeat_ns: u64,
    _leaving: Arc<Leaving>,
}

/// The demand of a command at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Demand {
    /// Be at these joint positions \[rad\], moving this fast \[rad/s\].
    Follow {
        /// q + q̇·(now − stamp).
        q: [f64; JOINTS],
        /// q̇, the same until the command is over.
        qd: [f64; JOINTS],
    },
    /// The command is too old, or the arm is not enabled: brake to a stand and stay.
    Brake,
}

/// Evaluate a command at `now_ns`: q + q̇·(now − stamp) until `valid_until_ns`, then [`Demand::Brake`].
///
/// Before the stamp, that is during the period the command is for, this interpolates linearly; after it, it
/// extrapolates.
pub fn demand_at(command: &JointCommand, now_ns: u64) -> Demand {
    if now_ns >= command.valid_until_ns || command.flags & command_flags::ENABLED == 0 {
        return Demand::Brake;
    }
    let stamp_ns = command.header.stamp_ns;
    // Unsigned clocks: the difference must be taken before it becomes a float, where 1 ns would be lost after
    // 104 days.
    let elapsed_ns =
        if now_ns >= stamp_ns { (now_ns - stamp_ns) as f64 } else { -((stamp_ns - now_ns) as f64) };
    let mut q = command.q;
    q.iter_mut().zip(&command.qd).for_each(|(q, qd)| *q += qd * elapsed_ns * 1e-9);
    Demand::Follow { q, qd: command.qd }
}

impl Foretrace {
    /// The commands from now on, to be used in this thread; up to `buffer` (1 to 256) are kept unread. A
    /// controller that only needs the newest takes 1.
    ///
    /// # Errors
    ///
    /// `NoSlot` when all slots for receivers of commands are in use; `BufferSize`.
    pub fn commands(&self, buffer: usize) -> Result<Commands, ServiceError> {
        let subscriber = self.services.joint_cmd.subscriber(buffer, BOUNDS)?;
        Ok(Commands { subscriber, newest: None, taken_ns: 0, _leaving: self.leaving.clone() })
    }

    /// The joint states, to be sent from this thread.
    ///
    /// # Errors
    ///
    /// `NoSlot` when another arm reports already.
    pub fn joint_states(&self) -> Result<JointStates, ServiceError> {
        Ok(JointStates {
            publisher: self.services.joint_state.publisher()?,
            notes: self.services.arm_note.publisher()?,
            note: None,
            repeat_ns: 0,
            _leaving: self.leaving.clone(),
        })
    }
}

impl Commands {
    /// The largest buffer that can be asked for.
    pub const MAX_BUFFER: usize = JointCommand::QOS.buffer;

    /// The newest command ever received, unread or not. Does not allocate once connected.
    pub fn latest(&mut self) -> Option<&JointCommand> {
        if let Some(command) = self.subscriber.latest() {
            self.newest = Some(command);
            // After the look: a command that was sent meanwhile was not taken before.
            self.taken_ns = monotonic_now_ns();
        }
        self.newest.as_ref()
    }

    /// A joint state that echoes the newest command received: its tick, its pen sample, and when it was taken
    /// here. Fill in the rest. An arm that refuses some commands by itself echoes the newest one it obeys
    /// with [`JointState::echo`].
    pub fn echo(&self) -> JointState {
        let mut state = JointState::default();
        if let Some(command) = &self.newest {
            state.echo(command, self.taken_ns);
        }
        state
    }

    /// Every unread command, oldest first. Returns how many there were.
    pub fn drain(&mut self, mut use_command: impl FnMut(&JointCommand)) -> usize {
        let (newest, taken_ns) = (&mut self.newest, &mut self.taken_ns);
        self.subscriber.drain(|command| {
            (*newest, *taken_ns) = (Some(command), monotonic_now_ns());
            use_command(&command);
        })
    }

    /// Commands accepted so far.
    pub fn received(&self) -> u64 {
        self.subscriber.received()
    }

    /// Commands that never arrived: overwritten unread, or lost.
    pub fn dropped(&self) -> u64 {
        self.subscriber.dropped()
    }

    /// Commands refused, by reason.
    pub fn rejections(&self) -> &Rejections {
        self.subscriber.rejections()
    }

    /// Reason of the newest refusal.
    pub fn newest_refused(&self) -> Option<Rejection> {
        self.subscriber.newest_refused().map(|(rejection, _)| rejection)
    }

    /// How often another daemon took over.
    pub fn restarts(&self) -> u64 {
        self.subscriber.restarts()
    }
}

/// Why a joint state was not sent.
#[derive(Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum JointStateError {
    /// The daemon would refuse it.
    #[error("the joint state is invalid: {0}")]
    Invalid(#[from] Rejection),
    /// It could not be delivered.
    #[error("the joint state was not sent: {0}")]
    NotSent(#[from] PublishError),
}

impl JointStates {
    /// From the next joint state on, `text` is why the arm does not follow, and `to_do` what an operator can
    /// do about it; both are cut after 192 bytes and shown to every operator. Does nothing where that is
    /// the note already.
    pub fn say(&mut self, text: &str, to_do: &str) {
        let words = NoteWords::new(text, to_do);
        if self.note.as_ref().is_some_and(|note| note.words == words) {
            return;
        }
        let now_ns = monotonic_now_ns();
        // Another one than the last, also of a process that was there before.
        let drawn = (now_ns / 1000) as u32 | 1;
        let number = self.note.as_ref().map_or(drawn, |note| note.number.wrapping_add(2));
        self.note = Some(ArmNote { since_ns: now_ns, number, words, ..ArmNote::default() });
        self.repeat(now_ns);
    }

    /// Nothing keeps the arm from following any more.
    pub fn say_nothing(&mut self) {
        self.note = None;
    }

    /// Sends the note; one that gets lost is sent again with a later state.
    fn repeat(&mut self, now_ns: u64) {
        if let Some(note) = self.note {
            let _ = self.notes.publish(now_ns, note);
            self.repeat_ns = now_ns.saturating_add(REPEAT_NS);
        }
    }

    /// Report the arm's state, measured at `stamp_ns` on this host's monotonic clock; the header is filled
    /// in. What the daemon would refuse, degrees or NaN for example, is refused here. Returns whether the
    /// daemon was connected.
    ///
    /// # Errors
    ///
    /// See [`JointStateError`]; nothing is sent then.
    pub fn publish(&mut self, stamp_ns: u64, mut state: JointState) -> Result<bool, JointStateError> {
        state.validate()?;
        let now_ns = monotonic_now_ns();
        state.note = self.note.as_ref().map_or(0, |note| note.number);
        if now_ns >= self.repeat_ns {
            self.repeat(now_ns);
        }
        let ahead_ns = stamp_ns.saturating_sub(now_ns);
        if ahead_ns > HeaderBounds::DEFAULT.future_ns {
            let [ahead_s, bound_s] = [ahead_ns, HeaderBounds::DEFAULT.future_ns].map(|ns| ns as f64 * 1e-9);
            let future = Rejection::new(RejectReason::FromTheFuture, "stamp_ns");
            return Err(future.because(ahead_s, bound_s).into());
        }
        Ok(self.publisher.publish(stamp_ns, state)? > 0)
    }
}

#[cfg(test)]
mod tests {
    use foretrace_shm::Header;

    use super::*;

    fn command() -> JointCommand {
        JointCommand {
            header: Header { stamp_ns: 10_000_000_000, ..Default::default() },
            valid_until_ns: 10_010_000_000,
            q: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            qd: [0.5; JOINTS],
            flags: command_flags::ENABLED,
            ..Default::default()
        }
    }

    fn first_joint(now_ns: u64) -> f64 {
        match demand_at(&command(), now_ns) {
            Demand::Follow { q, .. } => q[0],
            Demand::Brake => panic!("brakes"),
        }
    }

    #[test]
    fn a_command_is_interpolated_before_its_stamp_and_extrapolated_after() {
        assert_eq!(first_joint(10_000_000_000), 1.0);
        assert!((first_joint(9_998_000_000) - 0.999).abs() < 1e-15);
        assert!((first_joint(10_004_000_000) - 1.002).abs() < 1e-15);
    }

    #[test]
    fn an_old_or_disabled_command_brakes() {
        assert_eq!(demand_at(&command(), 10_010_000_000), Demand::Brake);
        assert_eq!(demand_at(&JointCommand { flags: 0, ..command() }, 10_000_000_000), Demand::Brake);
    }
}
