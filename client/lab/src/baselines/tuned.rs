//! The tuned settings of the baselines, one row per trade-off between smoothness and error.
//!
//! Source: `client/lab/examples/tune_baselines.rs` on the training writers of unipen-tos, hover kept, median
//! glyph 0.1 m high, period 2 ms: for each budget of RMS jerk the settings with the least mean squared error,
//! separately for dead times of 0, 30 and 100 ms. The servoj baselines cannot predict, so one row serves
//! every dead time; theirs is the smoothest within 2 % of the least RMS error. Budgets are of the baseline's
//! target without an arm, so they only order the rows: the benchmark measures them with an arm.

use super::{BaselineKind, KalmanKnobs, Limits, OneEuroKnobs, Origin, OtgKnobs, PostFilter};

/// Height of a median glyph while tuning \[m\].
pub(super) const TUNED_HEIGHT_M: f64 = 0.1;

/// RMS jerk of the target for each row \[m/s³\].
pub(super) const BUDGETS: [f64; 8] = [f64::INFINITY, 3e5, 1e5, 3e4, 1e4, 3e3, 1e3, 300.0];

pub(super) fn one_euro(kind: BaselineKind) -> OneEuroKnobs {
    let (beta_hz_per_mps, speed_cutoff_hz) =
        if kind == BaselineKind::ServojGello { (30.0, 10.0) } else { (1000.0, 1.0) };
    OneEuroKnobs { min_cutoff_hz: 20.0, beta_hz_per_mps, speed_cutoff_hz }
}

/// The row for the smoothness that a jerk limit of `jerk_mps3` at the tuned height requires.
pub(super) fn kalman(dead_time_s: f64, jerk_mps3: f64) -> KalmanKnobs {
    kalman_rows(dead_time_s)[nearest(jerk_mps3)]
}

/// Least error. Where the arm's jerk limit is finite the generator keeps it anyway, and the estimate in front
/// of it was tuned under the shipped tool limits for a UR5 (1 m/s, 15 m/s², 2000 m/s³; glyphs 0.03 m high).
pub(super) fn otg(dead_time_s: f64, jerk_mps3: f64) -> OtgKnobs {
    match (jerk_mps3.is_finite(), dead_time_s < 0.015) {
        (false, _) => otg_rows(dead_time_s)[0],
        (true, true) => generator(0.061, 0.5, false, f64::INFINITY, 3000.0, 1e7),
        (true, false) => generator(0.031, 0.0, false, 0.025, 3000.0, 1e7),
    }
}

/// Index of the budget nearest to `jerk_mps3` by ratio.
fn nearest(jerk_mps3: f64) -> usize {
    let off = |budget: f64| (budget / jerk_mps3).ln().abs();
    let finite = BUDGETS.iter().enumerate().skip(1);
    let best = finite.min_by(|a, b| off(*a.1).total_cmp(&off(*b.1)));
    best.filter(|_| jerk_mps3.is_finite()).map_or(0, |(index, _)| index)
}

/// Tuned for the nearest of 0, 30 and 100 ms of dead time, in the order of [`BUDGETS`].
pub(super) fn kalman_rows(dead_time_s: f64) -> [KalmanKnobs; 8] {
    use Origin::{Filtered, Measured};
    const FAR: f64 = f64::INFINITY;
    match dead_time_s {
        s if s < 0.015 => [
            row(0.3, Measured, FAR, 0.0, None),
            row(1.0, Measured, FAR, 0.0, Some(euro(50.0, 30.0))),
            row(1.0, Measured, FAR, 0.0, servo(0.005, 0.003_75)),
            row(1.0, Filtered, FAR, 0.5, servo(0.01, 0.0075)),
            row(1.0, Filtered, FAR, 0.5, servo(0.03, 0.0225)),
            row(0.3, Filtered, FAR, 1.0, servo(0.1, 0.075)),
            row(0.1, Filtered, FAR, 1.0, servo(0.1, 0.05)),
            row(0.1, Filtered, FAR, 1.0, servo(0.1, 0.005)),
        ],
        s if s < 0.065 => [
            row(1.0, Measured, 0.025, 0.0, None),
            row(1.0, Measured, 0.025, 0.5, Some(euro(20.0, 0.0))),
            row(3.0, Filtered, 0.025, 0.25, servo(0.01, 0.0)),
            row(1.0, Measured, 0.025, 0.5, servo(0.02, 0.0)),
            row(0.3, Filtered, 0.025, 0.0, servo(0.02, 0.0)),
            row(1.0, Measured, 0.025, 0.0, servo(0.05, 0.0)),
            row(1.0, Measured, 0.025, 0.5, servo(0.1, 0.0)),
            row(0.001, Measured, 0.025, 0.0, servo(0.1, 0.0)),
        ],
        _ => [
            row(1.0, Measured, 0.025, 1.0, None),
            row(1.0, Measured, 0.025, 1.0, servo(0.005, 0.0)),
            row(1.0, Measured, 0.025, 1.0, servo(0.01, 0.0)),
            row(1.0, Measured, 0.025, 1.0, servo(0.02, 0.0)),
            row(0.3, Measured, 0.025, 1.0, servo(0.03, 0.0)),
            row(0.3, Measured, 0.075, 1.0, servo(0.1, 0.0)),
            row(0.3, Measured, 0.025, 1.0, servo(0.1, 0.0)),
            row(0.001, Measured, 0.025, 0.0, servo(0.1, 0.0)),
        ],
    }
}

