//! A whole training of the network: epochs, held-out scores, the best parameters so far.
//!
//! Contract: everything random is drawn from (seed, epoch, index); gradients are summed piece by piece in the
//! order of the batch. So a training continued from any epoch, on any number of threads, is the same bit for
//! bit.

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use foretrace_control::predict::models::foresight::OUTPUTS;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_pcg::Pcg64;

use super::balance;
use super::corpus::{Distortion, Writing};
use super::examples::{Examples, examples};
use super::network::{ForesightShape, LayerBuffers, PIECE, Packed};
use super::score::{ErrorSums, weights};
use super::study::Study;
use crate::train::adam::{Schedule, limit_norm};
use crate::train::fit::{Epoch, FitError, TrainState, check_finite, mixed};

/// Errors beyond this many units of ordinary motion pull no harder.
const HUBER: f32 = 2.0;

/// How a network is trained.
#[derive(Debug, Clone, PartialEq)]
pub struct ForesightPlan {
    /// Learning rate over the steps.
    pub schedule: Schedule,
    /// Passes over the writings.
    pub epochs: usize,
    /// Examples per step of Adam, a multiple of 64.
    pub batch: usize,
    /// Decides start, order and changed copies.
    pub seed: u64,
    /// Step of the grid \[ns\].
    pub step_ns: u64,
    /// What the network sees.
    pub study: Study,
    /// Share of the copies that are changed beyond size and phase.
    pub changed: f64,
    pub limit_norm: f64,
}

/// A training under way.
pub struct ForesightFit {
    plan: ForesightPlan,
    shape: ForesightShape,
    threads: usize,
    train: Vec<Writing>,
    held_out: Examples,
    state: TrainState,
}

impl ForesightFit {
    /// Before the first epoch, or where `state` left off.
    #[must_use]
    pub fn new(
        plan: ForesightPlan,
        (train, held_out): (Vec<Writing>, Vec<Writing>),
        threads: usize,
        state: Option<TrainState>,
    ) -> Self {
        let shape = ForesightShape { inputs: plan.study.inputs() };
        let state =
            state.unwrap_or_else(|| TrainState::new(shape.initial(&mut Pcg64::seed_from_u64(plan.seed))));
        let mut fit =
            Self { plan, shape, threads: threads.max(1), train, held_out: Examples::default(), state };
        (fit.held_out, _) = fit.gathered(&held_out, |_| Distortion::NONE);
        fit
    }

    /// What the training would continue from.
    #[must_use]
    pub fn state(&self) -> &TrainState {
        &self.state
    }

    /// Inputs and number of parameters.
    #[must_use]
    pub fn shape(&self) -> ForesightShape {
        self.shape
    }

    #[must_use]
    pub fn held_out(&self) -> usize {
        self.held_out.len()
    }

