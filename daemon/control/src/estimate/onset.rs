//! Onset: how far previews are trusted while the pen begins to move.
//!
//! Contract: fixed size, total. The first steps of a stroke predict the next ones worst, and a saturated arm
//! that set off in the wrong direction takes longest to return, so waiting costs less. How much applies to
//! the present hand is learned from its past onsets: where they were predicted well, or where the arm is
//! rarely saturated, trust is not reduced.

use super::LawParameters;
use crate::pen::{REST, TARGET_RMS, rests};
use crate::state::state;

/// The record of onsets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Onset {
    law: LawParameters,
    /// Newest grid point \[m\].
    at: [f64; 2],
    /// Steps of rest since the last motion, and of motion since the last rest.
    still: u32,
    moved: u32,
    /// Squared overshoot of previews at onsets, and squared real displacement, both per step ahead
    /// \[normalised²\].
    beyond: f64,
    way: f64,
}

state! { [] Onset { at, still, moved, beyond, way } fixed { law } }

impl Onset {
    pub(super) const fn new(law: &LawParameters) -> Self {
        let way = law.first_cases * law.onset_farthest * TARGET_RMS * TARGET_RMS;
        Self { law: *law, at: [0.0; 2], still: 0, moved: 0, beyond: way * law.onset_bad, way }
    }

    /// Another predictor: forgets its onsets, keeps what concerns the pen.
    pub(super) fn forget(&mut self) {
        let Self { beyond, way, .. } = Self::new(&self.law);
        (self.beyond, self.way) = (beyond, way);
    }

    /// A grid point at `position` \[m\]; `unit_m`: metres per normalised unit.
    pub(super) fn close(&mut self, position: [f64; 2], unit_m: f64) {
        let ([x, y], [before_x, before_y]) = (position, self.at);
        self.at = position;
        if rests([(x - before_x) / unit_m, (y - before_y) / unit_m]) {
            self.still = self.still.saturating_add(1);
            if f64::from(self.still) >= self.law.onset_rest {
                self.moved = 0;
            }
        } else {
            self.still = 0;
            self.moved = self.moved.saturating_add(1);
        }
    }

    /// Steps of motion since the last rest.
    pub(super) const fn moved(&self) -> u32 {
        self.moved
    }

    /// Share of a preview that is trusted now, at least [`LawParameters::onset_first`], by an arm that is
    /// `saturated` in this share of its motion.
    pub(super) fn belief(&self, saturated: f64) -> f64 {
        let doubt = (1.0 - self.law.onset_first - self.law.onset_more * f64::from(self.moved)).max(0.0);
        let bad = self.beyond / (self.law.onset_bad * self.way);
        1.0 - doubt * bad.clamp(0.0, 1.0) * (saturated / self.law.onset_saturated).clamp(0.0, 1.0)
    }

