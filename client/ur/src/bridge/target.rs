//! From the newest joint command to the target of one controller cycle.
//!
//! Contract: pure; time is an argument. A command is followed until its validity ends, then every joint
//! brakes as the daemon expects of a consumer (`guard::consumer_state`), so that after a stall both continue
//! from the same place. A command that asks for more than the arm could do between two targets is refused.

use foretrace_client::wire::command_flags;
use foretrace_client::{Demand, JOINTS, JointCommand, demand_at};
use foretrace_control::arm::JointLimits;
use foretrace_control::arm::limits::JointMotion;
use foretrace_control::guard::{Commanded, consumer_state};
use foretrace_control::units::Stamp;

use super::program::reach;

/// Turns commands into targets.
#[derive(Debug, Clone)]
pub struct TargetTracker {
    limits: JointLimits<JOINTS>,
    cycle_s: f64,
    newest: Option<JointCommand>,
    /// The target before, and the instant that it was for \[ns\].
    last: Option<(u64, JointMotion<JOINTS>)>,
}

/// What the arm is to do in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Target {
    /// There was no command yet.
    None,
    /// Be at these joints \[rad\], moving this fast \[rad/s\]; the command is enabled and valid.
    Follow(JointMotion<JOINTS>),
    /// The same, on the way to a stand or at rest: no valid command asks for motion.
    Brake(JointMotion<JOINTS>),
    /// Joint `joint` is `away` \[rad\] from where the target before leads, more than `reach`.
    Jump {
        /// The joint, from 0 at the base.
        joint: usize,
        /// How far away \[rad\].
        away: f64,
        /// How far it may be \[rad\].
        reach: f64,
    },
}

impl TargetTracker {
    /// For an arm with these limits behind a controller that cycles every `cycle_s`.
    #[must_use]
    pub const fn new(limits: JointLimits<JOINTS>, cycle_s: f64) -> Self {
        Self { limits, cycle_s, newest: None, last: None }
    }

    /// Takes a command; the newest one counts.
    pub fn take(&mut self, command: &JointCommand) {
        self.newest = Some(*command);
    }

    /// A permit begins with the arm at rest at `q` \[rad\]: whatever was aimed at before is past.
    pub fn begin(&mut self, instant_ns: u64, q: [f64; JOINTS]) {
        self.last = Some((instant_ns, JointMotion { q, qd: [0.0; JOINTS], qdd: [0.0; JOINTS] }));
    }

    #[must_use]
    pub const fn newest(&self) -> Option<&JointCommand> {
        self.newest.as_ref()
    }

    /// Whether the newest command asks for motion at `now_ns`.
    #[must_use]
    pub fn commanding(&self, now_ns: u64) -> bool {
        self.newest
            .as_ref()
            .is_some_and(|command| matches!(demand_at(command, now_ns), Demand::Follow { .. }))
    }

    /// The target for `instant_ns`, at which the controller will use it. Instants grow.
    pub fn at(&mut self, instant_ns: u64) -> Target {
        let Some(command) = &self.newest else { return Target::None };
        let Some(wanted) = self.wanted(command, instant_ns) else { return Target::None };
        if let Some((last_ns, last)) = &self.last
            && let Some(jump) = self.jump(*last_ns, last, instant_ns, &wanted)
        {
            return jump;
        }
        let follows = matches!(demand_at(command, instant_ns), Demand::Follow { .. });
        self.last = Some((instant_ns, wanted));
        if follows { Target::Follow(wanted) } else { Target::Brake(wanted) }
    }

    fn wanted(&self, command: &JointCommand, instant_ns: u64) -> Option<JointMotion<JOINTS>> {
        let enabled = command.flags & command_flags::ENABLED != 0;
        let qd = if enabled { command.qd } else { [0.0; JOINTS] };
        let stamp = Stamp(command.header.stamp_ns);
        let commanded = Commanded::new(stamp, JointMotion { q: command.q, qd, qdd: [0.0; JOINTS] })?;
        let valid_until = Stamp(command.valid_until_ns);
        Some(consumer_state(&commanded, valid_until, self.limits.deceleration(), Stamp(instant_ns)))
    }

