//! Shards of the ranking by look-ahead time: predictions for single targets, and the sequences.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::exact::Exact;
use super::few;
use super::file::{MergeError, merged};
use super::scored::{GatheredSet, SequencePart, SetRun, parts};
use crate::prediction::Set;
use crate::prediction::lead_time::{
    BandedPosition, Board, LeadAnswers, Predicted, SHARES, Standing, Targets, ranked,
};

/// What is the same in all shards of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeadRun {
    pub sets: Vec<SetRun>,
    /// Entrants by name, in the order of the board.
    pub models: Vec<String>,
    /// Of what these are.
    pub networks: String,
    /// The result lists every sequence.
    pub each: bool,
}

/// What one shard found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeadPart {
    sets: Vec<SetPart>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SetPart {
    sequences: Vec<SequencePart>,
    lanes: Vec<LanePart>,
}

/// Predictions for every target of the sequences of this shard, in their order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LanePart {
    model: String,
    note: Option<String>,
    /// x and y in turn \[raw units\]: displacements since the newest point, or positions with `elsewhere`.
    predicted: Exact,
    elsewhere: bool,
    /// 50 % and 90 % radius in turn \[raw units\], where they came with the predictions.
    radii: Exact,
}

/// The result of all shards.
#[derive(Debug)]
pub struct MergedLeads {
    pub each: bool,
    pub boards: Vec<Board>,
    pub standings: Vec<Standing>,
}

/// What a shard writes: its sequences of every set, and what was predicted of these.
#[must_use]
pub fn lead_part(sets: &[Set], owned: &[Vec<bool>], predicted: &[Vec<Option<Predicted>>]) -> LeadPart {
    let of_set = |((set, owned), predicted): ((&Set, &Vec<bool>), &Vec<Option<Predicted>>)| SetPart {
        sequences: parts(set, owned),
        lanes: predicted.iter().flatten().map(lane_part).collect(),
    };
    LeadPart { sets: sets.iter().zip(owned).zip(predicted).map(of_set).collect() }
}

fn lane_part(predicted: &Predicted) -> LanePart {
    let (numbers, radii, elsewhere) = match &predicted.answers {
        LeadAnswers::Here(displacements) => {
            (displacements.iter().flatten().copied().collect(), Vec::new(), false)
        }
        LeadAnswers::Elsewhere(answers) => {
            let positions = answers.iter().flat_map(|answer| answer.position).collect();
            (positions, answers.iter().filter_map(|answer| answer.radii).flatten().collect(), true)
        }
    };
    let (model, note) = (predicted.model.clone(), predicted.note.clone());
    LanePart { model, note, predicted: Exact(numbers), elsewhere, radii: Exact(radii) }
}

impl MergedLeads {
    /// The result of all shards in `files`.
    ///
    /// # Errors
    /// [`MergeError`]: a file that does not fit.
    pub fn of(files: &[PathBuf]) -> Result<Self, MergeError> {
        let (run, shards) = merged::<LeadRun, LeadPart>(files)?;
        let bad = |file: &PathBuf, why: String| MergeError::Part { file: file.clone(), why };
        let first = files.first().cloned().unwrap_or_default();
        few(&run.models).map_err(|why| bad(&first, why))?;
        let mut of_sets: Vec<Vec<(PathBuf, SetPart)>> = run.sets.iter().map(|_| Vec::new()).collect();
        for (file, part) in shards {
            if part.sets.len() != of_sets.len() {
                let why = format!("it has {} sets, the run {}", part.sets.len(), of_sets.len());
                return Err(bad(&file, why));
            }
            of_sets.iter_mut().zip(part.sets).for_each(|(all, part)| all.push((file.clone(), part)));
        }
        let mut boards = Vec::new();
        for (set, parts) in run.sets.iter().zip(of_sets) {
            boards.push(board(set, run.models.len(), parts, &first)?);
        }
        let chosen: Vec<&str> = run.models.iter().map(String::as_str).collect();
        let (boards, standings) = ranked(&chosen, boards);
        Ok(Self { each: run.each, boards, standings })
    }
}

