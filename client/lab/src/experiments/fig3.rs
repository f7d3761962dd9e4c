//! The paper's figure 3: from feedback to prediction within steps 30 to 40 of a letter, by the ramp of trust.
//!
//! The claim under test: switching is smooth. Judged by the commanded tool's jerk and by how far the tracking
//! error moves from tick to tick, each inside the ramp against everywhere else in the same letter.

use foretrace_config::Config;
use foretrace_control::follower::Request;
use foretrace_control::predict::PredictorKind;
use foretrace_sim::metrics::{ToolSample, error_series};

use super::closed_loop::{ClosedLoop, DeskOptions, desk};
use super::fig2::{Fig2Arm, failed};
use super::{ArmKind, ExperimentError, Letter, WAIT_S, learner_for, median, settings_for};

/// First and last grid step of the ramp, counted from the letter's first sample.
pub(super) const RAMP_STEPS: [f64; 2] = [30.0, 40.0];
/// Letters shorter than this many steps have too little outside the ramp to compare with.
const SHORTEST_STEPS: u32 = 60;

#[derive(Debug, Clone)]
pub struct Fig3Letter {
    /// Index into the letters given.
    pub index: usize,
    /// Largest jerk during the ramp over the largest outside.
    pub max_jerk_ratio: f64,
    /// Largest step of the tracking error during the ramp over the largest outside.
    pub irregularity: f64,
    pub trust: Vec<(f64, f64)>,
    /// (step, distance of commanded tool and pen \[m\]).
    pub error_m: Vec<(f64, f64)>,
    /// (step, size of the commanded tool's jerk \[m/s³\]).
    pub jerk_mps3: Vec<(f64, f64)>,
}

#[derive(Debug, Clone)]
pub struct Fig3 {
    /// Letters long enough, in the order given.
    pub letters: Vec<Fig3Letter>,
    pub max_jerk_ratio: f64,
    pub irregularity: f64,
    /// Share of letters with a jerk ratio of at most 1: no more jerk in the ramp than in the rest of the
    /// letter.
    pub unnoticed: f64,
}

/// Writes every letter with the switch in the middle; ideal arm; `kind` predicts, and keeps what it learned
/// from earlier letters. Trust is set by hand, 0 and then 1, so that the ramp alone is tested.
///
/// # Errors
///
/// See [`ExperimentError`].
pub fn fig3(
    config: &Config,
    letters: &[Letter],
    kind: PredictorKind,
    mut done: impl FnMut(),
) -> Result<Fig3, ExperimentError> {
    let settings = settings_for(config, &ArmKind::Ideal.facts(), kind);
    // Steps are those of the pen's grid; the plan's are shorter.
    let step_s = settings.pen.step_ns as f64 * 1e-9;
    let learner = learner_for(config, &settings, kind)?;
    let arm = ArmKind::Ideal.built(config.robot().home);
    let options = DeskOptions { arm, oracle: kind == PredictorKind::ORACLE, learner, process: None };
    let mut desk = desk(config.settings().mpc.horizon, &settings, options)
        .map_err(|error| ExperimentError::Settings(error.to_string()))?;
    let mut out = Vec::new();
    for (index, letter) in letters.iter().enumerate() {
        let path = &letter.path.samples;
        let start_s = path.first().map_or(0.0, |sample| sample.t_s);
        if letter.path.duration_s() >= f64::from(SHORTEST_STEPS) * step_s {
            let switch_s = start_s + RAMP_STEPS[0] * step_s;
            let requests = [(start_s - WAIT_S, Request::SetTrust(0.0)), (switch_s, Request::SetTrust(1.0))];
            let result = desk.write(path, WAIT_S, &requests);
            let run = result.map_err(|error| failed(letter, kind.name(), Fig2Arm::Ideal, error))?;
            out.extend(judge(index, letter, &run, start_s, step_s));
        }
        done();
    }
    if out.is_empty() {
        return Err(ExperimentError::TooShort { steps: SHORTEST_STEPS });
    }
    Ok(Fig3 {
        max_jerk_ratio: median(out.iter().map(|letter| letter.max_jerk_ratio)),
        irregularity: median(out.iter().map(|letter| letter.irregularity)),
        unnoticed: out.iter().filter(|letter| letter.max_jerk_ratio <= 1.0).count() as f64 / out.len() as f64,
        letters: out,
    })
}

fn judge(index: usize, letter: &Letter, run: &ClosedLoop, start_s: f64, step_s: f64) -> Option<Fig3Letter> {
    let end_s = letter.path.samples.last()?.t_s;
    let step = |t_s: f64| (t_s - start_s) / step_s;
    let written = |t_s: f64| t_s >= start_s && t_s <= end_s;
    let commanded: Vec<ToolSample> = run
        .ticks
        .iter()
        .map(|tick| ToolSample { t_s: tick.t_s, x_m: tick.setpoint[0], y_m: tick.setpoint[1] })
        .collect();
    let error_m: Vec<(f64, f64)> = error_series(&letter.path.samples, &commanded)
        .iter()
        .filter(|sample| written(sample.t_s))
        .map(|sample| (step(sample.t_s), sample.error_m))
        .collect();
    let jerk_mps3: Vec<(f64, f64)> = run
        .ticks
        .windows(2)
        .filter(|pair| written(pair[1].t_s))
        .map(|pair| {
            let dt = pair[1].t_s - pair[0].t_s;
            let [ax, ay] = [0, 1].map(|axis| (pair[1].acceleration[axis] - pair[0].acceleration[axis]) / dt);
            (step(pair[1].t_s), ax.hypot(ay))
        })
        .collect();
    let moves: Vec<(f64, f64)> =
        error_m.windows(2).map(|pair| (pair[1].0, (pair[1].1 - pair[0].1).abs())).collect();
    Some(Fig3Letter {
        index,
        max_jerk_ratio: inside_over_outside(&jerk_mps3)?,
        irregularity: inside_over_outside(&moves)?,
        trust: run.ticks.iter().filter(|t| written(t.t_s)).map(|t| (step(t.t_s), t.alpha)).collect(),
        error_m,
        jerk_mps3,
    })
}

/// Largest value during the ramp over the largest outside.
fn inside_over_outside(series: &[(f64, f64)]) -> Option<f64> {
    let largest = |inside: bool| {
        let values =
            series.iter().filter(|(step, _)| (RAMP_STEPS[0]..=RAMP_STEPS[1]).contains(step) == inside);
        values.map(|(_, value)| *value).max_by(f64::total_cmp)
    };
    let (inside, outside) = (largest(true)?, largest(false)?);
    (outside > 0.0).then(|| inside / outside)
}

#[cfg(test)]
mod tests {
    use super::inside_over_outside;

    #[test]
    fn the_ratio_compares_the_ramp_with_everything_else() {
        let series = [(10.0, 2.0), (35.0, 3.0), (36.0, 1.0), (50.0, 1.5)];
        assert_eq!(inside_over_outside(&series), Some(1.5));
        assert_eq!(inside_over_outside(&series[..1]), None);
    }
}