    fn jump(
        &self,
        last_ns: u64,
        last: &JointMotion<JOINTS>,
        instant_ns: u64,
        wanted: &JointMotion<JOINTS>,
    ) -> Option<Target> {
        let passed_s = (instant_ns.saturating_sub(last_ns) as f64 * 1e-9).min(5.0 * self.cycle_s);
        let reach = reach(&self.limits, self.cycle_s);
        let joints = wanted.q.iter().zip(last.q.iter().zip(&last.qd)).enumerate();
        joints
            .map(|(joint, (to, (q, qd)))| (joint, (to - (q + qd * passed_s)).abs()))
            .find(|(_, away)| !(*away <= reach))
            .map(|(joint, away)| Target::Jump { joint, away, reach })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_client::Mode;

    const TICK_NS: u64 = 2_000_000;

    fn targets() -> TargetTracker {
        let limits = JointLimits::new([[-6.0, 6.0]; JOINTS], [3.0; JOINTS], [20.0; JOINTS])
            .and_then(|limits| limits.with_stale_braking(0.01, [10.0; JOINTS]))
            .unwrap();
        TargetTracker::new(limits, 0.008)
    }

    fn command(stamp_ns: u64, q: f64, qd: f64) -> JointCommand {
        let mut command = JointCommand {
            valid_until_ns: stamp_ns + 5 * TICK_NS,
            q: [q; JOINTS],
            qd: [qd; JOINTS],
            mode: Mode::Following.into(),
            flags: command_flags::ENABLED,
            ..JointCommand::default()
        };
        command.header.stamp_ns = stamp_ns;
        command
    }

    #[test]
    fn without_a_command_there_is_no_target() {
        assert_eq!(targets().at(1), Target::None);
        assert!(!targets().commanding(1));
    }

    #[test]
    fn target_is_where_the_command_leads_at_the_instant_of_use() {
        let mut targets = targets();
        targets.take(&command(1_000_000_000, 0.5, 1.0));
        let Target::Follow(motion) = targets.at(1_004_000_000) else { panic!() };
        assert!((motion.q[0] - 0.504).abs() < 1e-12);
        assert_eq!(motion.qd[5], 1.0);
    }

    #[test]
    fn after_its_validity_it_brakes_to_rest_and_stays() {
        let mut targets = targets();
        targets.take(&command(1_000_000_000, 0.5, 1.0));
        let mut last = 0.5;
        for cycle in 0..40u64 {
            let now = 1_000_000_000 + cycle * 8_000_000;
            match targets.at(now) {
                Target::Follow(motion) => last = motion.q[0],
                Target::Brake(motion) => {
                    assert!(motion.q[0] >= last && motion.q[0] - last <= 0.008 + 1e-12);
                    last = motion.q[0];
                }
                other => panic!("{other:?}"),
            }
        }
        // 10 ms of validity, then 1² / (2 · 10).
        assert!((last - (0.5 + 0.01 + 0.05)).abs() < 1e-9);
        assert!(!targets.commanding(2_000_000_000));
    }

    #[test]
    fn a_target_that_no_arm_could_reach_is_refused_with_joint_and_amount() {
        let mut targets = targets();
        targets.take(&command(1_000_000_000, 0.5, 0.0));
        assert!(matches!(targets.at(1_000_000_000), Target::Follow(_)));
        let mut far = command(1_008_000_000, 0.5, 0.0);
        far.q[3] += 0.2;
        targets.take(&far);
        let Target::Jump { joint, away, reach } = targets.at(1_008_000_000) else { panic!() };
        assert_eq!(joint, 3);
        assert!((away - 0.2).abs() < 1e-12 && reach < 0.1);
        // With another permit the arm begins from where it is.
        targets.begin(1_008_000_000, far.q);
        assert!(matches!(targets.at(1_016_000_000), Target::Follow(_)));
    }

    #[test]
    fn a_command_that_is_no_number_gives_no_target() {
        let mut targets = targets();
        targets.take(&command(1_000_000_000, f64::NAN, 0.0));
        assert_eq!(targets.at(1_000_000_000), Target::None);
    }

    #[test]
    fn a_disabled_command_is_at_rest() {
        let mut targets = targets();
        targets.take(&JointCommand { flags: 0, ..command(1_000_000_000, 0.5, 1.0) });
        let Target::Brake(motion) = targets.at(1_004_000_000) else { panic!() };
        assert_eq!((motion.q[0], motion.qd[0]), (0.5, 0.0));
    }

    /// Cycles of the joints at 2.9 rad/s from 0, and what becomes of a target `after_ns` later at `q`.
    fn next(after_ns: u64, q: f64) -> Target {
        let (mut targets, begin_ns) = (targets(), 1_000_000_000);
        targets.take(&command(begin_ns, 0.0, 2.9));
        assert!(matches!(targets.at(begin_ns), Target::Follow(_)));
        targets.take(&command(begin_ns + after_ns, q, 2.9));
        targets.at(begin_ns + after_ns)
    }

    #[test]
    fn a_target_is_judged_by_where_the_one_before_leads_and_for_five_cycles_at_most() {
        // A cycle of 8 ms leads 0.0232 rad on; reach is 2 · 3 · 0.008 + 0.5 · 20 · 0.04² = 0.064 rad.
        for (q, follows) in [(0.0232, true), (0.087, true), (0.0875, false), (-0.0405, true), (-0.041, false)]
        {
            assert_eq!(matches!(next(8_000_000, q), Target::Follow(_)), follows, "{q}");
        }
        // After a second it counts as five cycles on: 0.116 rad.
        for (q, follows) in [(0.116, true), (0.0525, true), (0.0515, false), (0.1795, true), (0.1805, false)]
        {
            assert_eq!(matches!(next(1_000_000_000, q), Target::Follow(_)), follows, "{q}");
        }
    }

    #[test]
    fn a_command_asks_for_motion_while_it_is_enabled_and_valid() {
        let mut targets = targets();
        let sent = command(1_000_000_000, 0.5, 1.0);
        targets.take(&sent);
        assert_eq!(targets.newest().map(|newest| newest.valid_until_ns), Some(sent.valid_until_ns));
        assert!(targets.commanding(sent.valid_until_ns - 1) && !targets.commanding(sent.valid_until_ns + 1));
        targets.take(&JointCommand { flags: 0, ..sent });
        assert!(!targets.commanding(1_000_000_001));
    }
}
