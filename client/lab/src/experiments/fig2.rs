//! The paper's figure 2: feedback only (Hold), prediction, and perfect prediction (the recorded future).
//!
//! Every letter is written in real time from rest; scored where the pen is down, arm's tool against pen at
//! the same instant. Trust is 0 for feedback only, automatic for `mixture`, 1 for all others. Online learners
//! keep their state from letter to letter, as in the daemon.

use foretrace_config::Config;
use foretrace_control::predict::PredictorKind;
use foretrace_sim::metrics::{ToolSample, tracking};

use super::closed_loop::{DeskOptions, RunError, desk};
use super::{
    ArmKind, ExperimentError, LawEntrant, Letter, WAIT_S, learner_for, median, settings_for, ur5_at,
};
use crate::parallel;

/// With and without the arm's lag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fig2Arm {
    Ideal,
    /// The simulated UR5 behind its servo; references are taken a dead time ahead.
    Ur5,
}

impl Fig2Arm {
    /// Name in tables and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::Ur5 => "ur5",
        }
    }
}

/// One predictor on one arm, over all letters.
#[derive(Debug, Clone)]
pub struct Fig2Row {
    /// The predictor, and how its trust is set.
    pub entrant: LawEntrant,
    pub arm: Fig2Arm,
    /// Mean over letters of the mean squared 2-D error \[m²\].
    pub mse_m2: f64,
    /// Median over letters \[m²\].
    pub median_mse_m2: f64,
    /// Largest error of any letter \[m\].
    pub max_m: f64,
    /// Median over letters of the largest error \[m\].
    pub median_max_m: f64,
    /// Median over letters of the lag \[ms\].
    pub lag_ms: f64,
    /// Mean squared error of each letter \[m²\]; NaN where nothing could be scored.
    pub letters_mse_m2: Vec<f64>,
}

#[derive(Debug, Clone)]
pub struct Fig2 {
    /// A row for each predictor and arm.
    pub rows: Vec<Fig2Row>,
    /// Index of the letter nearest to the median of the DyBM's errors on the ideal arm (the first entrant's
    /// without it).
    pub typical: usize,
    /// The tool's path over that letter, in the order of `rows`; empty for those that are not in the picture.
    pub typical_tools: Vec<Vec<ToolSample>>,
}

impl Fig2Row {
    /// Name in the table, the picture and the JSON.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        name(self.entrant)
    }
}

/// The predictor's own name; `mixture` is the one with automatic trust, as shipped.
const fn name(entrant: LawEntrant) -> &'static str {
    match entrant {
        LawEntrant::Believed(PredictorKind::MIXTURE) => "mixture-trust1",
        other => other.predictor().name(),
    }
}

/// The entrant of the figure with that name.
#[must_use]
pub fn fig2_entrant(wanted: &str) -> Option<LawEntrant> {
    LawEntrant::all().find(|entrant| name(*entrant) == wanted)
}

/// Names of all entrants, for a message.
#[must_use]
pub fn fig2_names() -> String {
    LawEntrant::all().map(name).collect::<Vec<_>>().join(", ")
}

/// Most entrants that fit the picture.
const PICTURED: usize = 5;

/// `entrant` is drawn: all where there is room, else the paper's three cases, its baseline, and mixture as
/// shipped.
fn pictured(entrant: LawEntrant, entrants: &[LawEntrant]) -> bool {
    const PAPERS: [PredictorKind; 3] =
        [PredictorKind::CONSTANT_VELOCITY, PredictorKind::DYBM, PredictorKind::ORACLE];
    entrants.len() <= PICTURED
        || match entrant {
            LawEntrant::Hold | LawEntrant::Mixture => true,
            LawEntrant::Believed(kind) => PAPERS.contains(&kind),
        }
}