    /// All epochs are done.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.state.history.len() >= self.plan.epochs
    }

    /// The parameters to keep and the epoch (from 0) that they are of: the best on held-out writers, else the
    /// last.
    #[must_use]
    pub fn outcome(&self) -> (usize, &[f32]) {
        self.state.outcome()
    }

    /// One epoch; calls `watch` after each batch with the share done, which may end the epoch and leave the
    /// state as it was before.
    ///
    /// # Errors
    /// [`FitError`]: diverged or interrupted; the state is that before the epoch.
    pub fn epoch(&mut self, mut watch: impl FnMut(f64) -> ControlFlow<()>) -> Result<Epoch, FitError> {
        let number = self.state.history.len();
        let ForesightPlan { seed, batch, step_ns, changed, .. } = self.plan;
        let step_s = step_ns as f64 * 1e-9;
        let (corpus, ends) = self.gathered(&self.train, |index| {
            let period_s = 1.0 / self.train[index].rate_hz.max(1.0);
            Distortion::drawn(mixed(seed, number as u64 + 1, index as u64), step_s, period_s, changed)
        });
        let mut order: Vec<usize> = (0..corpus.len()).collect();
        order.shuffle(&mut Pcg64::seed_from_u64(mixed(seed, number as u64 + 1, u64::MAX)));
        self.balance(&mut order, &ends);
        let batch = batch.next_multiple_of(PIECE);
        // How many examples changed copies have differs a little from epoch to epoch.
        let batches = (order.len() / batch).max(1);
        let mut parameters = self.state.parameters.clone();
        let mut adam = self.state.adam.clone();
        let mut engine = GradientEngine::new(self.shape, self.threads, self.plan.study);
        let (mut losses, mut rate, mut done) = (0.0, 0.0, 0);
        for batch in order.chunks(batch).filter(|chunk| chunk.len() >= PIECE) {
            let (loss, gradient) = engine.gradient(&parameters, &corpus, batch);
            limit_norm(gradient, self.plan.limit_norm);
            let progress = number as f64 + (f64::from(done) / batches as f64).min(1.0);
            rate = self.plan.schedule.rate((progress * 1e4) as u64, self.plan.epochs as u64 * 10_000);
            adam.update(rate, &mut parameters, gradient);
            done += 1;
            losses += loss;
            if !losses.is_finite() {
                return Err(FitError::Diverged { epoch: number + 1, loss: losses });
            }
            if watch(f64::from(done) / batches as f64).is_break() {
                return Err(FitError::Interrupted);
            }
        }
        check_finite(&parameters, number)?;
        let held_out =
            (!self.held_out.is_empty()).then(|| engine.tally(&parameters, &self.held_out, step_s).scores());
        let train_loss = losses / f64::from(done.max(1));
        Ok(self.state.conclude(Epoch { rate, train_loss, held_out }, parameters, adam))
    }

    /// Leaves out examples of sets that have more than their share; `ends` are those of the writings.
    fn balance(&self, order: &mut Vec<usize>, ends: &[usize]) {
        let sets: Vec<&str> = self.train.iter().map(|w| w.writer.split('/').next().unwrap_or("")).collect();
        let mut names = sets.clone();
        names.sort_unstable();
        names.dedup();
        let set_of = |example: usize| {
            let writing = ends.partition_point(|end| *end <= example);
            sets.get(writing).and_then(|set| names.binary_search(set).ok()).unwrap_or(0)
        };
        let mut counts = vec![0_usize; names.len()];
        order.iter().for_each(|example| counts[set_of(*example)] += 1);
        let mut left = balance::caps(&counts);
        order.retain(|example| {
            let left = &mut left[set_of(*example)];
            let keeps = *left > 0;
            *left = left.saturating_sub(1);
            keeps
        });
    }

    /// The examples of all `writings`, each changed as `change` says of its index, and where each ends.
    fn gathered(
        &self,
        writings: &[Writing],
        change: impl Fn(usize) -> Distortion + Sync,
    ) -> (Examples, Vec<usize>) {
        let ForesightPlan { step_ns, study, .. } = self.plan;
        let indices: Vec<usize> = (0..writings.len()).collect();
        let parts = in_order(&indices, self.threads, |index| {
            of_writing(&writings[*index], &change(*index), step_ns, &study)
        });
        let (mut all, mut ends) = (Examples::default(), Vec::new());
        for part in parts {
            all.extend(&part);
            ends.push(all.len());
        }
        (all, ends)
    }
}

/// The examples of one writing, changed.
#[must_use]
pub fn of_writing(writing: &Writing, change: &Distortion, step_ns: u64, study: &Study) -> Examples {
    let copies: Vec<_> = writing.sequences.iter().map(|sequence| change.apply(sequence)).collect();
    examples(&copies, step_ns, change.phase_s, study)
}

/// Results of `work` in the order of `jobs`, on so many threads.
pub(super) fn in_order<J: Sync, R: Send>(
    jobs: &[J],
    threads: usize,
    work: impl Fn(&J) -> R + Sync,
) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<Option<R>>> = Mutex::new(jobs.iter().map(|_| None).collect());
    let run = || {
        while let Some((index, job)) = {
            let index = next.fetch_add(1, Ordering::Relaxed);
            jobs.get(index).map(|job| (index, job))
        } {
            let result = work(job);
            if let Ok(mut results) = results.lock() {
                results[index] = Some(result);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.min(jobs.len()) {
            scope.spawn(run);
        }
        run();
    });
    results.into_inner().unwrap_or_default().into_iter().flatten().collect()
}

/// Gradients and scores over the threads.
pub struct GradientEngine {
    shape: ForesightShape,
    threads: usize,
    study: Study,
    packed: Packed,
    gradient: Vec<f32>,
}

/// Loss and gradient of a piece.
struct Piece {
    loss: f64,
    gradient: Vec<f32>,
}

impl GradientEngine {
    /// For networks of `shape` that see what `study` says.
    #[must_use]
    pub fn new(shape: ForesightShape, threads: usize, study: Study) -> Self {
        Self { shape, threads: threads.max(1), study, packed: Packed::default(), gradient: Vec::new() }
    }

