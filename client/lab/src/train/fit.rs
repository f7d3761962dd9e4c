//! A whole training: epochs, held-out scores, the best parameters so far.
//!
//! Contract: everything random is drawn from (seed, epoch, index), so a training continued from any epoch is
//! the same bit for bit as one that was never interrupted. After a diverged epoch the state is that before
//! it.

use std::ops::ControlFlow;
use std::sync::Arc;

use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_pcg::Pcg64;

use super::adam::{Adam, AdamSettings, Schedule, limit_norm};
use super::augment::Augment;
use super::corpus::Strokes;
use super::engine::{Engine, Scores, Setup};

/// How a network is trained.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainPlan {
    /// Learning rate over the steps.
    pub schedule: Schedule,
    /// Passes over the train sequences.
    pub epochs: usize,
    /// Sequences per step of Adam.
    pub batch: usize,
    /// Decides start, order and augmentation.
    pub seed: u64,
    pub limit_norm: Option<f64>,
    /// Changed copies of the sequences.
    pub augment: Augment,
    /// Augmented rates keep the displacement per step (normalised units).
    pub keep_speed: bool,
    /// Ends after as many epochs without a better held-out loss.
    pub patience: Option<usize>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Epoch {
    /// Rate of its last step.
    pub rate: f64,
    /// Mean objective over its batches, while learning.
    pub train_loss: f64,
    /// On the held-out sequences, after it.
    pub held_out: Option<Scores>,
}

/// Everything that a training continues from.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainState {
    pub parameters: Vec<f32>,
    pub adam: Adam<f32>,
    /// Finished epochs, in order.
    pub history: Vec<Epoch>,
    /// Epoch (from 0) and parameters with the smallest held-out loss.
    pub best: Option<(usize, Vec<f32>)>,
}

impl TrainState {
    /// Before the first epoch.
    pub(super) fn new(parameters: Vec<f32>) -> Self {
        let adam = Adam::new(AdamSettings::default(), parameters.len());
        Self { parameters, adam, history: Vec::new(), best: None }
    }

    /// The best parameters with their epoch, counted from 0; without a held-out set the newest.
    pub(super) fn outcome(&self) -> (usize, &[f32]) {
        match &self.best {
            Some((epoch, parameters)) => (*epoch, parameters),
            None => (self.history.len().saturating_sub(1), &self.parameters),
        }
    }

    /// Takes over an epoch with what it left.
    pub(super) fn conclude(&mut self, epoch: Epoch, parameters: Vec<f32>, adam: Adam<f32>) -> Epoch {
        if let Some(scores) = epoch.held_out {
            let best = self.best.as_ref().and_then(|(epoch, _)| self.history[*epoch].held_out);
            if best.is_none_or(|best| scores.loss < best.loss) {
                self.best = Some((self.history.len(), parameters.clone()));
            }
        }
        self.history.push(epoch);
        self.parameters = parameters;
        self.adam = adam;
        epoch
    }
}

/// A parameter that is not finite after epoch `number`, counted from 0, is a diverged training.
pub(super) fn check_finite(parameters: &[f32], number: usize) -> Result<(), FitError> {
    match parameters.iter().find(|p| !p.is_finite()) {
        Some(wrong) => Err(FitError::Diverged { epoch: number + 1, loss: f64::from(*wrong) }),
        None => Ok(()),
    }
}

/// Why an epoch did not end well.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// A loss or parameter is NaN or infinite.
    #[error(
        "training diverged in epoch {epoch}: the loss is {loss}; lower --rate, or limit gradients \
         (--limit-norm 1)"
    )]
    Diverged {
        /// From 1.
        epoch: usize,
        /// As it came out.
        loss: f64,
    },
    /// The watcher wanted to end.
    #[error("interrupted")]
    Interrupted,
}

/// A training under way.
pub struct Fit {
    plan: TrainPlan,
    engine: Engine<f32>,
    train: Arc<Vec<Strokes>>,
    held_out: Arc<Vec<Strokes>>,
    state: TrainState,
}

