//! The leaderboard: every entrant on every set, and their standing over all.

use serde::Serialize;

use super::super::registry::{Model, RegistryError};
use super::super::{Set, glyph_height};
use super::each::CharacterName;
use super::file::{PredictionError, Predictions};
use super::predicted::{Predicted, predict};
use super::tally::{LeadRow, SequenceSums};
use super::targets::Targets;
use super::writers::{REPLICATES, WriterBootstrap, interval};
use crate::parallel;

/// The model that standings are measured against.
const STILL: &str = "hold";

/// A predictor on the board.
#[derive(Debug, Clone)]
pub enum Entrant {
    /// A model that runs here.
    Model(Model),
    File {
        /// As the board names it.
        name: String,
        predictions: Predictions,
    },
}

impl Entrant {
    /// As the board names it.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Model(model) => model.name(),
            Self::File { name, .. } => name,
        }
    }
}

/// Why there is no board.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BoardError {
    /// A model cannot start.
    #[error(transparent)]
    Model(#[from] RegistryError),
    /// Predictions do not fit.
    #[error(transparent)]
    Predictions(#[from] PredictionError),
}

/// One entrant on one set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Lane {
    pub model: String,
    /// One row per look-ahead time.
    pub leads: Vec<LeadRow>,
    /// Notes for the reader.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Sums of each sequence with targets by look-ahead time.
    #[serde(skip)]
    pub sequences: Vec<SequenceSums>,
}

/// All entrants on one set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Board {
    /// Name of the set.
    pub set: String,
    /// Which part of it.
    pub split: String,
    /// Sampling rates of its files \[Hz\], each once, rising.
    pub rates_hz: Vec<f64>,
    /// A rate is an assumption.
    pub rate_assumed: bool,
    /// Of all lengths: `mm`, or `raw` where the set does not tell its unit.
    pub unit: String,
    /// Median glyph height in that unit.
    pub glyph_height: Option<f64>,
    /// Instants at which every model predicted.
    pub instants: usize,
    /// How many wrote what is judged; with one writer there are no intervals.
    pub writers: usize,
    /// In the order asked for.
    pub models: Vec<Lane>,
    /// Names of the sequences of each lane.
    #[serde(skip)]
    pub characters: Vec<CharacterName>,
    /// What makes the intervals.
    #[serde(skip)]
    pub bootstrap: WriterBootstrap,
}

/// One entrant over all sets.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Standing {
    pub model: String,
    /// Geometric mean over sets and look-ahead times of its RMS over that of a pen that stands still.
    pub rms_over_zero: Option<f64>,
    /// 95 % of it over writers; `null` where a set has one writer.
    pub rms_over_zero_interval: Option<[f64; 2]>,
    /// Sets it was scored on.
    pub sets: usize,
}

/// Runs every entrant on every set; calls `done` after every pair.
///
/// # Errors
/// A model that cannot start, or predictions that do not fit.
pub fn compare(
    entrants: &[Entrant],
    sets: &[Set],
    done: &(dyn Fn() + Sync),
) -> Result<(Vec<Board>, Vec<Standing>), BoardError> {
    fits(entrants, sets)?;
    let everyone = with_still(entrants)?;
    let mut boards = Vec::new();
    for set in sets {
        let targets = Targets::of(&set.scored);
        let owned = vec![true; set.scored.len()];
        let lane = |entrant: &Entrant| -> Result<Option<Lane>, BoardError> {
            let predicted = predict(entrant, set, &targets, &owned)?;
            done();
            Ok(predicted.map(|predicted| predicted.lane(set, &targets)))
        };
        let lanes = parallel::map(&everyone, lane, || ());
        let models = lanes.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
        boards.push(Board::of(set, &targets, models));
    }
    let chosen: Vec<&str> = entrants.iter().map(Entrant::name).collect();
    Ok(ranked(&chosen, boards))
}

/// What every entrant, and `hold`, predicts of each set at the instants of the sequences that are owned.
/// Calls `done` after every pair. `None`: it has no predictions of the set.
///
/// # Errors
/// As [`compare`].
pub fn predict_all(
    entrants: &[Entrant],
    sets: &[Set],
    owned: &[Vec<bool>],
    done: &(dyn Fn() + Sync),
) -> Result<Vec<Vec<Option<Predicted>>>, BoardError> {
    fits(entrants, sets)?;
    let everyone = with_still(entrants)?;
    let of_set = |(set, owned): (&Set, &Vec<bool>)| {
        let targets = Targets::of(&set.scored);
        let one = |entrant: &Entrant| {
            let predicted = predict(entrant, set, &targets, owned);
            done();
            predicted
        };
        parallel::map(&everyone, one, || ()).into_iter().collect()
    };
    sets.iter().zip(owned).map(of_set).collect()
}

