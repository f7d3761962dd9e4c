//! Every command that an arm receives, judged against the limits of the settings.

use foretrace_client::{JOINTS, JointCommand, command_flags};
use foretrace_control::arm::JointLimits;
use foretrace_control::guard::{CommandChecker, CommandStatistics};
use foretrace_control::units::Stamp;

/// Judges every command against the limits, refused or not.
#[derive(Debug)]
pub(super) struct Judge {
    checker: CommandChecker<JOINTS>,
    dropped: u64,
    restarts: u64,
}

impl Judge {
    pub(super) fn new(limits: JointLimits<JOINTS>) -> Self {
        Self { checker: CommandChecker::new(limits), dropped: 0, restarts: 0 }
    }

    /// Two commands can only be compared when nothing lies between them.
    pub(super) fn gaps(&mut self, dropped: u64, restarts: u64) {
        if (dropped, restarts) != (self.dropped, self.restarts) {
            (self.dropped, self.restarts) = (dropped, restarts);
            self.checker.restart();
        }
    }

    pub(super) fn see(&mut self, command: &JointCommand) {
        if command.flags & command_flags::BEGINS != 0 {
            self.checker.restart();
        }
        let (stamp, valid_until) = (Stamp(command.header.stamp_ns), Stamp(command.valid_until_ns));
        self.checker.observe(stamp, valid_until, &command.q, &command.qd);
    }

    /// What was seen so far.
    pub(super) const fn statistics(&self) -> &CommandStatistics {
        self.checker.statistics()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(stamp_ns: u64, q: f64, flags: u32) -> JointCommand {
        let mut command = JointCommand {
            valid_until_ns: stamp_ns + 10_000_000,
            q: [q; JOINTS],
            flags,
            ..JointCommand::default()
        };
        command.header.stamp_ns = stamp_ns;
        command
    }

    #[test]
    fn a_jump_is_a_violation_unless_something_lies_between() {
        let limits = JointLimits::new([[-6.0, 6.0]; JOINTS], [3.0; JOINTS], [20.0; JOINTS]).unwrap();
        let mut judge = Judge::new(limits);
        judge.see(&command(2_000_000, 0.0, 0));
        judge.see(&command(4_000_000, 0.5, 0));
        assert_eq!(judge.statistics().limit_violations, 1);
        judge.see(&command(6_000_000, 1.0, command_flags::BEGINS));
        judge.gaps(3, 0);
        judge.see(&command(14_000_000, 1.5, 0));
        assert_eq!((judge.statistics().limit_violations, judge.statistics().count), (1, 4));
    }
}
