//! Ports inside one process: the same tick without shared memory.
//!
//! Contract: as [`Ports`]; two wait-free rings per direction, everything allocated at construction. A full
//! ring drops the newest message and counts it.

use rtrb::{Consumer, Producer, RingBuffer};

use foretrace_control::follower::{EnableReading, JointReading};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::ExternalPreview;
use foretrace_control::units::Stamp;
use foretrace_shm::PenStep;

use crate::ports::{Inbox, PortTally, Ports};
use crate::wire::{JOINTS, Outgoing};

/// Messages that wait in each direction.
const CAPACITY: usize = 256;

/// The loop's end.
#[derive(Debug)]
pub(super) struct MemoryPorts {
    pen: Consumer<PenReading>,
    joints: Consumer<JointReading<JOINTS>>,
    enable: Consumer<EnableReading>,
    previews: Consumer<ExternalPreview>,
    commands: Producer<Outgoing>,
    steps: Producer<PenStep>,
    tally: PortTally,
}

/// The outside end.
#[derive(Debug)]
pub(super) struct MemoryPeer {
    /// Pen samples to the loop.
    pub(super) pen: Producer<PenReading>,
    /// Joint states to the loop.
    pub(super) joints: Producer<JointReading<JOINTS>>,
    /// Dead-man messages to the loop.
    pub(super) enable: Producer<EnableReading>,
    /// Previews of another process to the loop.
    pub(super) previews: Producer<ExternalPreview>,
    /// Commands from the loop.
    pub(super) commands: Consumer<Outgoing>,
    /// Closed grid steps from the loop.
    pub(super) steps: Consumer<PenStep>,
}

/// Both ends.
#[must_use]
pub(super) fn pair() -> (MemoryPorts, MemoryPeer) {
    let (pen_in, pen) = RingBuffer::new(CAPACITY);
    let (joints_in, joints) = RingBuffer::new(CAPACITY);
    let (enable_in, enable) = RingBuffer::new(CAPACITY);
    let (commands, commands_out) = RingBuffer::new(CAPACITY);
    let (previews_in, previews) = RingBuffer::new(CAPACITY);
    let (steps, steps_out) = RingBuffer::new(CAPACITY);
    let ports = MemoryPorts { pen, joints, enable, previews, commands, steps, tally: PortTally::default() };
    let peer = MemoryPeer {
        pen: pen_in,
        joints: joints_in,
        enable: enable_in,
        previews: previews_in,
        commands: commands_out,
        steps: steps_out,
    };
    (ports, peer)
}

impl Ports for MemoryPorts {
    fn receive(&mut self, _now: Stamp, inbox: &mut Inbox) {
        inbox.clear();
        while inbox.has_room()
            && let Ok(reading) = self.pen.pop()
        {
            inbox.push_pen(reading);
            self.tally.pen_received += 1;
        }
        self.tally.pen_deferred += u64::from(!self.pen.is_empty());
        // Bounded, so that a flood cannot hold up the tick.
        for reading in std::iter::from_fn(|| self.joints.pop().ok()).take(CAPACITY) {
            inbox.joints = Some(reading);
            self.tally.joints_received += 1;
        }
        for reading in std::iter::from_fn(|| self.enable.pop().ok()).take(CAPACITY) {
            inbox.enable = Some(reading);
        }
        if inbox.asks_previews {
            inbox.preview = std::iter::from_fn(|| self.previews.pop().ok()).take(CAPACITY).last();
        }
    }

    fn send(&mut self, _now: Stamp, outgoing: &Outgoing) -> bool {
        let sent = self.commands.push(*outgoing).is_ok();
        *(if sent { &mut self.tally.commands_sent } else { &mut self.tally.commands_failed }) += 1;
        sent
    }

    fn send_step(&mut self, _now: Stamp, step: PenStep) {
        self.tally.steps_failed += u64::from(self.steps.push(step).is_err());
    }

    fn tally(&self) -> &PortTally {
        &self.tally
    }
}