    /// Mean loss of a batch and its gradient; examples past the last whole piece are left out.
    pub fn gradient(&mut self, parameters: &[f32], corpus: &Examples, batch: &[usize]) -> (f64, &mut [f32]) {
        self.packed.fill(self.shape, parameters, true);
        let pieces: Vec<&[usize]> = batch.chunks_exact(PIECE).collect();
        let (shape, packed) = (self.shape, &self.packed);
        let rows = (pieces.len() * PIECE).max(1) as f32;
        let parts = in_order(&pieces, self.threads, |piece| {
            let mut bench = LayerBuffers::default();
            let inputs = gather(corpus, piece, shape.inputs);
            let mut slopes = bench.outputs(shape, packed, &inputs).to_vec();
            let loss = differentiate(&mut slopes, corpus, piece, rows);
            let mut gradient = vec![0.0; shape.count()];
            bench.add_gradient(shape, packed, &inputs, &slopes, &mut gradient);
            Piece { loss, gradient }
        });
        self.gradient.clear();
        self.gradient.resize(shape.count(), 0.0);
        let mut loss = 0.0;
        for part in parts {
            loss += part.loss;
            for (sum, number) in self.gradient.iter_mut().zip(part.gradient) {
                *sum += number;
            }
        }
        self.hold_absent();
        (loss, &mut self.gradient)
    }

    /// Weights of inputs that an ablation holds at zero are not learned.
    fn hold_absent(&mut self) {
        let [(_, outputs), ..] = self.shape.layers();
        for absent in self.study.absent() {
            self.gradient[absent * outputs..][..outputs].fill(0.0);
        }
    }

    /// What the network says of every example.
    #[must_use]
    pub fn outputs(&mut self, parameters: &[f32], examples: &Examples) -> Vec<f32> {
        self.packed.fill(self.shape, parameters, false);
        let mut bench = LayerBuffers::default();
        let all: Vec<usize> = (0..examples.len()).collect();
        let mut outputs = Vec::with_capacity(examples.len() * OUTPUTS);
        for piece in all.chunks(PIECE) {
            let inputs = gather(examples, piece, self.shape.inputs);
            let output = bench.outputs(self.shape, &self.packed, &inputs);
            outputs.extend_from_slice(&output[..piece.len() * OUTPUTS]);
        }
        outputs
    }

    /// Errors over `examples` on a grid of `step_s` \[s\].
    #[must_use]
    pub fn tally(&mut self, parameters: &[f32], examples: &Examples, step_s: f64) -> ErrorSums {
        self.packed.fill(self.shape, parameters, false);
        let all: Vec<usize> = (0..examples.len()).collect();
        let pieces: Vec<&[usize]> = all.chunks(PIECE).collect();
        let (shape, packed) = (self.shape, &self.packed);
        let parts = in_order(&pieces, self.threads, |piece| {
            let mut bench = LayerBuffers::default();
            let inputs = gather(examples, piece, shape.inputs);
            let outputs = bench.outputs(shape, packed, &inputs);
            let mut tally = ErrorSums::new(step_s);
            for (output, example) in outputs.as_chunks::<OUTPUTS>().0.iter().zip(*piece) {
                tally.add(output, &examples.targets[*example], examples.known[*example]);
            }
            tally
        });
        let mut sum = ErrorSums::new(step_s);
        parts.iter().for_each(|part| sum.merge(part));
        sum
    }
}

/// Rows of a piece; what is missing at its end stays zero.
fn gather(examples: &Examples, piece: &[usize], width: usize) -> Vec<f32> {
    let mut inputs = Vec::with_capacity(PIECE * width);
    for example in piece {
        inputs.extend_from_slice(&examples.features[example * width..][..width]);
    }
    inputs.resize(PIECE * width, 0.0);
    inputs
}

/// Turns outputs into slopes of the mean loss; returns the piece's part of that loss.
fn differentiate(outputs: &mut [f32], corpus: &Examples, piece: &[usize], rows: f32) -> f64 {
    let weights = weights();
    let mut loss = 0.0;
    for (row, example) in outputs.as_chunks_mut::<OUTPUTS>().0.iter_mut().zip(piece) {
        let known = usize::from(corpus.known[*example]);
        let target = &corpus.targets[*example];
        for (index, (output, target)) in row.iter_mut().zip(target).enumerate() {
            if index / 2 >= known {
                *output = 0.0;
                continue;
            }
            let error = *output - target;
            let pull = error.clamp(-HUBER, HUBER);
            loss += f64::from(weights[index / 2] * pull * (error + error - pull) / rows);
            *output = 2.0 * weights[index / 2] * pull / rows;
        }
    }
    loss
}
