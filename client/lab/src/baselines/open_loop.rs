//! Accuracy of a baseline without an arm: its target for an instant against the pen at that instant.
//!
//! Contract: each path is played in real time from a resting pen, samples arrive at the first period at or
//! after their stamp, and the target made at `now` is scored against the pen (linear between samples, gaps
//! left out) at `now + period + dead time`, the instant at which an arm that takes the dead time would be
//! there. Baselines that smooth in the arm's servo are scored behind a [`SoftServo`](super::SoftServo).
//! Absent: limits of an arm, inverse kinematics.

use super::{BaselineError, BaselineKind, BaselineSettings, build, soften};
use crate::parallel;
use foretrace_sim::metrics::{ToolSample, error_series, motion};
use foretrace_sim::path::PathSample;

/// The pen rests on its first sample for this long before it moves \[s\].
const WAIT_S: f64 = 0.5;
/// Spacing of the samples of a resting pen \[s\].
const WAIT_STEP_S: f64 = 0.005;

/// Sums of periods and stamps differ by less.
const ROUNDING_S: f64 = 1e-9;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpenLoop {
    /// Mean over paths of the mean squared error, hover included \[m²\].
    pub mse_m2: f64,
    /// The same where the pen was down \[m²\].
    pub pen_down_mse_m2: f64,
    /// Root of the mean over paths of the mean squared jerk of the target \[m/s³\].
    pub rms_jerk_mps3: f64,
    /// Periods without a plan.
    pub failures: u64,
}

/// Scores `kind` with `settings` over `paths`; paths on which nothing can be scored do not count.
///
/// # Errors
///
/// Illegal settings.
pub fn open_loop(
    kind: BaselineKind,
    settings: &BaselineSettings,
    paths: &[&[PathSample]],
) -> Result<OpenLoop, BaselineError> {
    settings.check(kind)?;
    // Some paths to a job: one alone is too short for a thread to fetch.
    let jobs: Vec<&[&[PathSample]]> = paths.chunks(32).collect();
    let scored =
        parallel::map(&jobs, |job| job.iter().map(|path| one(kind, settings, path)).collect(), || ());
    let (mut sum, mut count, mut down) = ([0.0; 3], 0.0, 0.0);
    let mut failures = 0;
    for score in scored.into_iter().flat_map(|scores: Vec<_>| scores) {
        let Some(score) = score? else { continue };
        count += 1.0;
        failures += score.failures;
        sum[0] += score.mse_m2;
        sum[2] += score.rms_jerk_mps3.powi(2);
        if score.pen_down_mse_m2.is_finite() {
            down += 1.0;
            sum[1] += score.pen_down_mse_m2;
        }
    }
    Ok(OpenLoop {
        mse_m2: sum[0] / count,
        pen_down_mse_m2: sum[1] / down,
        rms_jerk_mps3: (sum[2] / count).sqrt(),
        failures,
    })
}

fn one(
    kind: BaselineKind,
    settings: &BaselineSettings,
    path: &[PathSample],
) -> Result<Option<OpenLoop>, BaselineError> {
    let Some((first, last)) = path.first().zip(path.last()) else { return Ok(None) };
    let mut way = build(kind, settings)?;
    if kind.smooths_in_the_servo() {
        way = soften(way, settings);
    }
    let resting = (0..(WAIT_S / WAIT_STEP_S) as u32)
        .map(|i| PathSample { t_s: first.t_s - WAIT_S + f64::from(i) * WAIT_STEP_S, ..*first });
    let mut pen = resting.chain(path.iter().copied()).peekable();
    let ahead_s = settings.period_s + settings.dead_time_s;
    let start_s = first.t_s - WAIT_S;
    let mut tool = Vec::new();
    let mut heard = Vec::new();
    for k in 0..=((last.t_s - start_s) / settings.period_s) as u32 {
        let now_s = start_s + f64::from(k) * settings.period_s;
        heard.clear();
        while let Some(sample) = pen.next_if(|sample| sample.t_s <= now_s + ROUNDING_S) {
            heard.push(sample);
        }
        if let Some([x_m, y_m]) = way.target(now_s, &heard)
            && now_s + ahead_s >= first.t_s
        {
            tool.push(ToolSample { t_s: now_s + ahead_s, x_m, y_m });
        }
    }
    let errors = error_series(path, &tool);
    let mse = |down_only: bool| {
        let counted = errors.iter().filter(|error| error.contact || !down_only);
        let (sum, count) = counted.fold((0.0, 0.0), |(s, n), e| (s + e.error_m.powi(2), n + 1.0));
        sum / count
    };
    Ok((!errors.is_empty()).then(|| OpenLoop {
        mse_m2: mse(false),
        pen_down_mse_m2: mse(true),
        rms_jerk_mps3: motion(&tool).rms_jerk_mps3,
        failures: way.failures(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::baselines::Limits;

    #[test]
    fn servo_alone_is_off_by_its_look_ahead_and_the_dead_time() {
        let path: Vec<_> = (0..800)
            .map(|i| {
                let t_s = f64::from(i) * 0.005;
                PathSample { t_s, x_m: 0.1 * t_s, y_m: 0.0, contact: i >= 400 }
            })
            .collect();
        for dead_time_s in [0.0, 0.03] {
            let mut settings =
                BaselineSettings::new(BaselineKind::ServojRos, 0.005, dead_time_s, Limits::OFF, 0.1);
            settings.one_euro.min_cutoff_hz = 1e6;
            let score = open_loop(BaselineKind::ServojRos, &settings, &[&path]).unwrap();
            // One period until the servo has passed the newest sample on.
            let late_s = 0.005 + 0.030 + dead_time_s;
            assert!((score.pen_down_mse_m2.sqrt() - 0.1 * late_s).abs() < 1e-5, "{score:?}");
            // Starting from rest it was closer.
            assert!(score.mse_m2 < score.pen_down_mse_m2);
        }
    }
}
