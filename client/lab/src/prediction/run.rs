//! Models against a set: training passes, previews of every step, times, and the rows of a table.

use std::collections::BTreeMap;
use std::time::Instant;

use foretrace_sim::spread::median;
use serde::Serialize;

use super::model::Contestant;
use super::registry::{CONSTANT_VELOCITY, LSTM_REFERENCE, Model, RegistryError, Setting};
use super::score::{HORIZON, LEADS, Tally, share_below};
use super::{CharacterSequence, Set};
use crate::parallel;

/// What a model did on a set.
#[derive(Debug, Clone)]
pub struct Run {
    pub model: String,
    /// Errors per sequence, in the order of the set.
    pub tallies: Vec<Tally>,
    /// Observing (learning included) and previewing 10 steps, for each sequence \[µs per step\].
    pub times_us: Vec<f64>,
    /// One training pass, mean over the passes made here \[s\].
    pub train_s_per_epoch: Option<f64>,
    /// Notes on this row.
    pub note: Option<String>,
}

impl Run {
    /// MSE of every sequence \[raw units²\].
    #[must_use]
    pub fn per_sequence(&self) -> Vec<f64> {
        self.tallies.iter().map(|t| t.mse().unwrap_or(f64::NAN)).collect()
    }

    /// Median over sequences of their times \[µs per step\].
    #[must_use]
    pub fn us_per_step(&self) -> Option<f64> {
        median(self.times_us.iter().copied())
    }

    #[must_use]
    pub fn pooled(&self) -> Tally {
        self.tallies.iter().fold(Tally::default(), |mut sum, tally| {
            sum.merge(tally);
            sum
        })
    }
}

/// One row of a table; `null` in JSON where unknown or not a number.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the model.
    pub model: String,
    /// Mean squared error one step ahead \[raw units²\].
    pub mse: Option<f64>,
    /// The same within strokes.
    pub within: Option<f64>,
    /// Median over sequences of their MSE.
    pub median: Option<f64>,
    /// Sequences below constant velocity \[%\].
    pub ps_b: Option<f64>,
    /// Sequences below the reference LSTM(10) \[%\].
    pub ps_lstm: Option<f64>,
    /// Displacement error at 1, 2, 5 and 10 steps \[raw units²\].
    pub vel_mse: ByLead,
    /// Position error at 1, 2, 5 and 10 steps \[raw units²\].
    pub pos_mse: ByLead,
    /// RMS of the 2-D position error after 10 steps without a jump \[mm\].
    pub rms_mm_10: Option<f64>,
    /// Observing, learning included, and previewing 10 steps \[µs\].
    pub us_per_step: Option<f64>,
    /// One training pass \[s\].
    pub train_s_per_epoch: Option<f64>,
}

/// Values at 1, 2, 5 and 10 steps.
pub type ByLead = BTreeMap<Lead, Option<f64>>;

/// A lead in steps; text as the key of JSON objects, ordered as a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(transparent)]
pub struct Lead(pub usize);

impl Row {
    /// The row of `run`, compared with the baseline's and the reference LSTM's errors per sequence.
    #[must_use]
    pub fn of(run: &Run, baseline: Option<&[f64]>, lstm: Option<&[f64]>) -> Self {
        let errors = run.per_sequence();
        let pooled = run.pooled();
        let by_lead = |means: &[super::score::Mean; 4]| {
            LEADS.iter().zip(means).map(|(lead, mean)| (Lead(*lead), mean.get())).collect()
        };
        Self {
            model: run.model.clone(),
            mse: pooled.mse(),
            within: pooled.within.get(),
            median: median(errors.iter().copied()),
            ps_b: baseline.and_then(|b| share_below(&errors, b)),
            ps_lstm: lstm.and_then(|l| share_below(&errors, l)),
            vel_mse: by_lead(&pooled.velocity),
            pos_mse: by_lead(&pooled.position),
            rms_mm_10: pooled.clean_mm2.get().map(f64::sqrt),
            us_per_step: run.us_per_step(),
            train_s_per_epoch: run.train_s_per_epoch,
        }
    }
}

/// Trains and scores `models` on `set`, one thread per model; calls `done` after every sequence trained on or
/// scored.
///
/// Constant velocity and the reference LSTM(10) run in any case, for PS-B and PS-LSTM; they get rows only
/// where chosen.
///
/// # Errors
/// A model that cannot be built for this set.
pub fn score(models: &[Model], set: &Set, done: &(dyn Fn() + Sync)) -> Result<Scored, RegistryError> {
    let owned = vec![true; set.scored.len()];
    Ok(Scored::of(runs(models, set, &owned, done)?, models.len()))
}

/// As [`score`], but with errors of the sequences that are `owned` only, and without the rows: those need all
/// sequences.
///
/// # Errors
/// As [`score`].
pub fn runs(
    models: &[Model],
    set: &Set,
    owned: &[bool],
    done: &(dyn Fn() + Sync),
) -> Result<Vec<Run>, RegistryError> {
    let runs = parallel::map(&with_references(models), |model| run(model, set, owned, done), || ());
    runs.into_iter().collect()
}