impl Fit {
    /// Before the first epoch, or where `state` left off.
    #[must_use]
    pub fn new(
        plan: TrainPlan,
        setup: Setup,
        (train, held_out): (Vec<Strokes>, Vec<Strokes>),
        threads: usize,
        state: Option<TrainState>,
    ) -> Self {
        let shape = setup.network.shape;
        let state =
            state.unwrap_or_else(|| TrainState::new(shape.initial(&mut Pcg64::seed_from_u64(plan.seed))));
        let engine = Engine::new(setup, threads);
        Self { plan, engine, train: Arc::new(train), held_out: Arc::new(held_out), state }
    }

    /// What the training would continue from.
    #[must_use]
    pub fn state(&self) -> &TrainState {
        &self.state
    }

    /// All epochs are done, or held-out scores have not improved for too long.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        let done = self.state.history.len();
        let waited = self.state.best.as_ref().map_or(0, |(epoch, _)| done - 1 - epoch);
        done >= self.plan.epochs || self.plan.patience.is_some_and(|patience| waited >= patience)
    }

    /// The parameters to keep and the epoch (from 0) that they are of: the best on held-out writers, else the
    /// last.
    #[must_use]
    pub fn outcome(&self) -> (usize, &[f32]) {
        self.state.outcome()
    }

    /// Real steps of one epoch, augmentation aside.
    #[must_use]
    pub fn steps_per_epoch(&self) -> usize {
        self.train.iter().map(|s| s.v.len()).sum()
    }

    /// Batches of one epoch.
    #[must_use]
    pub fn batches_per_epoch(&self) -> usize {
        self.train.len().div_ceil(self.plan.batch)
    }

    /// One epoch; calls `watch` after each batch, which may end the epoch and leave the state as it was
    /// before.
    ///
    /// # Errors
    /// [`FitError`]: diverged or interrupted; the state is that before the epoch.
    pub fn epoch(&mut self, mut watch: impl FnMut() -> ControlFlow<()>) -> Result<Epoch, FitError> {
        let number = self.state.history.len();
        let corpus = self.augmented(number);
        let mut order: Vec<usize> = (0..corpus.len()).collect();
        order.shuffle(&mut Pcg64::seed_from_u64(mixed(self.plan.seed, number as u64 + 1, u64::MAX)));
        let total = (self.plan.epochs * self.batches_per_epoch()) as u64;
        let mut parameters = self.state.parameters.clone();
        let mut adam = self.state.adam.clone();
        let mut gradient = vec![0.0; parameters.len()];
        let (mut losses, mut rate) = (0.0, 0.0);
        for batch in order.chunks(self.plan.batch.max(1)) {
            let loss = self.engine.gradient(&parameters, &corpus, batch, &mut gradient);
            if let Some(limit) = self.plan.limit_norm {
                limit_norm(&mut gradient, limit);
            }
            rate = self.plan.schedule.rate(adam.step, total);
            adam.update(rate, &mut parameters, &gradient);
            losses += loss;
            if !losses.is_finite() {
                return Err(FitError::Diverged { epoch: number + 1, loss: losses });
            }
            if watch().is_break() {
                return Err(FitError::Interrupted);
            }
        }
        check_finite(&parameters, number)?;
        let all: Vec<usize> = (0..self.held_out.len()).collect();
        let held_out = (!all.is_empty()).then(|| self.engine.scores(&parameters, &self.held_out, &all));
        let train_loss = losses / self.batches_per_epoch().max(1) as f64;
        Ok(self.state.conclude(Epoch { rate, train_loss, held_out }, parameters, adam))
    }

    /// This epoch's copies of the train sequences.
    fn augmented(&self, epoch: usize) -> Arc<Vec<Strokes>> {
        let TrainPlan { augment, keep_speed, seed, .. } = &self.plan;
        if augment.is_off() {
            return self.train.clone();
        }
        let unit = self.engine.setup().scale;
        let changed = self.train.iter().enumerate().map(|(index, strokes)| {
            augment.apply(strokes, unit, *keep_speed, mixed(*seed, epoch as u64 + 1, index as u64))
        });
        Arc::new(changed.collect())
    }
}

/// A seed of its own for each (epoch, index): three rounds of SplitMix64's finaliser.
pub(super) fn mixed(seed: u64, epoch: u64, index: u64) -> u64 {
    [epoch, index].into_iter().fold(stirred(seed), |state, word| stirred(state ^ stirred(word)))
}

fn stirred(word: u64) -> u64 {
    let mut z = word.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
