//! How finely joints are reported: what a counter in whole steps may hide of a motion.
//!
//! Contract: per joint the smallest change between reports, since the arm was taken over. A joint that has
//! not changed yet reports as coarsely as the coarsest of those that have; no encoder of an arm is coarser
//! than [`COARSEST_RAD`], whatever is reported. Pure, bounded work per joint state.

use crate::state::state;

/// 1 mm at a reach of 1 m \[rad\].
const COARSEST_RAD: f64 = 1e-3;

/// The smallest change of each joint \[rad\].
#[derive(Debug, Clone)]
pub(super) struct Grain<const J: usize> {
    /// ∞: it has not changed.
    finest: [f64; J],
}

state! { [const J: usize] Grain<J> { finest } }

impl<const J: usize> Grain<J> {
    pub(super) const fn new() -> Self {
        Self { finest: [f64::INFINITY; J] }
    }

    /// The joints were reported at `before`, and at `now` next \[rad\].
    pub(super) fn see(&mut self, before: &[f64; J], now: &[f64; J]) {
        for (finest, (before, now)) in self.finest.iter_mut().zip(before.iter().zip(now)) {
            let change = (now - before).abs();
            if change > 0.0 {
                *finest = finest.min(change);
            }
        }
    }

    /// How far a joint may move at most without a change of its report \[rad\].
    pub(super) fn hides(&self, joint: usize) -> f64 {
        let known = |finest: &f64| finest.is_finite();
        let own = self.finest.get(joint).copied().filter(known);
        let coarsest = || self.finest.iter().copied().filter(known).fold(0.0, f64::max);
        own.unwrap_or_else(coarsest).min(COARSEST_RAD)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_joint_hides_what_its_own_reports_are_too_coarse_for() {
        let mut grain = Grain::<3>::new();
        assert_eq!(grain.hides(0), 0.0, "nothing has moved");
        let mut before = [0.0; 3];
        for tick in 1..200_i32 {
            let q = f64::from(tick) * 1e-4;
            let now = [(q / 5e-4).round() * 5e-4, q, 0.0];
            grain.see(&before, &now);
            before = now;
        }
        let hides = [0, 1, 2].map(|joint| grain.hides(joint));
        for (hides, wanted) in hides.iter().zip([5e-4, 1e-4, 5e-4]) {
            assert!((hides - wanted).abs() < 1e-12, "{hides:?}");
        }
        grain.see(&[0.0, 0.0, 0.0], &[0.0, 0.0, 0.03]);
        assert_eq!(grain.hides(2), COARSEST_RAD, "no encoder");
        let mut nothing = Grain::<1>::new();
        nothing.see(&[0.0], &[f64::NAN]);
        assert_eq!(nothing.hides(0), 0.0);
    }
}