/// How often `done` is called by [`score`].
#[must_use]
pub fn work(models: &[Model], set: &Set) -> usize {
    let passes = |model: &Model| if set.cold { 0 } else { model.passes() };
    with_references(models).iter().map(|model| set.scored.len() + passes(model) * set.train.len()).sum()
}

/// The chosen models, then those that the others are measured against.
fn with_references(models: &[Model]) -> Vec<Model> {
    let mut jobs = models.to_vec();
    for name in [CONSTANT_VELOCITY, LSTM_REFERENCE] {
        if !jobs.iter().any(|m| m.name() == name) {
            jobs.extend(Model::named(name).ok());
        }
    }
    jobs
}

/// Rows of the chosen models, and the runs behind them (the baselines' last, where they were not chosen).
#[derive(Debug, Clone)]
pub struct Scored {
    /// In the order asked for.
    pub rows: Vec<Row>,
    /// In the same order.
    pub runs: Vec<Run>,
}

impl Scored {
    /// The rows of the first `chosen` of `runs`, which are over all sequences.
    #[must_use]
    pub fn of(runs: Vec<Run>, chosen: usize) -> Self {
        let errors_of = |name: &str| runs.iter().find(|r| r.model == name).map(Run::per_sequence);
        let (baseline, lstm) = (errors_of(CONSTANT_VELOCITY), errors_of(LSTM_REFERENCE));
        let chosen = runs.iter().take(chosen);
        let rows = chosen.map(|r| Row::of(r, baseline.as_deref(), lstm.as_deref())).collect();
        Self { rows, runs }
    }
}

/// Trains one model and scores it on the sequences that are `owned`; those before them it observes.
///
/// # Errors
/// The model cannot be built for this set, or is another program that cannot go on.
pub fn run(model: &Model, set: &Set, owned: &[bool], done: &(dyn Fn() + Sync)) -> Result<Run, RegistryError> {
    let (mut contestant, note) = model.build(&Setting::of(set))?;
    let passes = if set.cold { 0 } else { model.passes() };
    let train_s_per_epoch =
        train(&mut *contestant, &set.train, passes, done).or_else(|| model.train_s_per_epoch());
    let note = with_choice(note, &*contestant);
    let (mut times_us, mut tallies, mut previews) = (Vec::new(), Vec::new(), Vec::new());
    let needed = owned.iter().rposition(|owned| *owned).map_or(0, |last| last + 1);
    for (sequence, owned) in set.scored.iter().zip(owned).take(needed) {
        if *owned {
            let started = Instant::now();
            preview_all(&mut *contestant, sequence, &mut previews);
            times_us.push(started.elapsed().as_secs_f64() * 1e6 / sequence.v.len().max(1) as f64);
            tallies.push(Tally::of(sequence, &previews));
        } else {
            contestant.start_sequence();
            (0..sequence.v.len()).for_each(|t| take_in(&mut *contestant, sequence, t));
        }
        model.check(&*contestant, sequence)?;
        done();
    }
    (needed..set.scored.len()).for_each(|_| done());
    Ok(Run { model: model.name().to_owned(), tallies, times_us, train_s_per_epoch, note })
}

/// Lets a model observe step `t` of a sequence.
pub(super) fn take_in(contestant: &mut dyn Contestant, sequence: &CharacterSequence, t: usize) {
    let Some(v) = sequence.v.get(t) else { return };
    if sequence.jump.get(t).copied().unwrap_or(false) {
        contestant.new_stroke(*v);
    } else {
        contestant.observe(*v);
    }
}

/// The note of a model from when it was built, with what training chose.
pub(super) fn with_choice(note: Option<String>, contestant: &dyn Contestant) -> Option<String> {
    let notes: Vec<String> = note.into_iter().chain(contestant.trained_note()).collect();
    (!notes.is_empty()).then(|| notes.join("; "))
}

/// Passes over the train sequences, then the end of training; the mean time of one pass \[s\], `None` without
/// any.
pub fn train(
    contestant: &mut dyn Contestant,
    sequences: &[CharacterSequence],
    passes: usize,
    done: &(dyn Fn() + Sync),
) -> Option<f64> {
    let started = Instant::now();
    for _ in 0..passes {
        for sequence in sequences {
            contestant.start_sequence();
            (0..sequence.v.len()).for_each(|t| take_in(&mut *contestant, sequence, t));
            done();
        }
    }
    contestant.end_training();
    (passes > 0 && !sequences.is_empty()).then(|| started.elapsed().as_secs_f64() / passes as f64)
}

/// Walks through a sequence: `previews[t]` is made after v[0..=t]; the last step is observed, too.
pub fn preview_all(
    contestant: &mut dyn Contestant,
    sequence: &CharacterSequence,
    previews: &mut Vec<[[f64; 2]; HORIZON]>,
) {
    previews.clear();
    contestant.start_sequence();
    for index in 0..sequence.v.len() {
        take_in(contestant, sequence, index);
        if index + 1 < sequence.v.len() {
            let mut preview = [[0.0; 2]; HORIZON];
            contestant.preview(&mut preview);
            previews.push(preview);
        }
    }
}