/// The standings of the chosen entrants, and the boards with their lanes only.
pub fn ranked(chosen: &[&str], mut boards: Vec<Board>) -> (Vec<Board>, Vec<Standing>) {
    let standings = standings(chosen, &boards);
    for board in &mut boards {
        board.models.retain(|lane| chosen.contains(&lane.model.as_str()));
    }
    (boards, standings)
}

fn fits(entrants: &[Entrant], sets: &[Set]) -> Result<(), BoardError> {
    let sequences: Vec<&[_]> = sets.iter().map(|set| set.scored.as_slice()).collect();
    for entrant in entrants {
        if let Entrant::File { predictions, .. } = entrant {
            predictions.about_known_files(&sequences)?;
        }
    }
    Ok(())
}

/// The entrants, then the one that standings are measured against, where it is not among them.
fn with_still(entrants: &[Entrant]) -> Result<Vec<Entrant>, BoardError> {
    let mut everyone = entrants.to_vec();
    if !everyone.iter().any(|e| e.name() == STILL) {
        everyone.push(Entrant::Model(Model::named(STILL)?));
    }
    Ok(everyone)
}

impl Board {
    /// The board of a set with these lanes.
    #[must_use]
    pub fn of(set: &Set, targets: &Targets, mut models: Vec<Lane>) -> Self {
        let bootstrap = WriterBootstrap::of(set, targets);
        for lane in &mut models {
            let Some(replicates) = bootstrap.rms(&lane.sequences) else { break };
            for (lead, row) in lane.leads.iter_mut().enumerate() {
                let of_lead = replicates.iter().map(|rms| rms.get(lead).copied().unwrap_or(f64::NAN));
                row.rms_interval = interval(of_lead);
            }
        }
        let mut rates_hz: Vec<f64> = set.scored.iter().map(|s| s.rate_hz).collect();
        rates_hz.sort_by(f64::total_cmp);
        rates_hz.dedup();
        Self {
            set: set.name.clone(),
            split: set.split.clone(),
            rates_hz,
            rate_assumed: set.scored.iter().any(|s| s.rate_assumed),
            unit: if set.mm_per_unit().is_some() { "mm" } else { "raw" }.to_owned(),
            glyph_height: height(set),
            instants: targets.instants.len(),
            writers: bootstrap.writers(),
            models,
            characters: set.scored.iter().map(CharacterName::of).collect(),
            bootstrap,
        }
    }
}

/// Median glyph height in the unit of the board.
pub(super) fn height(set: &Set) -> Option<f64> {
    glyph_height(&set.scored).map(|height| height * set.mm_per_unit().map_or(1.0, |[_, y]| y))
}

fn standings(chosen: &[&str], boards: &[Board]) -> Vec<Standing> {
    let mut standings: Vec<Standing> = chosen
        .iter()
        .map(|name| {
            let (mut logarithms, mut sets, mut diverged) = (super::super::Mean::default(), 0, false);
            for board in boards {
                let lane = |name: &str| board.models.iter().find(|lane| lane.model == name);
                let (Some(lane), Some(still)) = (lane(name), lane(STILL)) else { continue };
                sets += 1;
                for (ours, zero) in lane.leads.iter().zip(&still.leads) {
                    let (Some(ours), Some(zero)) = (ours.rms, zero.rms) else { continue };
                    let ratio = (ours / zero).ln();
                    if zero > 0.0 {
                        diverged |= !ours.is_finite();
                        logarithms.push(ratio);
                    }
                }
            }
            let rms_over_zero = if diverged { None } else { logarithms.get().map(f64::exp) };
            let rms_over_zero_interval = rms_over_zero.and_then(|_| standing_interval(name, boards));
            Standing { model: (*name).to_owned(), rms_over_zero, rms_over_zero_interval, sets }
        })
        .collect();
    let last = |s: &Standing| s.rms_over_zero.unwrap_or(f64::INFINITY);
    standings.sort_by(|a, b| last(a).total_cmp(&last(b)));
    standings
}

/// The interval of a standing: replicate by replicate, the writers of every set drawn anew.
fn standing_interval(name: &str, boards: &[Board]) -> Option<[f64; 2]> {
    let mut logarithms = vec![super::super::Mean::default(); REPLICATES];
    for board in boards {
        let lane = |name: &str| board.models.iter().find(|lane| lane.model == name);
        let (Some(lane), Some(still)) = (lane(name), lane(STILL)) else { continue };
        let (ours, zero) = (board.bootstrap.rms(&lane.sequences)?, board.bootstrap.rms(&still.sequences)?);
        for (mean, (ours, zero)) in logarithms.iter_mut().zip(ours.iter().zip(&zero)) {
            let ratios = ours.iter().zip(zero).filter(|(_, zero)| **zero > 0.0);
            ratios.for_each(|(ours, zero)| mean.push((ours / zero).ln()));
        }
    }
    interval(logarithms.iter().map(|mean| mean.get().map_or(f64::NAN, f64::exp)))
}
