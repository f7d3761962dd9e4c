//! Each baseline along its own trade-off between smoothness and lag, for a picture of error against jerk.

use super::tuned::{self, BUDGETS, TUNED_HEIGHT_M};
use super::{BaselineKind, BaselineSettings, KalmanKnobs, OneEuroKnobs, ServoKnobs};

/// Settings of `kind` from quick to smooth, each with a name; one of them is `settings` itself, "default".
///
/// The predicting baselines take the rows they were tuned to, one for each budget of jerk; the servoj
/// baselines vary the 1€ filter's cut-off at their own look-ahead, then servoj's look-ahead.
#[must_use]
pub fn sweep(kind: BaselineKind, settings: &BaselineSettings) -> Vec<(String, BaselineSettings)> {
    let mut points = vec![("default".to_owned(), *settings)];
    for (name, point) in others(kind, settings) {
        if points.iter().all(|(_, known)| *known != point) {
            points.push((name, point));
        }
    }
    points
}

fn others(kind: BaselineKind, settings: &BaselineSettings) -> Vec<(String, BaselineSettings)> {
    let tuned = BaselineSettings { height_m: TUNED_HEIGHT_M, ..*settings };
    let named = |index: usize| format!("tuned for {:.0e} m/s3", BUDGETS.get(index).unwrap_or(&f64::NAN));
    let rows: Vec<(String, BaselineSettings)> = match kind {
        BaselineKind::ServojGello | BaselineKind::ServojRos => servoj(&tuned),
        BaselineKind::Otg => {
            let rows = tuned::otg_rows(settings.dead_time_s).into_iter().enumerate();
            rows.map(|(index, otg)| (named(index), BaselineSettings { otg, ..tuned })).collect()
        }
        BaselineKind::Kalman => {
            let rows = tuned::kalman_rows(settings.dead_time_s).into_iter().enumerate();
            let rows = rows.map(|(index, kalman)| (named(index), BaselineSettings { kalman, ..tuned }));
            let published = BaselineSettings { kalman: KalmanKnobs::CHROMIUM, ..tuned };
            rows.chain([("as published".to_owned(), published)]).collect()
        }
    };
    // Only the knobs of this kind were replaced; those of the others come back from `settings`.
    rows.into_iter()
        .map(|(name, point)| {
            let scaled = point.for_height(settings.height_m);
            let mut kept = *settings;
            match kind {
                BaselineKind::ServojGello | BaselineKind::ServojRos => {
                    (kept.one_euro, kept.servo) = (scaled.one_euro, scaled.servo);
                }
                BaselineKind::Otg => kept.otg = scaled.otg,
                BaselineKind::Kalman => kept.kalman = scaled.kalman,
            }
            (name, kept)
        })
        .collect()
}

fn servoj(tuned: &BaselineSettings) -> Vec<(String, BaselineSettings)> {
    // Cut-off at rest [Hz] and its growth with speed [Hz per m/s], from nearly no filter to a heavy one.
    let filters = [(20.0, 1000.0), (20.0, 30.0), (20.0, 3.0), (10.0, 0.0), (5.0, 0.0)].map(
        |(min_cutoff_hz, beta_hz_per_mps)| {
            let one_euro = OneEuroKnobs { min_cutoff_hz, beta_hz_per_mps, speed_cutoff_hz: 10.0 };
            let name = format!("1 euro {min_cutoff_hz} Hz + {beta_hz_per_mps} Hz per m/s");
            (name, BaselineSettings { one_euro, ..*tuned })
        },
    );
    let servos = [(0.05, 1000.0), (0.1, 300.0), (0.15, 200.0), (0.2, 100.0)]
        .into_iter()
        .filter(|(look_ahead_s, _)| *look_ahead_s > tuned.servo.look_ahead_s)
        .map(|(look_ahead_s, gain)| {
            let servo = ServoKnobs { look_ahead_s, gain };
            let one_euro = OneEuroKnobs { min_cutoff_hz: 10.0, beta_hz_per_mps: 0.0, speed_cutoff_hz: 10.0 };
            (format!("look-ahead {look_ahead_s} s"), BaselineSettings { servo, one_euro, ..*tuned })
        });
    filters.into_iter().chain(servos).collect()
}
