//! The leaderboard: every entrant on every set, and their standing over all.

use serde::Serialize;

use super::super::model::Contestant;
use super::super::registry::{Model, RegistryError, Setting};
use super::super::run::train;
use super::super::{Set, glyph_height};
use super::LEADS_MS;
use super::bands::Bands;
use super::file::{BandedPosition, PredictionError, Predictions};
use super::tally::{LeadRow, LeadTally};
use super::targets::{Targets, between};
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
    /// In the order asked for.
    pub models: Vec<Lane>,
}

/// One entrant over all sets.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Standing {
    pub model: String,
    /// Geometric mean over sets and look-ahead times of its RMS over that of a pen that stands still.
    pub rms_over_zero: Option<f64>,
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
    let sequences: Vec<&[_]> = sets.iter().map(|set| set.scored.as_slice()).collect();
    for entrant in entrants {
        if let Entrant::File { predictions, .. } = entrant {
            predictions.about_known_files(&sequences)?;
        }
    }
    let mut everyone = entrants.to_vec();
    if !everyone.iter().any(|e| e.name() == STILL) {
        everyone.push(Entrant::Model(Model::named(STILL)?));
    }
    let mut boards = Vec::new();
    for set in sets {
        boards.push(board(&everyone, set, done)?);
    }
    let standings = standings(entrants, &boards);
    for board in &mut boards {
        board.models.retain(|lane| entrants.iter().any(|e| e.name() == lane.model));
    }
    Ok((boards, standings))
}

fn board(entrants: &[Entrant], set: &Set, done: &(dyn Fn() + Sync)) -> Result<Board, BoardError> {
    let targets = Targets::of(&set.scored);
    let unit = set.mm_per_unit();
    let glyph_height = glyph_height(&set.scored).map(|height| height * unit.map_or(1.0, |[_, y]| y));
    let lane = |entrant: &Entrant| -> Result<Option<Lane>, BoardError> {
        let scale = unit.unwrap_or([1.0; 2]);
        let (tallies, note) = match entrant {
            Entrant::Model(model) => {
                let (mut contestant, note) = model.build(&Setting::of(set))?;
                train(&mut *contestant, &set.train, if set.cold { 0 } else { model.passes() }, &|| ());
                (walk(&mut *contestant, set, &targets, scale), note)
            }
            Entrant::File { predictions, .. } => {
                match predictions.answers(&set.name, &set.scored, &targets)? {
                    Some(answers) => (judge(&answers, &targets, scale), None),
                    None => return Ok(None),
                }
            }
        };
        done();
        let leads = tallies.iter().enumerate().map(|(lead, tally)| tally.row(lead, glyph_height)).collect();
        Ok(Some(Lane { model: entrant.name().to_owned(), leads, note }))
    };
    let lanes = parallel::map(entrants, lane, || ());
    let models = lanes.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
    let mut rates_hz: Vec<f64> = set.scored.iter().map(|s| s.rate_hz).collect();
    rates_hz.sort_by(f64::total_cmp);
    rates_hz.dedup();
    Ok(Board {
        set: set.name.clone(),
        split: set.split.clone(),
        rates_hz,
        rate_assumed: set.scored.iter().any(|s| s.rate_assumed),
        unit: if unit.is_some() { "mm" } else { "raw" }.to_owned(),
        glyph_height,
        instants: targets.instants.len(),
        models,
    })
}

/// Lets a model observe the whole set and predict at every instant.
fn walk(
    contestant: &mut dyn Contestant,
    set: &Set,
    targets: &Targets,
    unit: [f64; 2],
) -> [LeadTally; LEADS_MS.len()] {
    let mut tallies: [LeadTally; LEADS_MS.len()] = Default::default();
    let mut instants = targets.instants.iter().peekable();
    let (mut steps, mut path): (Vec<[f64; 2]>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
    let mut bands = Bands::untried(|lead| targets.steps_ahead(0, lead));
    for (index, sequence) in set.scored.iter().enumerate() {
        contestant.start_sequence();
        let farthest = targets.steps_ahead(index, LEADS_MS.len() - 1).ceil().max(1.0) as usize;
        steps.resize(farthest, [0.0; 2]);
        for (t, v) in sequence.v.iter().enumerate() {
            contestant.observe(*v);
            // After step t the newest point is t + 1.
            bands.observe(t + 1, *v);
            let Some(instant) = instants.next_if(|i| i.sequence == index && i.point == t + 1) else {
                continue;
            };
            contestant.preview(&mut steps);
            sum_up(&steps, &mut path);
            for lead in instant.scored() {
                let ahead = targets.steps_ahead(index, lead);
                let (Some(truth), Some(predicted), Some(tally)) =
                    (targets.truth(index, instant.point, lead), between(&path, ahead), tallies.get_mut(lead))
                else {
                    continue;
                };
                tally.push(predicted, &truth, bands.at(lead), unit);
                let [x, y] = truth.position;
                let due = instant.point + ahead.ceil() as usize;
                bands.push(lead, due, (predicted[0] - x).hypot(predicted[1] - y), x.hypot(y));
            }
        }
        bands.end_sequence();
    }
    tallies
}

/// Scores answers that stand in the order of the targets.
fn judge(answers: &[BandedPosition], targets: &Targets, unit: [f64; 2]) -> [LeadTally; LEADS_MS.len()] {
    let mut tallies: [LeadTally; LEADS_MS.len()] = Default::default();
    let mut answers = answers.iter();
    for instant in &targets.instants {
        let newest = targets.points(instant.sequence).get(instant.point).copied().unwrap_or_default();
        for lead in instant.scored() {
            let (Some(answer), Some(truth), Some(tally)) =
                (answers.next(), targets.truth(instant.sequence, instant.point, lead), tallies.get_mut(lead))
            else {
                continue;
            };
            let predicted = [answer.position[0] - newest[0], answer.position[1] - newest[1]];
            tally.push(predicted, &truth, answer.radii, unit);
        }
    }
    tallies
}

/// Positions after 0, 1, 2 ... predicted steps.
fn sum_up(steps: &[[f64; 2]], path: &mut Vec<[f64; 2]>) {
    path.clear();
    let mut at = [0.0; 2];
    path.push(at);
    for [x, y] in steps {
        at = [at[0] + x, at[1] + y];
        path.push(at);
    }
}

fn standings(entrants: &[Entrant], boards: &[Board]) -> Vec<Standing> {
    let mut standings: Vec<Standing> = entrants
        .iter()
        .map(|entrant| {
            let (mut logarithms, mut sets, mut diverged) = (super::super::Mean::default(), 0, false);
            for board in boards {
                let lane = |name: &str| board.models.iter().find(|lane| lane.model == name);
                let (Some(lane), Some(still)) = (lane(entrant.name()), lane(STILL)) else { continue };
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
            Standing { model: entrant.name().to_owned(), rms_over_zero, sets }
        })
        .collect();
    let last = |s: &Standing| s.rms_over_zero.unwrap_or(f64::INFINITY);
    standings.sort_by(|a, b| last(a).total_cmp(&last(b)));
    standings
}