fn board(
    run: &SetRun,
    most: usize,
    parts: Vec<(PathBuf, SetPart)>,
    first: &PathBuf,
) -> Result<Board, MergeError> {
    let bad = |file: &PathBuf, why: String| MergeError::Part { file: file.clone(), why };
    let brought = parts.iter().map(|(_, part)| part.sequences.len()).sum();
    let mut gathered = GatheredSet::new(run.clone(), brought).map_err(|why| bad(first, why))?;
    let mut lanes: Vec<(PathBuf, Vec<usize>, Vec<LanePart>)> = Vec::with_capacity(parts.len());
    for (file, SetPart { sequences, lanes: of_shard }) in parts {
        let places = gathered.take(sequences).map_err(|why| bad(&file, why))?;
        lanes.push((file, places, of_shard));
    }
    let set = gathered.set();
    let targets = Targets::of(&set.scored);
    let mut counts = vec![0; set.scored.len()];
    for instant in &targets.instants {
        if let Some(count) = counts.get_mut(instant.sequence) {
            *count += instant.scored().count();
        }
    }
    // A sequence without a target costs a lane nothing.
    let has_targets = |place: &usize| counts.get(*place).is_some_and(|count| *count > 0);
    lanes.iter_mut().for_each(|(_, places, _)| places.retain(has_targets));
    let count = lanes.first().map_or(0, |(_, _, lanes)| lanes.len());
    // One more is measured against.
    if count > most + 1 {
        return Err(bad(first, format!("{count} lanes of {:?} for {most} models", run.set)));
    }
    let mut models = Vec::with_capacity(count);
    for index in 0..count {
        let mut whole: Option<GatheredLane> = None;
        for (file, places, of_shard) in &mut lanes {
            let Some(part) = of_shard.get_mut(index).map(std::mem::take) else {
                return Err(bad(file, format!("fewer lanes of {:?} than in other shards", run.set)));
            };
            let lane = whole.get_or_insert_with(|| GatheredLane::new(&part));
            lane.take(places, &counts, part).map_err(|why| bad(file, why))?;
        }
        models.extend(whole.map(|lane| lane.predicted().lane(&set, &targets)));
    }
    if let Some((file, _, of_shard)) = lanes.iter().find(|(_, _, lanes)| lanes.len() != count) {
        let why = format!("{} lanes of {:?}, other shards have {count}", of_shard.len(), run.set);
        return Err(bad(file, why));
    }
    Ok(Board::of(&set, &targets, models))
}

/// A lane as its shards bring it.
struct GatheredLane {
    model: String,
    note: Option<String>,
    elsewhere: bool,
    /// Predictions of a sequence, each with its place.
    of_sequences: Vec<(usize, Vec<BandedPosition>)>,
}

impl Default for LanePart {
    fn default() -> Self {
        let (model, predicted, radii) = (String::new(), Exact::default(), Exact::default());
        Self { model, note: None, predicted, elsewhere: false, radii }
    }
}

impl GatheredLane {
    fn new(part: &LanePart) -> Self {
        let (model, note, elsewhere) = (part.model.clone(), part.note.clone(), part.elsewhere);
        Self { model, note, elsewhere, of_sequences: Vec::new() }
    }

    /// Takes what a shard predicted of the sequences at `places`, which have so many targets.
    fn take(&mut self, places: &[usize], counts: &[usize], part: LanePart) -> Result<(), String> {
        let ours = (&self.model, &self.note, self.elsewhere);
        if ours != (&part.model, &part.note, part.elsewhere) {
            return Err(format!(
                "model {:?} ({:?}), in other shards {:?} ({:?})",
                part.model, part.note, ours.0, ours.1
            ));
        }
        let count = |place: &usize| counts.get(*place).copied().unwrap_or(0);
        let wanted: usize = places.iter().map(count).sum();
        let [predicted, radii] = [&part.predicted, &part.radii].map(|numbers| numbers.0.len());
        if predicted != 2 * wanted || !(radii == 0 || self.elsewhere && radii == SHARES.len() * wanted) {
            return Err(format!(
                "{}: {predicted} numbers of predictions and {radii} radii for {wanted} targets",
                part.model
            ));
        }
        let mut positions = part.predicted.0.as_chunks::<2>().0.iter();
        let mut radii = part.radii.0.as_chunks::<{ SHARES.len() }>().0.iter();
        for place in places {
            let own = positions.by_ref().take(count(place));
            let answers =
                own.map(|position| BandedPosition { position: *position, radii: radii.next().copied() });
            self.of_sequences.push((*place, answers.collect()));
        }
        Ok(())
    }

    fn predicted(mut self) -> Predicted {
        self.of_sequences.sort_by_key(|(place, _)| *place);
        let all = self.of_sequences.into_iter().flat_map(|(_, answers)| answers);
        let answers = if self.elsewhere {
            LeadAnswers::Elsewhere(all.collect())
        } else {
            LeadAnswers::Here(all.map(|answer| answer.position).collect())
        };
        Predicted { model: self.model, note: self.note, answers }
    }
}
