//! Clamps joint targets to the joints' velocity and acceleration limits.
//!
//! Contract: on the target while that is legal; else follows it as fast as each joint can still brake to the
//! target's own velocity. One joint at a time; no jerk limit; no position limits.

use foretrace_control::arm::JointLimits;
use foretrace_sim::arm::JOINTS;

/// Share of the acceleration limit that is used: rounding must not carry a command over it.
const SHARE: f64 = 1.0 - 1e-6;

/// Keeps a stream of joint targets legal.
#[derive(Debug, Clone, Copy)]
pub(super) struct LegalTargets {
    limits: JointLimits<JOINTS>,
    period_s: f64,
    /// The last target \[rad\].
    target: Option<[f64; JOINTS]>,
}

impl LegalTargets {
    pub(super) fn new(limits: JointLimits<JOINTS>, period_s: f64) -> Self {
        Self { limits, period_s, target: None }
    }

    /// The command \[rad\] after `q` \[rad\], which was reached with `qd` \[rad/s\], on the way to `target`
    /// \[rad\].
    pub(super) fn command(
        &mut self,
        q: &[f64; JOINTS],
        qd: &[f64; JOINTS],
        target: &[f64; JOINTS],
    ) -> [f64; JOINTS] {
        let dt = self.period_s;
        let before = self.target.replace(*target).unwrap_or(*target);
        let (most, sharpest) = (self.limits.velocity(), self.limits.acceleration());
        std::array::from_fn(|joint| {
            let reach = sharpest[joint] * dt * SHARE;
            let gap = before[joint] - q[joint];
            let half = 0.5 * reach;
            let brakeable = (half * half + 2.0 * sharpest[joint] * gap.abs()).sqrt() - half;
            let wanted = (target[joint] - before[joint]) / dt + gap.signum() * brakeable.min(gap.abs() / dt);
            let velocity = wanted.clamp(qd[joint] - reach, qd[joint] + reach);
            q[joint] + velocity.clamp(-most[joint], most[joint]) * dt
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.002;

    /// Follows `target` from rest at 0 for `ticks`; returns the positions of joint 0 after checking its
    /// limits.
    fn followed(ticks: u32, target: impl Fn(u32) -> f64) -> Vec<f64> {
        let limits = JointLimits::new([[-6.0, 6.0]; JOINTS], [3.0; JOINTS], [40.0; JOINTS]).unwrap();
        let mut legal = LegalTargets::new(limits, DT);
        let (mut q, mut qd) = ([0.0; JOINTS], [0.0; JOINTS]);
        (0..ticks)
            .map(|tick| {
                let next = legal.command(&q, &qd, &[target(tick); JOINTS]);
                let velocity = (next[0] - q[0]) / DT;
                assert!(velocity.abs() <= 3.0 + 1e-9 && (velocity - qd[0]).abs() <= 40.0 * DT, "tick {tick}");
                (q, qd) = (next, [velocity; JOINTS]);
                q[0]
            })
            .collect()
    }

    #[test]
    fn what_is_legal_is_not_changed() {
        let sine = |tick: u32| 0.01 * (1.0 - (20.0 * f64::from(tick) * DT).cos());
        for (tick, q) in (0..).zip(followed(500, sine)) {
            assert!((q - sine(tick)).abs() < 1e-12, "tick {tick}");
        }
    }

    #[test]
    fn a_jump_is_caught_up_with_in_the_shortest_time_without_passing_it() {
        let path = followed(200, |_| 0.05);
        let arrived = (path.iter().position(|q| (q - 0.05).abs() < 1e-6).unwrap() + 1) as f64 * DT;
        // Velocity changes in steps, at the ends of the way sooner than it could continuously.
        let shortest = 2.0 * (0.05_f64 / 40.0).sqrt();
        assert!((0.9 * shortest..1.1 * shortest).contains(&arrived), "{arrived} s, shortest {shortest} s");
        assert!(path.iter().all(|q| *q < 0.05 + 1e-4));
    }

    #[test]
    fn a_moving_target_is_met_with_its_velocity() {
        let target = |tick: u32| 0.03 + f64::from(tick) * DT;
        let path = followed(200, target);
        let behind = |tick: u32| (path[tick as usize] - target(tick)).abs();
        assert!(behind(0) > 0.02 && (100..200).all(|tick| behind(tick) < 1e-9));
    }
}
