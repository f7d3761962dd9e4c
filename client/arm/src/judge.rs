//! Every command that an arm receives, judged against the limits of the settings.

use foretrace_client::wire::command_flags;
use foretrace_client::{JOINTS, JointCommand};
use foretrace_control::arm::JointLimits;
use foretrace_control::guard::{CommandChecker, CommandStatistics};
use foretrace_control::units::Stamp;

/// Judges every command against the limits, refused or not.
#[derive(Debug)]
pub(crate) struct Judge {
    checker: CommandChecker<JOINTS>,
    /// Of the newest command, in its sender's sequence.
    sequence: u64,
}

impl Judge {
    pub(crate) fn new(limits: JointLimits<JOINTS>) -> Self {
        Self { checker: CommandChecker::new(limits), sequence: 0 }
    }

    pub(crate) fn see(&mut self, command: &JointCommand) {
        let header = &command.header;
        // Two commands can only be compared when nothing lies between them.
        let follows = header.sequence == self.sequence.wrapping_add(1);
        if !follows || command.flags & command_flags::BEGINS != 0 {
            self.checker.restart();
        }
        self.sequence = header.sequence;
        let (stamp, valid_until) = (Stamp(header.stamp_ns), Stamp(command.valid_until_ns));
        self.checker.observe(stamp, valid_until, &command.q, &command.qd);
    }

    /// What was seen so far.
    pub(crate) const fn statistics(&self) -> &CommandStatistics {
        self.checker.statistics()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(sequence: u64, q: f64, flags: u32) -> JointCommand {
        let stamp_ns = 2_000_000 * sequence;
        let mut command = JointCommand {
            valid_until_ns: stamp_ns + 10_000_000,
            q: [q; JOINTS],
            flags,
            ..JointCommand::default()
        };
        (command.header.stamp_ns, command.header.sequence) = (stamp_ns, sequence);
        command
    }

    #[test]
    fn a_jump_is_a_violation_unless_something_lies_between() {
        let limits = JointLimits::new([[-6.0, 6.0]; JOINTS], [3.0; JOINTS], [20.0; JOINTS]).unwrap();
        let mut judge = Judge::new(limits);
        judge.see(&command(1, 0.0, 0));
        judge.see(&command(2, 0.5, 0));
        assert_eq!(judge.statistics().limit_violations, 1);
        judge.see(&command(3, 1.0, command_flags::BEGINS));
        judge.see(&command(7, 1.5, 0));
        assert_eq!((judge.statistics().limit_violations, judge.statistics().count), (1, 4));
    }
}
