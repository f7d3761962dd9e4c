//! The cost of training per step, and all data that another implementation needs to repeat the work.
//!
//! The paper's network on given or synthetic sequences, one thread, the same batches in the same order each
//! epoch. Times are per real step: the padding that a batch adds is work, but no steps.

use std::sync::Arc;
use std::time::Instant;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::Serialize;

use super::adam::{Adam, AdamSettings};
use super::corpus::{Strokes, rms};
use super::engine::{Engine, Setup};
use super::recipe::Recipe;

const RATE: f64 = 1e-3;

/// A measured training, repeatable from its own numbers.
#[derive(Debug, Clone, Serialize)]
pub struct Bench {
    /// Cells of the network.
    pub cells: usize,
    /// Sequences per step of Adam.
    pub batch: usize,
    pub rate: f64,
    /// Real steps per epoch.
    pub steps: usize,
    /// Time per real step in each epoch \[us\].
    pub us_per_step: Vec<f64>,
    /// Sequences, inputs already scaled, in the order of the batches; T x 2 each.
    pub sequences: Vec<Vec<[f32; 2]>>,
    /// Parameters at the start, PyTorch's order.
    pub start: Vec<f32>,
    /// Gradient of the first batch, at the start.
    pub first_gradient: Vec<f32>,
    /// Loss of each batch of the first epoch.
    pub losses: Vec<f64>,
    /// Parameters after the first epoch.
    pub after_one_epoch: Vec<f32>,
}

/// Trains for `epochs` epochs (at least one) and one before that is not timed.
#[must_use]
pub fn bench(mut corpus: Vec<Strokes>, cells: usize, batch: usize, epochs: usize, seed: u64) -> Bench {
    let scale = rms(&corpus);
    // The same numbers for both sides, whatever rounds when.
    let scaled = |s: &Strokes| s.v.iter().map(|v| v.map(|x| (x / scale) as f32)).collect::<Vec<_>>();
    let sequences: Vec<Vec<[f32; 2]>> = corpus.iter().map(scaled).collect();
    for (strokes, sequence) in corpus.iter_mut().zip(&sequences) {
        strokes.v = sequence.iter().map(|v| v.map(f64::from)).collect();
    }
    let network = Recipe::Paper.network(cells, 1);
    let setup = Setup { network, objective: Recipe::Paper.objective(1), scale: 1.0 };
    let steps = corpus.iter().map(|s| s.v.len()).sum();
    let start: Vec<f32> = network.shape.initial(&mut Pcg64::seed_from_u64(seed));
    let mut result = Bench {
        cells,
        batch,
        rate: RATE,
        steps,
        us_per_step: Vec::new(),
        sequences,
        start: start.clone(),
        first_gradient: Vec::new(),
        losses: Vec::new(),
        after_one_epoch: Vec::new(),
    };
    let corpus = Arc::new(corpus);
    let order: Vec<usize> = (0..corpus.len()).collect();
    let mut engine = Engine::<f32>::new(setup, 1);
    let mut adam = Adam::new(AdamSettings::default(), start.len());
    let (mut parameters, mut gradient) = (start, vec![0.0; network.shape.count()]);
    for epoch in 0..=epochs.max(1) {
        let begin = Instant::now();
        for chunk in order.chunks(batch.max(1)) {
            let loss = engine.gradient(&parameters, &corpus, chunk, &mut gradient);
            if epoch == 0 {
                if result.losses.is_empty() {
                    result.first_gradient.clone_from(&gradient);
                }
                result.losses.push(loss);
            }
            adam.update(RATE, &mut parameters, &gradient);
        }
        if epoch == 0 {
            result.after_one_epoch.clone_from(&parameters);
        } else {
            result.us_per_step.push(begin.elapsed().as_secs_f64() * 1e6 / steps as f64);
        }
    }
    result
}

/// Made-up strokes with the lengths of recorded characters (about 25 to 250 steps, 72 on average).
#[must_use]
pub fn made_up(count: usize, seed: u64) -> Vec<Strokes> {
    let rng = &mut Pcg64::seed_from_u64(seed);
    let stroke = |rng: &mut Pcg64| {
        let length = (25.0 + 47.0 * -(1.0 - rng.random_range(0.0..1.0_f64)).ln()).min(250.0) as usize;
        let (turn, phase) = (rng.random_range(0.02..0.3), rng.random_range(0.0..6.0));
        let v = (0..length).map(|t| {
            let angle = phase + turn * t as f64;
            let speed = 10.0 * (1.0 + (0.17 * t as f64).sin());
            [
                speed * angle.cos() + rng.random_range(-1.0..1.0),
                speed * angle.sin() + rng.random_range(-1.0..1.0),
            ]
        });
        let v: Vec<[f64; 2]> = v.collect();
        let jump = vec![false; v.len()];
        Strokes::at_rest(v, jump)
    };
    (0..count).map(|_| stroke(rng)).collect()
}
