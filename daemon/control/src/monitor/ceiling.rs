//! Joints whose speed is cut off at one value while their commands ask for more: the speed ceiling of a slow
//! arm.
//!
//! Contract: between short strokes a slow arm catches up, so it looks like one that is merely late. But a
//! filter rounds speeds, and a ceiling cuts them off: a joint that is cut off spends most of its moving time
//! at its fastest, whereas the speed of a sine is within 5 % of its peak for a fifth of the time.

use crate::state::state;

/// Memory of the fastest speed of a joint, of what commands asked for, and of the shares of time \[s\].
const TOP_S: f64 = 6.0;
const ASKED_S: f64 = 0.4;
const SHARE_S: f64 = 1.0;
/// Shares of its fastest speed from which a joint counts as moving, and as being at its fastest.
const MOVES: f64 = 0.2;
const AT_TOP: f64 = 0.95;
/// A speed above the fastest by this factor restarts the count.
const FASTER: f64 = 1.05;
/// A joint is cut off if it is at its fastest for this share of its motion. Further conditions follow.
const CUT_OFF: f64 = 0.45;
/// It has moved for at least this long \[s\].
const LEAST_MOTION_S: f64 = 0.5;
/// It was at its fastest in this many strokes: a single one behind a filter may have any shape.
const LEAST_VISITS: u32 = 3;
/// Between two strokes it falls below this share of its fastest.
const BELOW: f64 = 0.7;
/// Its fastest is at least this \[rad/s\].
const LEAST_RADPS: f64 = 0.05;

#[derive(Debug, Clone, Copy)]
struct Joint {
    top: f64,
    asked: f64,
    moving_s: f64,
    at_top_s: f64,
    /// How often it came to its fastest from well below.
    visits: u32,
    below: bool,
    /// Commanded speed while it was at its fastest, integrated over time.
    asked_then: f64,
}

state! { [] Joint { top, asked, moving_s, at_top_s, visits, below, asked_then } }

#[derive(Debug, Clone)]
pub(super) struct Ceiling<const J: usize> {
    joints: [Joint; J],
}

state! { [const J: usize] Ceiling<J> { joints } }

impl<const J: usize> Ceiling<J> {
    pub(super) const fn new() -> Self {
        let still = Joint {
            top: 0.0,
            asked: 0.0,
            moving_s: 0.0,
            at_top_s: 0.0,
            visits: 0,
            below: true,
            asked_then: 0.0,
        };
        Self { joints: [still; J] }
    }

    /// Joint `index` was commanded to move at `speed` \[rad/s\].
    pub(super) fn commanded(&mut self, index: usize, speed: f64) {
        if let Some(joint) = self.joints.get_mut(index) {
            joint.asked = joint.asked.max(speed.abs());
        }
    }

    /// The joints moved at `speeds` \[rad/s\] for `elapsed_s`.
    pub(super) fn measured(&mut self, elapsed_s: f64, speeds: &[f64; J]) {
        let keep = |memory_s: f64| (1.0 - elapsed_s / memory_s).max(0.0);
        for (joint, speed) in self.joints.iter_mut().zip(speeds) {
            let speed = speed.abs();
            // The rise to the fastest speed counts as motion.
            if speed > FASTER * joint.top {
                (joint.at_top_s, joint.asked_then, joint.visits) = (0.0, 0.0, 0);
            }
            joint.top = speed.max(joint.top * keep(TOP_S));
            joint.asked *= keep(ASKED_S);
            joint.below |= speed < BELOW * joint.top;
            if speed > MOVES * joint.top {
                for sum in [&mut joint.moving_s, &mut joint.at_top_s, &mut joint.asked_then] {
                    *sum *= keep(SHARE_S);
                }
                joint.moving_s += elapsed_s;
                if speed > AT_TOP * joint.top {
                    joint.at_top_s += elapsed_s;
                    joint.visits += u32::from(std::mem::take(&mut joint.below));
                    joint.asked_then += elapsed_s * joint.asked;
                }
            }
        }
    }

    /// The least share of its commanded speed at which a joint is cut off, if below `least`; then starts
    /// again.
    pub(super) fn share(&mut self, least: f64) -> Option<f64> {
        let mut found: Option<f64> = None;
        for joint in &mut self.joints {
            let asked = joint.asked_then / joint.at_top_s.max(f64::MIN_POSITIVE);
            let cut_off = joint.visits >= LEAST_VISITS
                && joint.moving_s > LEAST_MOTION_S
                && joint.at_top_s > CUT_OFF * joint.moving_s;
            if cut_off && joint.top > LEAST_RADPS && joint.top < least * asked {
                found = Some(found.map_or(joint.top / asked, |share| share.min(joint.top / asked)));
                (joint.moving_s, joint.at_top_s, joint.asked_then, joint.visits) = (0.0, 0.0, 0.0, 0);
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Result for a joint with strokes of up to 2 rad/s whose speed is `speed` of the commanded one, within 6
    /// s.
    fn found(mut speed: impl FnMut(f64, f64) -> f64) -> Option<f64> {
        let mut ceiling = Ceiling::<1>::new();
        (0..3000_u32).find_map(|tick| {
            let t = f64::from(tick) * 2e-3;
            // Every third stroke is half as fast.
            let size = if ((t * 2.0) as u32).is_multiple_of(3) { 1.0 } else { 2.0 };
            let asked = size * (std::f64::consts::TAU * 2.0 * t).sin();
            ceiling.commanded(0, asked);
            ceiling.measured(2e-3, &[speed(t, asked)]);
            ceiling.share(0.75)
        })
    }

    #[test]
    fn what_is_cut_off_is_told_from_what_is_rounded() {
        let share = found(|_, asked: f64| asked.clamp(-0.6, 0.6)).expect("cut off");
        assert!((0.25..0.5).contains(&share), "{share}");
        assert_eq!(found(|_, asked| asked), None);
        assert_eq!(found(|_, asked| 0.4 * asked), None);
        // A filter of first order.
        let mut state = 0.0;
        assert_eq!(
            found(|_, asked| {
                state += (asked - state) * 2e-3 / 0.15;
                state
            }),
            None
        );
    }

    #[test]
    fn a_constant_speed_that_is_reached_is_no_ceiling() {
        let mut ceiling = Ceiling::<1>::new();
        for tick in 0..5000 {
            // A burst with rounded speed, then a straight line.
            let (asked, speed) = if tick < 100 { (2.0, 1.0) } else { (0.4, 0.4) };
            ceiling.commanded(0, asked);
            ceiling.measured(2e-3, &[speed]);
            assert_eq!(ceiling.share(0.75), None, "{tick}");
        }
    }

    /// One long stroke may be cut off by anything; only what comes back to the same top is a ceiling.
    #[test]
    fn one_visit_to_a_top_is_no_ceiling() {
        let mut ceiling = Ceiling::<1>::new();
        for tick in 0..2000 {
            ceiling.commanded(0, 2.0);
            ceiling.measured(2e-3, &[0.6]);
            assert_eq!(ceiling.share(0.75), None, "{tick}");
        }
    }
}
