//! Shards of the prediction tables: errors of single sequences, and the sequences.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::exact::Exact;
use super::few;
use super::file::{MergeError, merged};
use super::scored::{GatheredSet, SequencePart, SetRun, parts};
use crate::prediction::{Mean, Run, Scored, Set, Tally};

/// What is the same in all shards of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableRun {
    pub set: SetRun,
    /// Models that get a row.
    pub models: Vec<String>,
    /// Of what these are.
    pub networks: String,
    /// The result has the errors by symbol.
    pub by_label: bool,
}

/// What one shard found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TablePart {
    sequences: Vec<SequencePart>,
    /// The models, then those that they are measured against.
    models: Vec<RunPart>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RunPart {
    model: String,
    /// For each sequence the ten means of [`Tally`] in its order, each as sum and count.
    errors: Exact,
    /// For each sequence \[µs per step\].
    times_us: Exact,
    /// One training pass \[s\], or nothing.
    train_s_per_epoch: Exact,
    note: Option<String>,
}

/// The result of all shards.
#[derive(Debug)]
pub struct MergedTable {
    pub run: TableRun,
    pub set: Set,
    pub scored: Scored,
}

/// What a shard writes: its sequences of `set`, and the runs over these.
#[must_use]
pub fn table_part(set: &Set, owned: &[bool], runs: &[Run]) -> TablePart {
    let part = |run: &Run| RunPart {
        model: run.model.clone(),
        errors: Exact(run.tallies.iter().flat_map(numbers).collect()),
        times_us: Exact(run.times_us.clone()),
        train_s_per_epoch: Exact(run.train_s_per_epoch.into_iter().collect()),
        note: run.note.clone(),
    };
    TablePart { sequences: parts(set, owned), models: runs.iter().map(part).collect() }
}

fn numbers(tally: &Tally) -> impl Iterator<Item = f64> {
    let ends = [tally.within, tally.clean_mm2];
    let [within, clean] = ends.map(|mean| [mean]);
    let means = within.into_iter().chain(tally.velocity).chain(tally.position).chain(clean);
    // Counts are far below 2^53.
    means.flat_map(|mean| [mean.sum, mean.count as f64])
}

fn tally(numbers: &[f64; 20]) -> Option<Tally> {
    let mut means = [Mean::default(); 10];
    for (mean, pair) in means.iter_mut().zip(numbers.as_chunks::<2>().0) {
        let [sum, count] = *pair;
        if !((0.0..=9e15).contains(&count) && count.fract() == 0.0) {
            return None;
        }
        *mean = Mean { sum, count: count as u64 };
    }
    let [within, v0, v1, v2, v3, p0, p1, p2, p3, clean_mm2] = means;
    Some(Tally { within, velocity: [v0, v1, v2, v3], position: [p0, p1, p2, p3], clean_mm2 })
}

impl MergedTable {
    /// The result of all shards in `files`.
    ///
    /// # Errors
    /// [`MergeError`]: a file that does not fit.
    pub fn of(files: &[PathBuf]) -> Result<Self, MergeError> {
        let (run, shards) = merged::<TableRun, TablePart>(files)?;
        let bad = |file: &PathBuf, why: String| MergeError::Part { file: file.clone(), why };
        let first = files.first().cloned().unwrap_or_default();
        let brought = shards.iter().map(|(_, part)| part.sequences.len()).sum();
        let mut set = GatheredSet::new(run.set.clone(), brought).map_err(|why| bad(&first, why))?;
        few(&run.models).map_err(|why| bad(&first, why))?;
        let mut gathered: Option<Vec<GatheredRun>> = None;
        for (file, TablePart { sequences, models }) in shards {
            let places = set.take(sequences).map_err(|why| bad(&file, why))?;
            of_the_run(&models, &run.models).map_err(|why| bad(&file, why))?;
            let runs = gathered.get_or_insert_with(|| models.iter().map(GatheredRun::new).collect());
            if runs.len() != models.len() {
                return Err(bad(&file, format!("{} models, other shards have {}", models.len(), runs.len())));
            }
            for (run, model) in runs.iter_mut().zip(models) {
                run.take(&places, model).map_err(|why| bad(&file, why))?;
            }
        }
        let runs: Vec<Run> = gathered.unwrap_or_default().into_iter().map(GatheredRun::run).collect();
        Ok(Self { set: set.set(), scored: Scored::of(runs, run.models.len()), run })
    }
}

/// Refuses a part whose first models are not those of its run.
fn of_the_run(models: &[RunPart], names: &[String]) -> Result<(), String> {
    let brought = models.iter().map(|model| Some(&model.model)).chain(std::iter::repeat(None));
    let short = |name: &String| name.chars().take(60).collect::<String>();
    match names.iter().zip(brought).find(|(name, brought)| *brought != Some(*name)) {
        Some((name, Some(other))) => {
            Err(format!("model {:?} where the run has {:?}", short(other), short(name)))
        }
        Some((name, None)) => Err(format!("model {:?} of the run is missing", short(name))),
        None => Ok(()),
    }
}

/// The errors of one model as its shards bring them.
struct GatheredRun {
    model: String,
    note: Option<String>,
    /// Of each sequence with its place: what shards brought, and nothing for what they claim.
    of_sequences: Vec<(usize, Tally, f64)>,
    /// Of every shard that trained it.
    training_s: Vec<f64>,
}

impl GatheredRun {
    fn new(part: &RunPart) -> Self {
        let (model, note) = (part.model.clone(), part.note.clone());
        Self { model, note, of_sequences: Vec::new(), training_s: Vec::new() }
    }

    fn take(&mut self, places: &[usize], part: RunPart) -> Result<(), String> {
        if (&part.model, &part.note) != (&self.model, &self.note) {
            return Err(format!(
                "model {:?} ({:?}), in other shards {:?} ({:?})",
                part.model, part.note, self.model, self.note
            ));
        }
        let (rows, rest) = part.errors.0.as_chunks::<20>();
        if !rest.is_empty() || rows.len() != places.len() || part.times_us.0.len() != places.len() {
            let [errors, times] = [&part.errors, &part.times_us].map(|numbers| numbers.0.len());
            let count = places.len();
            return Err(format!(
                "{}: {errors} numbers of errors and {times} times for {count} sequences",
                part.model
            ));
        }
        for ((place, row), time) in places.iter().zip(rows).zip(&part.times_us.0) {
            let tally = tally(row).ok_or_else(|| format!("{}: a count of errors is none", part.model))?;
            self.of_sequences.push((*place, tally, *time));
        }
        self.training_s.extend(part.train_s_per_epoch.0);
        Ok(())
    }

    fn run(mut self) -> Run {
        self.of_sequences.sort_by_key(|(place, ..)| *place);
        let (tallies, times_us) = self.of_sequences.iter().map(|(_, tally, time)| (*tally, *time)).unzip();
        let passes = self.training_s.len();
        let train_s_per_epoch = (passes > 0).then(|| self.training_s.iter().sum::<f64>() / passes as f64);
        let Self { model, note, .. } = self;
        Run { model, tallies, times_us, train_s_per_epoch, note }
    }
}
