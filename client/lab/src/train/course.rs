//! A training from its beginning, or from a checkpoint, to its end: what LSTMs and `foresight` share.
//!
//! Contract: the model appears whole and only when it is finished. After every epoch a checkpoint beside it
//! holds all that is needed to continue bit for bit; the finished model removes it.

use std::collections::BTreeMap;
use std::path::PathBuf;

use foretrace_failure::Failure;
use foretrace_sim::data::Split;
use serde_json::Value;

use super::checkpoint_file::CheckpointFile;
use super::engine::Scores;
use super::fit::{Epoch, FitError, TrainState};
use super::model::citation;

/// What every training is asked for.
#[derive(Debug, Clone)]
pub struct TrainingOptions {
    /// Folders of data sets.
    pub data: Vec<PathBuf>,
    pub split: Split,
    /// A bad file is an error, and not left out.
    pub strict: bool,
    /// Share of the writers that chooses the best epoch.
    pub hold_out: f64,
    /// None is held out.
    pub all_writers: bool,
    /// How to cite the data; usually known for the published sets.
    pub citation: Option<String>,
    pub threads: usize,
    pub resume: bool,
    /// The model's file.
    pub out: PathBuf,
}

/// Steps of a training, shown to people.
pub trait TrainingProgress {
    fn step(&self);
    /// So many steps were done before.
    fn skip(&self, count: usize);
    fn note(&self, line: &str);
}

/// Who watches a training.
pub struct TrainingWatch<'a> {
    pub interrupted: &'a dyn Fn() -> bool,
    pub tell: &'a dyn Fn(&str),
    /// Begins to show so many steps.
    pub progress: &'a dyn Fn(usize) -> Box<dyn TrainingProgress>,
}

/// A finished training: lines for people, and the result; its keys are stable.
#[derive(Debug)]
pub struct TrainingReport {
    pub lines: Vec<String>,
    pub json: Value,
}

/// A training, epoch by epoch.
pub(crate) trait Course {
    /// Steps of the progress in an epoch.
    fn steps(&self) -> usize;
    fn state(&self) -> &TrainState;
    fn is_finished(&self) -> bool;
    fn epoch(&mut self, step: &dyn Fn(), interrupted: &dyn Fn() -> bool) -> Result<Epoch, FitError>;
    /// Scores of the held-out writers, in words.
    fn words(scores: Scores) -> String;
}

/// Goes through at most `epochs` epochs, with a checkpoint after each.
pub(crate) fn completed<C: Course>(
    course: &mut C,
    epochs: usize,
    checkpoint: &CheckpointFile,
    watch: &TrainingWatch<'_>,
) -> Result<(), Failure> {
    // Patience may end it sooner.
    let progress = (watch.progress)(epochs * course.steps());
    progress.skip(course.state().history.len() * course.steps());
    while !course.is_finished() {
        let number = course.state().history.len() + 1;
        let done = course.epoch(&|| progress.step(), watch.interrupted);
        let Epoch { train_loss, held_out, .. } = done.map_err(|error| match error {
            FitError::Interrupted => {
                let remedy = if number > 1 { "continue from the epoch before with --resume" } else { "" };
                Failure::interrupted(format_args!("interrupted in epoch {number}"), remedy)
            }
            FitError::Diverged { .. } => Failure::failed(error, ""),
        })?;
        let held_out = held_out.map_or_else(String::new, |scores| format!(", held out {}", C::words(scores)));
        progress.note(&format!("epoch {number:>3}/{epochs}: loss {train_loss:.5}{held_out}"));
        checkpoint.save(course.state())?;
    }
    Ok(())
}

/// Changes with every word (FNV-1a).
pub(crate) fn fingerprint(words: impl Iterator<Item = u64>) -> u64 {
    words.fold(0xcbf2_9ce4_8422_2325, |hash, word| (hash ^ word).wrapping_mul(0x0100_0000_01b3))
}

impl TrainingOptions {
    /// Where a model comes from, for its metadata: `more`, and the citation of the sets `names`.
    pub(crate) fn notes(
        &self,
        names: &[String],
        more: impl IntoIterator<Item = (&'static str, String)>,
    ) -> BTreeMap<String, String> {
        let mut texts: Vec<&str> = match &self.citation {
            Some(text) => vec![text],
            None => names.iter().filter_map(|name| citation(name)).collect(),
        };
        texts.dedup();
        let cited = (!texts.is_empty()).then(|| ("citation", texts.join("; ")));
        let all = more.into_iter().chain([("split", self.split.to_string())]).chain(cited);
        all.map(|(key, text)| (key.to_owned(), text)).collect()
    }
}