/// A post-filter and how much further the prediction reaches because of it \[s\].
type TunedPost = Option<(PostFilter, f64)>;

fn servo(look_ahead_s: f64, further_s: f64) -> TunedPost {
    Some((PostFilter::Servo(look_ahead_s), further_s))
}

fn euro(min_cutoff_hz: f64, beta_hz_per_mps: f64) -> (PostFilter, f64) {
    (PostFilter::OneEuro(OneEuroKnobs { min_cutoff_hz, beta_hz_per_mps, speed_cutoff_hz: 10.0 }), 0.0)
}

fn row(process_mps2: f64, origin: Origin, horizon_max_s: f64, share: f64, post: TunedPost) -> KalmanKnobs {
    KalmanKnobs {
        measurement_m: 1e-4,
        process_mps2,
        origin,
        horizon_max_s,
        lead_extra_s: post.map_or(0.0, |(_, further_s)| further_s),
        acceleration_share: share,
        turn_rule: false,
        reversal_rule: false,
        post_filter: post.map(|(filter, _)| filter),
    }
}

/// Tuned for the nearest of 0, 30 and 100 ms of dead time, in the order of [`BUDGETS`].
pub(super) fn otg_rows(dead_time_s: f64) -> [OtgKnobs; 8] {
    const FAR: f64 = f64::INFINITY;
    const NEAR: f64 = 0.025;
    match dead_time_s {
        s if s < 0.015 => [
            generator(0.031, 0.0, false, FAR, 3000.0, 1e7),
            generator(0.041, 0.0, false, FAR, 3000.0, 1e6),
            generator(0.041, 0.0, true, FAR, 500.0, 1e5),
            generator(0.061, 0.0, true, FAR, 500.0, 3e4),
            generator(0.061, 0.0, false, FAR, 500.0, 1e4),
            generator(0.081, 1.0, false, FAR, 500.0, 3000.0),
            generator(0.081, 1.0, false, FAR, 500.0, 1000.0),
            generator(0.061, 0.5, true, FAR, 500.0, 300.0),
        ],
        s if s < 0.065 => [
            generator(0.031, 0.0, false, NEAR, 3000.0, 1e7),
            generator(0.041, 0.0, false, NEAR, 500.0, 1e7),
            generator(0.041, 0.0, false, NEAR, 3000.0, 1e5),
            generator(0.061, 0.0, false, NEAR, 500.0, 3e4),
            generator(0.081, 0.0, false, NEAR, 500.0, 1e4),
            generator(0.081, 0.0, false, NEAR, 500.0, 3000.0),
            generator(0.031, 0.0, false, 0.05, 20.0, 1000.0),
            generator(0.031, 0.0, true, 0.05, 20.0, 300.0),
        ],
        _ => [
            generator(0.041, 1.0, false, NEAR, 3000.0, 1e7),
            generator(0.041, 0.5, false, NEAR, 500.0, 1e7),
            generator(0.041, 1.0, false, NEAR, 3000.0, 1e5),
            generator(0.041, 0.0, false, NEAR, 500.0, 3e4),
            generator(0.061, 0.0, false, NEAR, 500.0, 1e4),
            generator(0.031, 0.0, false, NEAR, 500.0, 1000.0),
            generator(0.011, 0.0, false, NEAR, 20.0, 1000.0),
            generator(0.031, 0.5, true, NEAR, 500.0, 300.0),
        ],
    }
}

fn generator(
    window_s: f64,
    acceleration_share: f64,
    intercept: bool,
    horizon_max_s: f64,
    acceleration_mps2: f64,
    jerk_mps3: f64,
) -> OtgKnobs {
    let limits = Limits { velocity_mps: 10.0, acceleration_mps2, jerk_mps3 };
    OtgKnobs { window_s, acceleration_share, target_acceleration: true, intercept, horizon_max_s, limits }
}
