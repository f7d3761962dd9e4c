//! The tick's interface to the outside: what arrived, what is sent, and what was dropped or refused.
//!
//! Contract: a [`Ports`] copies each message once, validates the copy, counts every refusal by reason and
//! passes on domain types only. Neither call blocks; neither allocates while the set of connected peers stays
//! the same.

pub mod shm;

use foretrace_control::contact::EffortReading;
use foretrace_control::follower::{EnableReading, JointReading};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::ExternalPreview;
use foretrace_control::units::Stamp;

use foretrace_shm::PenStep;

use crate::wire::{ArmLine, Echo, JOINTS, Outgoing, REJECT_REASONS, Refused};

/// Most pen samples per tick; the rest waits for the next tick.
pub const PEN_PER_TICK: usize = 64;

/// What arrived since the last tick.
#[derive(Debug, Clone, Copy)]
pub struct Inbox {
    pen: [PenReading; PEN_PER_TICK],
    pen_count: usize,
    pub joints: Option<JointReading<JOINTS>>,
    /// Efforts of that joint state, where the arm reports any.
    pub effort: Option<EffortReading<JOINTS>>,
    /// The echo in that joint state, if any.
    pub echo: Option<Echo>,
    pub enable: Option<EnableReading>,
    /// Whether previews of another process are asked for; set by the tick.
    pub asks_previews: bool,
    /// The newest preview of another process.
    pub preview: Option<ExternalPreview>,
}

impl Inbox {
    #[must_use]
    pub const fn empty() -> Self {
        let nothing = PenReading::new(Stamp(0), [0.0; 2], false);
        Self {
            pen: [nothing; PEN_PER_TICK],
            pen_count: 0,
            joints: None,
            effort: None,
            echo: None,
            enable: None,
            asks_previews: false,
            preview: None,
        }
    }

    pub const fn clear(&mut self) {
        self.pen_count = 0;
        self.joints = None;
        self.effort = None;
        self.echo = None;
        self.enable = None;
        self.preview = None;
    }

    /// Adds a pen sample; `false` when there is no room for it.
    pub fn push_pen(&mut self, reading: PenReading) -> bool {
        let Some(slot) = self.pen.get_mut(self.pen_count) else { return false };
        *slot = reading;
        self.pen_count += 1;
        true
    }

    /// Whether another pen sample fits.
    #[must_use]
    pub const fn has_room(&self) -> bool {
        self.pen_count < PEN_PER_TICK
    }

    /// Pen samples, in order of arrival.
    #[must_use]
    pub fn pen(&self) -> &[PenReading] {
        self.pen.get(..self.pen_count).unwrap_or_default()
    }
}

/// Counts since the start.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PortTally {
    /// Pen samples handed to the loop.
    pub pen_received: u64,
    /// Pen samples missing in the sender's sequence.
    pub pen_dropped: u64,
    /// Ticks that left pen samples for the next one.
    pub pen_deferred: u64,
    /// Pen samples refused, by reason.
    pub pen_rejected: [u64; REJECT_REASONS],
    pub joints_received: u64,
    /// Joint states missing in the sender's sequence.
    pub joints_dropped: u64,
    /// Joint states refused, by reason.
    pub joints_rejected: [u64; REJECT_REASONS],
    pub enable_rejected: u64,
    /// Previews of another process whose message was refused.
    pub previews_rejected: u64,
    /// Previews of another process that a newer one of the same tick replaced, or that are missing in its
    /// sequence.
    pub previews_lost: u64,
    /// Dead-man messages missing in the sender's sequence.
    pub enable_dropped: u64,
    /// The newest refused pen sample.
    pub pen_refused: Option<Refused>,
    /// The newest refused joint state.
    pub joints_refused: Option<Refused>,
    /// The newest refused dead-man message.
    pub enable_refused: Option<Refused>,
    /// Errors of the middleware while receiving.
    pub receive_failures: u64,
    /// The arm's line, as in the newest joint state.
    pub arm_line: ArmLine,
    /// Number of the note of the arm's process that its newest joint state names; 0: none.
    pub arm_note: u32,
    pub commands_sent: u64,
    /// Commands that could not be sent.
    pub commands_failed: u64,
    /// Grid steps that could not be sent.
    pub steps_failed: u64,
}

/// Input and output of one tick.
pub trait Ports {
    /// Replaces the contents of `inbox` by what has arrived; pen samples count as received at `now`.
    fn receive(&mut self, now: Stamp, inbox: &mut Inbox);

    /// Sends a command; `false` if it was not sent.
    fn send(&mut self, now: Stamp, outgoing: &Outgoing) -> bool;

    /// Sends a closed grid step to whoever predicts in another process.
    fn send_step(&mut self, now: Stamp, step: PenStep);

    /// The counts so far.
    fn tally(&self) -> &PortTally;
}
