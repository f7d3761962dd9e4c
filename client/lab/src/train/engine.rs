//! Gradients and scores of whole batches, the groups of eight sequences shared out to threads.
//!
//! Contract: groups are formed and summed in an order that depends on the batch alone, so results are the
//! same bit for bit for any number of threads and any width of vector instructions.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use multiversion::multiversion;

use super::corpus::Strokes;
use super::group::LaneGroup;
use super::loss::{Objective, Padding, PreparedLoss};
use super::parameters::{LstmNetwork, PackedGradient, PackedWeights};
use super::real::{LANES, Real};

/// The parts of a training that are the same for each batch.
#[derive(Debug, Clone)]
pub struct Setup {
    pub network: LstmNetwork,
    pub objective: Objective,
    /// Raw displacements are divided by this.
    pub scale: f64,
}

/// Errors of the next step over many sequences, per component.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Scores {
    /// The objective, padding masked.
    pub loss: f64,
    /// Mean squared error \[raw units^2\], as the tables' pooled MSE.
    pub mse: f64,
    /// The same without jump targets and the steps right after one.
    pub within: f64,
    /// Of the position at the last lead K, where none of the K steps is a jump \[raw units^2\].
    pub position: f64,
}

/// Sums behind [`Scores`] and a gradient.
#[derive(Debug, Clone, Copy, Default)]
struct ScoreSums {
    loss: f64,
    weight: f64,
    squares: [f64; 3],
    counts: [f64; 3],
}

impl ScoreSums {
    fn add(&mut self, other: &Self) {
        self.loss += other.loss;
        self.weight += other.weight;
        for i in 0..3 {
            self.squares[i] += other.squares[i];
            self.counts[i] += other.counts[i];
        }
    }
}

/// One group's share of a batch.
struct GroupJob<F> {
    corpus: Arc<Vec<Strokes>>,
    lanes: Vec<usize>,
    longest: usize,
    packed: Arc<PackedWeights<F>>,
    /// Takes the gradient; `None`: scores only.
    gradient: Option<PackedGradient<F>>,
    index: usize,
}

struct Done<F> {
    index: usize,
    sums: ScoreSums,
    gradient: Option<PackedGradient<F>>,
}

struct Worker<F> {
    setup: Arc<Setup>,
    /// The objective as scores use it.
    masked: Objective,
    loss: PreparedLoss<F>,
    group: LaneGroup<F>,
}

impl<F: Real> Worker<F> {
    fn new(setup: &Arc<Setup>) -> Self {
        Self {
            setup: setup.clone(),
            masked: Objective { padding: Padding::Masked, ..setup.objective.clone() },
            loss: setup.objective.prepared(),
            group: LaneGroup::new(setup.network.shape),
        }
    }

    fn work(&mut self, mut job: GroupJob<F>) -> Done<F> {
        let Setup { network, objective, scale } = &*self.setup;
        let lanes: Vec<&Strokes> = job.lanes.iter().filter_map(|&i| job.corpus.get(i)).collect();
        let objective = if job.gradient.is_some() { objective } else { &self.masked };
        let weight = self.group.load(network, objective, *scale, &lanes, job.longest);
        let mut sums = ScoreSums { weight, ..ScoreSums::default() };
        if let Some(gradient) = &mut job.gradient {
            gradient.clear();
            sums.loss = descend(&mut self.group, network, &job.packed, &self.loss, gradient);
        } else {
            run(&mut self.group, network, &job.packed);
            self.add_errors(&lanes, &mut sums);
            sums.loss = self.group.score(&self.loss);
        }
        Done { index: job.index, sums, gradient: job.gradient }
    }

    fn add_errors(&self, lanes: &[&Strokes], sums: &mut ScoreSums) {
        let scale = self.setup.scale;
        let leads = self.setup.network.shape.leads;
        let square = |p: [f64; 2], q: [f64; 2]| (p[0] * scale - q[0]).powi(2) + (p[1] * scale - q[1]).powi(2);
        let sum = |steps: &mut dyn Iterator<Item = [f64; 2]>| {
            steps.fold([0.0; 2], |s, v| [s[0] + v[0], s[1] + v[1]])
        };
        for (l, strokes) in lanes.iter().enumerate() {
            for t in 1..strokes.v.len() {
                let error = square(self.group.lead(t - 1, 0, l), strokes.v[t]);
                let within = !strokes.jumps(t) && !strokes.jumps(t - 1);
                let reached =
                    strokes.v.get(t..t + leads).filter(|_| (t..t + leads).all(|s| !strokes.jumps(s)));
                let position = reached.map(|steps| {
                    let predicted = sum(&mut (0..leads).map(|lead| self.group.lead(t - 1, lead, l)));
                    square(predicted, sum(&mut steps.iter().copied()))
                });
                for (kind, value) in [Some(error), within.then_some(error), position].into_iter().enumerate()
                {
                    if let Some(value) = value {
                        sums.squares[kind] += value;
                        sums.counts[kind] += 2.0;
                    }
                }
            }
        }
    }
}

#[multiversion(targets("x86_64+avx+avx2+bmi1+bmi2+lzcnt+popcnt"))]
fn descend<F: Real>(
    group: &mut LaneGroup<F>,
    network: &LstmNetwork,
    packed: &PackedWeights<F>,
    loss: &PreparedLoss<F>,
    gradient: &mut PackedGradient<F>,
) -> f64 {
    group.forward(network, packed);
    let total = group.score(loss);
    group.backward(packed, gradient);
    total
}

