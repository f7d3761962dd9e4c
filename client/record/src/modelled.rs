//! The arm of a recording: a delay and a servo, as they were fitted, behind the commands of a law.

use foretrace_control::follower::JointCommand;
use foretrace_control::units::Stamp;
use foretrace_sim::arm::{ArmModel, ArmSettings, DelaySettings, JOINTS, Joints};
use foretrace_sim::lag::Servo;

/// A command as the arm takes it.
pub(crate) type RecordedCommand = JointCommand<JOINTS>;

/// The arm behind its commands: follows the newest until it is no longer valid, also over skipped periods.
pub(crate) struct ModelledArm {
    model: ArmModel,
    period_ns: u64,
    at: Stamp,
    /// The newest that it has got.
    pub(crate) command: Option<RecordedCommand>,
    pub(crate) joints: Joints,
}

/// Periods that an arm is moved at a time at most; a longer gap ends a stretch anyway.
const MOST_PERIODS: u64 = 500;

impl ModelledArm {
    /// At rest at `start` \[rad\], as `arm` was fitted.
    pub(crate) fn new(arm: &Servo, period_ns: u64, start: [f64; JOINTS], at: Stamp) -> Self {
        let period_s = period_ns as f64 * 1e-9;
        let settings = ArmSettings {
            cycle_s: period_s,
            // A cycle of delay is part of every simulated arm.
            delay: DelaySettings::constant((arm.delay_s - period_s).max(0.0)),
            look_ahead_s: arm.filter_s.max(0.0),
            joint_loop_s: arm.joint_loop_s.max(0.0),
            ..ArmSettings::delayed(period_s, period_s)
        };
        let joints = Joints { q: start, qd: [0.0; JOINTS] };
        Self { model: ArmModel::at_rest(settings, start), period_ns, at, command: None, joints }
    }

    /// Moves on to `now`.
    pub(crate) fn move_to(&mut self, now: Stamp) {
        let passed = u64::try_from(now.since(self.at)).unwrap_or(0) + self.period_ns / 2;
        for _ in 0..(passed / self.period_ns.max(1)).min(MOST_PERIODS) {
            let target = self.command.map_or(self.joints.q, |command| {
                let at = if self.at > command.valid_until { command.valid_until } else { self.at };
                let after_s = at.since(command.stamp) as f64 * 1e-9;
                std::array::from_fn(|joint| {
                    let (q, qd) = (command.q.get(joint), command.qd.get(joint));
                    q.copied().unwrap_or(0.0) + qd.copied().unwrap_or(0.0) * after_s
                })
            });
            self.joints = self.model.cycle(target);
            self.at = self.at + self.period_ns;
        }
        self.at = now;
    }
}
