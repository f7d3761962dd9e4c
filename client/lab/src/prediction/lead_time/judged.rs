//! [`JudgedTarget`]: one prediction against the truth: its error, and the side effects that a user sees.
//!
//! The side effects are four of those that Nancel et al. found users to name, "Next-Point Prediction Metrics
//! for Perceived Spatial Errors" (UIST 2016, doi:10.1145/2984511.2984590), and ranked predictors by in
//! "Next-Point Prediction for Direct Touch Using Finite-Time Derivative Estimation" (UIST 2018,
//! doi:10.1145/3242587.3242646). Theirs is the probability that one is perceived on a touch screen; here each
//! is a size:
//!
//! - **lateness**: how far the prediction lies behind the true position, along the true motion there; 0 where
//!   it lies ahead of it;
//! - **over-anticipation**: how far it lies ahead, likewise;
//! - **wrong direction**: the angle between the predicted and the true displacement since the newest point
//!   seen; none where either has no length;
//! - **jitter**: how far prediction minus truth moved since the instant before, 20 ms earlier in the same
//!   stroke, at the same look-ahead time. A constant error has none.

use super::targets::Truth;

/// A prediction and what is wrong with it; lengths in the unit of the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JudgedTarget {
    /// Predicted minus true position.
    pub offset: [f64; 2],
    /// Along the true motion at the target, negative behind it; `None` where the pen rests.
    pub along: Option<f64>,
    /// The same across that motion.
    pub cross: Option<f64>,
    /// Angle between the predicted and the true displacement \[degrees, 0 to 180\].
    pub wrong_direction_deg: Option<f64>,
    /// Change of `offset` since the instant before; `None` at the first of a stroke.
    pub jitter: Option<f64>,
}

impl JudgedTarget {
    /// Judges a predicted displacement since the newest point \[raw units\]; `unit`: board units per raw unit
    /// along x and y; `before`: the offset of the instant before in the same stroke.
    #[must_use]
    pub fn of(predicted: [f64; 2], truth: &Truth, unit: [f64; 2], before: Option<[f64; 2]>) -> Self {
        let scaled = |v: [f64; 2]| [v[0] * unit[0], v[1] * unit[1]];
        let offset = scaled([predicted[0] - truth.position[0], predicted[1] - truth.position[1]]);
        let motion = scaled(truth.motion);
        let moved = motion[0].hypot(motion[1]);
        let of_motion = |product: f64| (moved > 0.0).then(|| product / moved);
        Self {
            offset,
            along: of_motion(offset[0] * motion[0] + offset[1] * motion[1]),
            cross: of_motion(offset[1] * motion[0] - offset[0] * motion[1]),
            wrong_direction_deg: angle_deg(scaled(predicted), scaled(truth.position)),
            jitter: before.map(|[x, y]| (offset[0] - x).hypot(offset[1] - y)),
        }
    }

    /// Squared length of the offset.
    #[must_use]
    pub fn square(&self) -> f64 {
        self.offset[0] * self.offset[0] + self.offset[1] * self.offset[1]
    }

    /// How far it lies behind the truth.
    #[must_use]
    pub fn lateness(&self) -> Option<f64> {
        // What is not a number must stay so.
        self.along.map(|along| if along >= 0.0 { 0.0 } else { -along })
    }

    /// How far it lies ahead.
    #[must_use]
    pub fn over_anticipation(&self) -> Option<f64> {
        self.along.map(|along| if along <= 0.0 { 0.0 } else { along })
    }
}

/// Between two displacements; `None` where either has no length.
fn angle_deg(a: [f64; 2], b: [f64; 2]) -> Option<f64> {
    let none = |v: [f64; 2]| v == [0.0; 2];
    let (cross, dot) = (a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]);
    (!none(a) && !none(b)).then(|| cross.abs().atan2(dot).to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pen goes on along (3, 4) and will be 10 away.
    const TRUTH: Truth = Truth { position: [6.0, 8.0], motion: [3.0, 4.0] };

    fn judged(predicted: [f64; 2], before: Option<[f64; 2]>) -> [f64; 4] {
        let judged = JudgedTarget::of(predicted, &TRUTH, [1.0; 2], before);
        let known = |value: Option<f64>| value.unwrap();
        [
            known(judged.lateness()),
            known(judged.over_anticipation()),
            known(judged.wrong_direction_deg),
            judged.jitter.unwrap_or(0.0),
        ]
    }

    #[track_caller]
    fn close(got: [f64; 4], wanted: [f64; 4]) {
        assert!(got.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{got:?}, not {wanted:?}");
    }

    #[test]
    fn a_prediction_that_is_late_is_only_late() {
        // Always 5 behind: the offset stays what it was.
        close(judged([3.0, 4.0], Some([-3.0, -4.0])), [5.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn a_prediction_that_goes_too_far_only_over_anticipates() {
        close(judged([9.0, 12.0], Some([3.0, 4.0])), [0.0, 5.0, 0.0, 0.0]);
    }

    #[test]
    fn a_prediction_beside_the_line_has_a_wrong_direction() {
        // 10 far at a right angle, and back: (−8, 6) is beside, (−6, −8) behind.
        close(judged([-8.0, 6.0], None), [10.0, 0.0, 90.0, 0.0]);
        close(judged([-6.0, -8.0], None), [20.0, 0.0, 180.0, 0.0]);
        // As far along the motion as the pen, and 10 beside it.
        close(judged([-2.0, 14.0], None), [0.0, 0.0, 45.0, 0.0]);
    }

    #[test]
    fn an_error_that_alternates_is_jitter() {
        close(judged([2.0, 11.0], Some([4.0, -3.0])), [0.0, 0.0, 26.565_051_177_078, 10.0]);
    }

    #[test]
    fn units_that_differ_by_axis_are_millimetres_first() {
        // x is 10 units per mm, y 1: the pen goes (6, 8) mm, predicted (3, 4) mm.
        let truth = Truth { position: [60.0, 8.0], motion: [30.0, 4.0] };
        let judged = JudgedTarget::of([30.0, 4.0], &truth, [0.1, 1.0], None);
        assert!((judged.lateness().unwrap() - 5.0).abs() < 1e-12, "{judged:?}");
        assert!(judged.cross.unwrap().abs() < 1e-12 && judged.wrong_direction_deg.unwrap() < 1e-6);
    }

    #[test]
    fn nothing_has_no_direction_and_no_number_stays_none() {
        let rests = Truth { position: [0.0; 2], motion: [0.0; 2] };
        let judged = JudgedTarget::of([1.0, 0.0], &rests, [1.0; 2], None);
        assert_eq!((judged.along, judged.wrong_direction_deg, judged.square()), (None, None, 1.0));
        let still = JudgedTarget::of([0.0; 2], &TRUTH, [1.0; 2], None);
        assert_eq!((still.wrong_direction_deg, still.lateness()), (None, Some(10.0)));
        let diverged = JudgedTarget::of([f64::NAN, 0.0], &TRUTH, [1.0; 2], Some([0.0; 2]));
        let all = [diverged.lateness(), diverged.over_anticipation(), diverged.jitter];
        assert!(all.iter().all(|value| value.unwrap().is_nan()), "{all:?}");
    }
}