#[multiversion(targets("x86_64+avx+avx2+bmi1+bmi2+lzcnt+popcnt"))]
fn run<F: Real>(group: &mut LaneGroup<F>, network: &LstmNetwork, packed: &PackedWeights<F>) {
    group.forward(network, packed);
}

/// Computes gradients and scores of one [`Setup`]; threads live as long as it does.
pub struct Engine<F> {
    setup: Arc<Setup>,
    own: Worker<F>,
    helpers: Vec<(Sender<GroupJob<F>>, JoinHandle<()>)>,
    results: Receiver<Done<F>>,
    packed: Arc<PackedWeights<F>>,
    spare: Vec<PackedGradient<F>>,
}

impl<F: Real> Engine<F> {
    /// An engine on `threads` threads, the caller's among them.
    #[must_use]
    pub fn new(setup: Setup, threads: usize) -> Self {
        let setup = Arc::new(setup);
        let (sender, results) = channel();
        let helpers = (1..threads.max(1))
            .map(|_| {
                let (jobs, inbox) = channel::<GroupJob<F>>();
                let (mut worker, results) = (Worker::new(&setup), sender.clone());
                let thread = std::thread::spawn(move || {
                    for job in inbox {
                        // The receiver is gone: the engine was dropped.
                        if results.send(worker.work(job)).is_err() {
                            return;
                        }
                    }
                });
                (jobs, thread)
            })
            .collect();
        let own = Worker::new(&setup);
        Self { setup, own, helpers, results, packed: Arc::new(PackedWeights::default()), spare: Vec::new() }
    }

    /// The setup it was made for.
    #[must_use]
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The objective on the sequences `batch` of `corpus`, and its gradient into `gradient`.
    pub fn gradient(
        &mut self,
        parameters: &[F],
        corpus: &Arc<Vec<Strokes>>,
        batch: &[usize],
        gradient: &mut [F],
    ) -> f64 {
        let done = self.share_out(parameters, corpus, batch, true);
        gradient.fill(F::default());
        let mut sums = ScoreSums::default();
        for part in done {
            sums.add(&part.sums);
            if let Some(part) = part.gradient {
                part.add_to(self.setup.network.shape, gradient);
                self.spare.push(part);
            }
        }
        // A batch without a single target has neither loss nor gradient.
        let share = if sums.weight > 0.0 { 1.0 / sums.weight } else { 0.0 };
        for g in gradient {
            *g = *g * F::of(share);
        }
        sums.loss * share
    }

    /// Scores over the sequences `chosen` of `corpus`; no gradient.
    pub fn scores(&mut self, parameters: &[F], corpus: &Arc<Vec<Strokes>>, chosen: &[usize]) -> Scores {
        let mut sums = ScoreSums::default();
        for part in self.share_out(parameters, corpus, chosen, false) {
            sums.add(&part.sums);
        }
        let mean = |sum: f64, count: f64| if count > 0.0 { sum / count } else { f64::NAN };
        Scores {
            loss: mean(sums.loss, sums.weight),
            mse: mean(sums.squares[0], sums.counts[0]),
            within: mean(sums.squares[1], sums.counts[1]),
            position: mean(sums.squares[2], sums.counts[2]),
        }
    }

    fn share_out(
        &mut self,
        parameters: &[F],
        corpus: &Arc<Vec<Strokes>>,
        chosen: &[usize],
        with_gradient: bool,
    ) -> Vec<Done<F>> {
        let length = |&i: &usize| corpus.get(i).map_or(0, |s| s.v.len());
        let mut order = chosen.to_vec();
        // Sequences of about the same length share a group: fewer idle lanes.
        order.sort_by_key(|i| std::cmp::Reverse(length(i)));
        let longest = order.first().map_or(0, length);
        Arc::make_mut(&mut self.packed).fill(self.setup.network.shape, parameters);
        let mut done: Vec<Option<Done<F>>> = Vec::new();
        let mut own = Vec::new();
        let mut away = 0;
        for (index, lanes) in order.chunks(LANES).enumerate() {
            let shape = self.setup.network.shape;
            let job = GroupJob {
                corpus: corpus.clone(),
                lanes: lanes.to_vec(),
                longest,
                packed: self.packed.clone(),
                gradient: with_gradient
                    .then(|| self.spare.pop().unwrap_or_else(|| PackedGradient::zero(shape))),
                index,
            };
            done.push(None);
            match index.checked_rem(self.helpers.len() + 1) {
                Some(turn @ 1..) => match self.helpers[turn - 1].0.send(job) {
                    Ok(()) => away += 1,
                    Err(back) => own.push(back.0),
                },
                _ => own.push(job),
            }
        }
        for job in own {
            let part = self.own.work(job);
            let index = part.index;
            done[index] = Some(part);
        }
        for part in self.results.iter().take(away) {
            let index = part.index;
            done[index] = Some(part);
        }
        done.into_iter().flatten().collect()
    }
}

impl<F> Drop for Engine<F> {
    fn drop(&mut self) {
        for (jobs, thread) in self.helpers.drain(..) {
            drop(jobs);
            // A panicked helper sends nothing.
            let _ = thread.join();
        }
    }
}
