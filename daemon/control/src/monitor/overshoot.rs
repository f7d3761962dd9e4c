//! How far servos that swing over may be beyond their commands, while the arm's own response is unknown.
//!
//! Contract: a servo whose damping is below critical leaves the range of its commands by its overshoot. Until
//! the response is known, a joint may be where any of some such servos would be; a pure delay before them is
//! covered by the age of the commands that count. Pure, bounded work per command.

use crate::arm::response::SecondOrder;
use crate::state::state;
use crate::units::Stamp;

/// Group delays of the servos \[s\], and their damping ratio.
const GROUPS_S: [f64; SERVOS] = [0.01, 0.02, 0.04, 0.06];
const DAMPING: f64 = 0.45;
const SERVOS: usize = 4;
/// Longer steps count as this long \[s\]: the servo has come to rest.
const LONGEST_STEP_S: f64 = 0.5;
const SHORTEST_STEP_S: f64 = 1e-4;

/// The servos of all joints.
#[derive(Debug, Clone)]
pub(super) struct Overshoot<const J: usize> {
    last: Option<(Stamp, [f64; J])>,
    /// Positions \[rad\], velocities \[rad/s\].
    positions: [[f64; J]; SERVOS],
    velocities: [[f64; J]; SERVOS],
}

state! { [const J: usize] Overshoot<J> { last, positions, velocities } }

impl<const J: usize> Overshoot<J> {
    pub(super) const fn new() -> Self {
        Self { last: None, positions: [[0.0; J]; SERVOS], velocities: [[0.0; J]; SERVOS] }
    }

    /// The response is known, or the arm is another's: the next command begins from rest.
    pub(super) fn forget(&mut self) {
        self.last = None;
    }

    /// The joints `q` \[rad\] were commanded for `stamp`.
    pub(super) fn commanded(&mut self, stamp: Stamp, q: &[f64; J]) {
        let Some((before, from)) = self.last.replace((stamp, *q)) else {
            (self.positions, self.velocities) = ([*q; SERVOS], [[0.0; J]; SERVOS]);
            return;
        };
        let step_s = stamp.seconds_since(before).clamp(SHORTEST_STEP_S, LONGEST_STEP_S);
        let servos = self.positions.iter_mut().zip(&mut self.velocities).zip(GROUPS_S);
        for ((positions, velocities), group_s) in servos {
            let servo = SecondOrder::damped(group_s / step_s, DAMPING);
            let joints = positions.iter_mut().zip(velocities).zip(from.iter().zip(q));
            for ((position, velocity), (from, to)) in joints {
                let [y, yd] = servo.step([*position, *velocity * step_s], *from, *to);
                (*position, *velocity) = (y, yd / step_s);
            }
        }
    }

    /// Where each of the servos has the joints \[rad\].
    pub(super) fn positions(&self) -> &[[f64; J]] {
        if self.last.is_some() { &self.positions } else { &[] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stroke of 0.1 rad at 1 rad/s, commanded every 2 ms: the farthest that any servo has the joint.
    fn farthest(ticks: u64) -> (f64, f64) {
        let mut overshoot = Overshoot::<1>::new();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for tick in 0..ticks {
            let q = (tick as f64 * 2e-3 - 0.2).clamp(0.0, 0.1);
            overshoot.commanded(Stamp(1_000_000_000 + tick * 2_000_000), &[0.5 + q]);
            for [q] in overshoot.positions() {
                (low, high) = (low.min(*q), high.max(*q));
            }
        }
        (low, high)
    }

    #[test]
    fn servos_rest_with_their_commands_and_swing_over_by_what_their_damping_says() {
        let (low, high) = farthest(100);
        assert_eq!((low, high), (0.5, 0.5));
        let (low, high) = farthest(1000);
        assert_eq!(low, 0.5);
        // A ramp of 0.1 s is almost a step for the slowest: 20.5 % of a step at a damping ratio of 0.45.
        let step = 0.1 * (-std::f64::consts::PI * DAMPING / (1.0 - DAMPING * DAMPING).sqrt()).exp();
        assert!(high - 0.6 < step && high - 0.6 > 0.5 * step, "{high}");
    }
}
