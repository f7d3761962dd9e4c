//! The paper's figure 2: feedback only (Hold), prediction, and perfect prediction (the recorded future).
//!
//! Every letter is written in real time from rest; scored where the pen is down, arm's tool against pen at the same
//! instant. The DyBM learns on from letter to letter, as in the daemon.

use foretrace_config::Config;
use foretrace_control::predict::PredictorKind;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;

use super::closed_loop::{ArmKind, ClosedLoop, DeskOptions, RunError, desk};
use super::{ExperimentError, Letter, WAIT_S, learner_for, median, settings_for, ur5_at};
use crate::metrics::tracking;
use crate::parallel;

/// With and without the arm's lag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fig2Arm {
    /// Is where the command says.
    Ideal,
    /// The simulated UR5 behind its servo; references are taken a dead time ahead.
    Ur5,
}

/// One predictor in front of one arm, over all letters.
#[derive(Debug, Clone)]
pub struct Fig2Row {
    /// Who predicts.
    pub predictor: PredictorKind,
    /// The arm.
    pub arm: Fig2Arm,
    /// Mean over letters of the mean squared 2-D error [m²].
    pub mse_m2: f64,
    /// Median over letters [m²].
    pub median_mse_m2: f64,
    /// Largest error of any letter [m].
    pub max_m: f64,
    /// Median over letters of the largest error [m].
    pub median_max_m: f64,
    /// Median over letters of the lag [ms].
    pub lag_ms: f64,
    /// Mean squared error of each letter [m²]; NaN where nothing could be scored.
    pub letters_mse_m2: Vec<f64>,
}

/// The whole figure.
#[derive(Debug, Clone)]
pub struct Fig2 {
    /// A row for each predictor and arm.
    pub rows: Vec<Fig2Row>,
    /// Index of the letter nearest to the median of the DyBM's errors on the ideal arm.
    pub typical: usize,
    /// Runs of that letter, in the order of `rows`.
    pub typical_runs: Vec<ClosedLoop>,
}

/// Predictors of the figure: the paper's three cases, its baseline, and ours.
pub const PREDICTORS: [PredictorKind; 5] = [
    PredictorKind::Hold,
    PredictorKind::ConstantVelocity,
    PredictorKind::Dybm,
    PredictorKind::Ours,
    PredictorKind::Oracle,
];

/// Writes every letter with every predictor in front of both arms; `done` hears of each finished row.
///
/// *Errors*: see [`ExperimentError`].
pub fn fig2(config: &Config, letters: &[Letter], done: impl FnMut()) -> Result<Fig2, ExperimentError> {
    let jobs: Vec<_> = [Fig2Arm::Ideal, Fig2Arm::Ur5]
        .into_iter()
        .flat_map(|arm| PREDICTORS.map(|kind| (arm, kind)))
        .collect();
    let finished = parallel::map(&jobs, |(arm, kind)| row(config, letters, *arm, *kind), done);
    let mut rows = Vec::with_capacity(jobs.len());
    let mut runs = Vec::with_capacity(jobs.len());
    for result in finished {
        let (row, run) = result?;
        rows.push(row);
        runs.push(run);
    }
    let of_dybm =
        rows.iter().find(|row| row.predictor == PredictorKind::Dybm).ok_or(ExperimentError::Nothing)?;
    let distance = |mse: &f64| if mse.is_nan() { f64::INFINITY } else { (mse - of_dybm.median_mse_m2).abs() };
    let typical = (0..letters.len())
        .min_by(|a, b| {
            distance(&of_dybm.letters_mse_m2[*a]).total_cmp(&distance(&of_dybm.letters_mse_m2[*b]))
        })
        .ok_or(ExperimentError::Nothing)?;
    let typical_runs = runs.into_iter().map(|mut runs| runs.swap_remove(typical)).collect();
    Ok(Fig2 { rows, typical, typical_runs })
}

fn row(
    config: &Config,
    letters: &[Letter],
    arm: Fig2Arm,
    predictor: PredictorKind,
) -> Result<(Fig2Row, Vec<ClosedLoop>), ExperimentError> {
    let kind = match arm {
        Fig2Arm::Ideal => ArmKind::Ideal,
        Fig2Arm::Ur5 => ArmKind::Ur5(ur5_at(config)),
    };
    let mut settings = settings_for(config, kind, predictor);
    if predictor == PredictorKind::Hold {
        // Feedback only is trust 0, not full trust in "it stands still".
        settings.trust_request = TrustRequest::Manual(Trust::NONE);
    }
    let home = config.robot().home;
    let learner = learner_for(config, &settings, predictor)?;
    let options = DeskOptions { arm: kind, oracle: predictor == PredictorKind::Oracle, learner };
    let mut desk = desk(config.settings().mpc.horizon, &settings, home, options)
        .map_err(|error| ExperimentError::Settings(error.to_string()))?;
    let mut runs = Vec::with_capacity(letters.len());
    for letter in letters {
        let run = desk.write(&letter.path.samples, WAIT_S, &[]);
        runs.push(run.map_err(|error| failed(letter, error))?);
    }
    let scores: Vec<_> =
        letters.iter().zip(&runs).map(|(letter, run)| tracking(&letter.path.samples, &run.tool)).collect();
    let known = || scores.iter().flatten();
    let count = known().count();
    if count == 0 {
        return Err(ExperimentError::Nothing);
    }
    let row = Fig2Row {
        predictor,
        arm,
        mse_m2: known().map(|score| score.mse_m2).sum::<f64>() / count as f64,
        median_mse_m2: median(known().map(|score| score.mse_m2)),
        max_m: known().map(|score| score.max_m).fold(0.0, f64::max),
        median_max_m: median(known().map(|score| score.max_m)),
        lag_ms: median(known().map(|score| score.lag_ms)),
        letters_mse_m2: scores.iter().map(|score| score.as_ref().map_or(f64::NAN, |s| s.mse_m2)).collect(),
    };
    Ok((row, runs))
}

pub(super) fn failed(letter: &Letter, error: RunError) -> ExperimentError {
    ExperimentError::Run { label: letter.label.clone(), writer: letter.writer.clone(), error }
}