/// Writes every letter with every entrant on both arms; calls `done` after each row.
///
/// # Errors
///
/// See [`ExperimentError`].
pub fn fig2(
    config: &Config,
    letters: &[Letter],
    entrants: &[LawEntrant],
    done: impl FnMut(),
) -> Result<Fig2, ExperimentError> {
    let jobs: Vec<_> = [Fig2Arm::Ideal, Fig2Arm::Ur5]
        .into_iter()
        .flat_map(|arm| entrants.iter().map(move |entrant| (arm, *entrant)))
        .collect();
    let write = |(arm, entrant): &(Fig2Arm, LawEntrant)| {
        row(config, letters, *arm, *entrant, pictured(*entrant, entrants))
    };
    let finished = parallel::map(&jobs, write, done);
    let mut rows = Vec::with_capacity(jobs.len());
    let mut paths = Vec::with_capacity(jobs.len());
    for result in finished {
        let (row, tools) = result?;
        rows.push(row);
        paths.push(tools);
    }
    let of_dybm = rows
        .iter()
        .find(|row| row.entrant == LawEntrant::Believed(PredictorKind::DYBM))
        .or(rows.first())
        .ok_or(ExperimentError::Nothing)?;
    let distance = |mse: &f64| if mse.is_nan() { f64::INFINITY } else { (mse - of_dybm.median_mse_m2).abs() };
    let distances: Vec<f64> = of_dybm.letters_mse_m2.iter().map(distance).collect();
    let nearest = distances.iter().enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b));
    let typical = nearest.map(|(index, _)| index).ok_or(ExperimentError::Nothing)?;
    let typical_tools = paths
        .into_iter()
        .map(|mut tools: Vec<_>| if typical < tools.len() { tools.swap_remove(typical) } else { Vec::new() })
        .collect();
    Ok(Fig2 { rows, typical, typical_tools })
}

/// The row, and the tool's path over every letter where it is to be `kept`.
fn row(
    config: &Config,
    letters: &[Letter],
    arm: Fig2Arm,
    entrant: LawEntrant,
    kept: bool,
) -> Result<(Fig2Row, Vec<Vec<ToolSample>>), ExperimentError> {
    let predictor = entrant.predictor();
    let kind = match arm {
        Fig2Arm::Ideal => ArmKind::Ideal,
        Fig2Arm::Ur5 => ArmKind::Ur5(ur5_at(config)),
    };
    let mut settings = settings_for(config, &kind.facts(), predictor);
    settings.trust_request = entrant.trust();
    let learner = learner_for(config, &settings, predictor)?;
    let arm_built = kind.built(config.robot().home);
    let options =
        DeskOptions { arm: arm_built, oracle: predictor == PredictorKind::ORACLE, learner, process: None };
    let mut desk = desk(config.settings().mpc.horizon, &settings, options)
        .map_err(|error| ExperimentError::Settings(error.to_string()))?;
    let mut scores = Vec::with_capacity(letters.len());
    let mut tools = Vec::new();
    for letter in letters {
        let path = &letter.path.samples;
        let run = desk.write(path, WAIT_S, &[]).map_err(|error| failed(letter, name(entrant), arm, error))?;
        scores.push(tracking(path, &run.tool));
        if kept {
            tools.push(run.tool);
        }
    }
    let known = || scores.iter().flatten();
    let count = known().count();
    if count == 0 {
        return Err(ExperimentError::Nothing);
    }
    let row = Fig2Row {
        entrant,
        arm,
        mse_m2: known().map(|score| score.mse_m2).sum::<f64>() / count as f64,
        median_mse_m2: median(known().map(|score| score.mse_m2)),
        max_m: known().map(|score| score.max_m).fold(0.0, f64::max),
        median_max_m: median(known().map(|score| score.max_m)),
        lag_ms: median(known().map(|score| score.lag_ms)),
        letters_mse_m2: scores.iter().map(|score| score.as_ref().map_or(f64::NAN, |s| s.mse_m2)).collect(),
    };
    Ok((row, tools))
}

pub(super) fn failed(
    letter: &Letter,
    predictor: &'static str,
    arm: Fig2Arm,
    error: RunError,
) -> ExperimentError {
    let (label, writer) = (letter.label.clone(), letter.writer.clone());
    ExperimentError::Run { label, writer, predictor, arm: arm.name(), error: Box::new(error) }
}