    /// A preview made after `moved` steps predicted the displacement `predicted`; the pen moved by `real`
    /// \[normalised\] `ahead` steps later.
    pub(super) fn judged(&mut self, moved: u32, predicted: [f64; 2], real: [f64; 2], ahead: f64) {
        if self.law.onset_first + self.law.onset_more * f64::from(moved) >= 1.0
            || ahead > self.law.onset_farthest
        {
            return;
        }
        let ([px, py], [x, y]) = (predicted, real);
        // Previews of no motion, or of less than a step, would divide by too small a number.
        let long = px.hypot(py).max(REST);
        let beyond = ((px * (px - x) + py * (py - y)) / long).max(0.0);
        let scale = 1.0 / (ahead * ahead).max(1.0);
        let forgetting = 1.0 - 1.0 / (self.law.memory * self.law.onset_farthest);
        let beyond = self.beyond * forgetting + scale * beyond * beyond;
        let way = self.way * forgetting + scale * (x * x + y * y);
        if beyond.is_finite() && way.is_finite() && way > 0.0 {
            (self.beyond, self.way) = (beyond, way);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHIPPED: &LawParameters = &LawParameters::SHIPPED;

    /// Previews of onsets that predict `factor` times the real displacement.
    fn begin(onset: &mut Onset, cases: u32, factor: f64) {
        for case in 0..cases {
            let ahead = f64::from(1 + case % 9);
            let real = [8.0 * ahead, -6.0 * ahead];
            onset.judged(case % 7, real.map(|way| factor * way), real, ahead);
        }
    }

    #[test]
    fn a_new_hand_is_believed_step_by_step() {
        let mut onset = Onset::new(SHIPPED);
        for (moved, share) in (1..).zip([0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.0]) {
            assert!((onset.belief(1.0) - share).abs() < 1e-12, "{moved}: {}", onset.belief(1.0));
            onset.close([f64::from(moved), 0.0], 0.1);
        }
        assert_eq!(Onset { moved: u32::MAX, ..onset }.belief(1.0), 1.0);
    }

    #[test]
    fn who_does_not_go_too_far_is_believed_at_once_until_they_do() {
        for factor in [1.0, 0.4] {
            let mut onset = Onset::new(SHIPPED);
            begin(&mut onset, 6000, factor);
            assert!(onset.belief(1.0) > 0.95, "{factor}: {}", onset.belief(1.0));
            begin(&mut onset, 6000, 1.6);
            assert!((onset.belief(1.0) - SHIPPED.onset_first).abs() < 1e-12, "{}", onset.belief(1.0));
            onset.forget();
            assert_eq!(onset, Onset::new(SHIPPED));
        }
        // Later previews and far leads say nothing about onsets.
        let mut onset = Onset::new(SHIPPED);
        for _ in 0..6000 {
            onset.judged(7, [10.0, 0.0], [10.0, 0.0], 1.0);
            onset.judged(0, [110.0, 0.0], [110.0, 0.0], 11.0);
        }
        assert_eq!(onset, Onset::new(SHIPPED));
    }

    #[test]
    fn an_arm_away_from_its_limits_has_nothing_to_wait_for() {
        let onset = Onset::new(SHIPPED);
        for (saturated, share) in [(0.0, 1.0), (0.1, 1.0 - 0.7 / 3.0), (0.3, 0.3), (1.0, 0.3), (-1.0, 1.0)] {
            assert!(
                (onset.belief(saturated) - share).abs() < 1e-12,
                "{saturated}: {}",
                onset.belief(saturated)
            );
        }
    }

    #[test]
    fn only_a_rest_begins_anew() {
        const UNIT_M: f64 = 1e-4;
        let mut onset = Onset::new(SHIPPED);
        let mut x_m = 0.0;
        let mut steps = |onset: &mut Onset, count: u32, way: f64| {
            for _ in 0..count {
                x_m += way * UNIT_M;
                onset.close([x_m, 0.0], UNIT_M);
            }
        };
        steps(&mut onset, 12, 10.0);
        steps(&mut onset, SHIPPED.onset_rest as u32 - 1, 0.5);
        steps(&mut onset, 1, 10.0);
        assert_eq!(onset.moved(), 13);
        steps(&mut onset, SHIPPED.onset_rest as u32, 0.5);
        assert_eq!(onset.moved(), 0);
        steps(&mut onset, 3, 10.0);
        assert_eq!(onset.moved(), 3);
    }

    #[test]
    fn numbers_that_are_none_leave_a_share() {
        let bad = [f64::NAN, f64::INFINITY, -1e300, 0.0, 1e-300];
        let mut onset = Onset::new(SHIPPED);
        for a in bad {
            for b in bad {
                onset.close([a, b], b);
                onset.judged(onset.moved() % 7, [a, b], [b, a], a);
                assert!((SHIPPED.onset_first..=1.0).contains(&onset.belief(1.0)), "{a} {b}: {onset:?}");
            }
        }
        begin(&mut onset, 200_000, 1.0);
        onset.moved = 0;
        assert!(onset.belief(1.0) > 0.95, "{onset:?}");
    }
}
