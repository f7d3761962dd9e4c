//! Training against PyTorch's numbers (`fixtures/lstm`), and against finite differences where PyTorch has
//! none stored.

use foretrace_lab::train::{
    Adam, AdamSettings, Engine, LstmNetwork, LstmShape, Objective, Padding, Penalty, Real, Setup, Strokes,
};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde_json::Value;
use std::path::PathBuf;
use std::sync::Arc;

const SHAPE: LstmShape = LstmShape { cells: 10, leads: 1 };

fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../config/tests/files/fixtures/lstm").join(name)
}

fn numbers() -> Value {
    serde_json::from_slice(&std::fs::read(fixture("lstm2-10_linear10-2.json")).unwrap()).unwrap()
}

/// The fixture's weights, exact in `f32`.
fn weights() -> Vec<f64> {
    let bytes = std::fs::read(fixture("lstm2-10_linear10-2.safetensors")).unwrap();
    let (size, rest) = bytes.split_first_chunk::<8>().unwrap();
    let (header, data) = rest.split_at(u64::from_le_bytes(*size) as usize);
    let header: Value = serde_json::from_slice(header).unwrap();
    let of = |name: &str| {
        let [from, to] = [0, 1].map(|i| header[name]["data_offsets"][i].as_u64().unwrap() as usize);
        data[from..to].chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap())))
    };
    SHAPE.tensors().iter().flat_map(|t| of(t.name)).collect()
}

fn flat(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(parts) => parts.iter().flat_map(flat).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

fn parameters(value: &Value) -> Vec<f64> {
    SHAPE.tensors().iter().flat_map(|t| flat(&value[t.name])).collect()
}

fn steps(value: &Value) -> Vec<[f64; 2]> {
    value.as_array().unwrap().iter().map(|p| [p[0].as_f64().unwrap(), p[1].as_f64().unwrap()]).collect()
}

fn paper(padding: Padding) -> Setup {
    Setup {
        network: LstmNetwork { shape: SHAPE, clip: None, residual: false, reset_beyond: None },
        objective: Objective { padding, ..Objective::paper() },
        scale: 1.0,
    }
}

fn loss_and_gradient<F: Real>(setup: &Setup, parameters: &[f64], sequences: &[Strokes]) -> (f64, Vec<f64>) {
    let parameters: Vec<F> = parameters.iter().map(|&p| F::of(p)).collect();
    let mut gradient = vec![F::default(); parameters.len()];
    let all: Vec<usize> = (0..sequences.len()).collect();
    let mut engine = Engine::<F>::new(setup.clone(), 1);
    let loss = engine.gradient(&parameters, &Arc::new(sequences.to_vec()), &all, &mut gradient);
    (loss, gradient.into_iter().map(Real::wide).collect())
}

fn assert_near(found: &[f64], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= tolerance, "{what} {i}: {a} is not {b}");
    }
}

fn check_against_pytorch<F: Real>(tolerance: f64) {
    let (numbers, weights) = (numbers(), weights());
    let single = Strokes::plain(steps(&numbers["single"]["input_sequence"]));
    // The second sequence of the pair has 38 steps, then zeros.
    let mut pair: Vec<Strokes> = numbers["padded_batch"]["sequences"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| Strokes::plain(steps(s)))
        .collect();
    assert!(pair[1].v[38..].iter().all(|v| *v == [0.0; 2]));
    pair[1].v.truncate(38);
    let batch = &numbers["padded_batch"];
    for (padding, sequences, loss, gradient) in [
        (Padding::Counted, vec![single.clone()], &numbers["single"]["loss"], &numbers["single"]["gradients"]),
        (Padding::Masked, vec![single.clone()], &numbers["single"]["loss"], &numbers["single"]["gradients"]),
        (Padding::Counted, pair.clone(), &batch["loss_with_padding"], &batch["gradients_with_padding"]),
        (Padding::Masked, pair.clone(), &batch["loss_masked"], &batch["gradients_masked"]),
    ] {
        let what = format!("{padding:?}, {} sequences", sequences.len());
        let (found, slope) = loss_and_gradient::<F>(&paper(padding), &weights, &sequences);
        assert_near(&[found], &[loss.as_f64().unwrap()], tolerance, &what);
        assert_near(&slope, &parameters(gradient), tolerance, &what);
    }
}

#[test]
fn losses_and_gradients_are_those_of_pytorch() {
    check_against_pytorch::<f64>(1e-12);
    check_against_pytorch::<f32>(1e-6);
}

#[test]
fn three_adam_steps_are_those_of_pytorch() {
    let numbers = numbers();
    let corpus = Arc::new(vec![Strokes::plain(steps(&numbers["single"]["input_sequence"]))]);
    let mut engine = Engine::<f64>::new(paper(Padding::Counted), 1);
    let mut weights = weights();
    let mut adam = Adam::new(AdamSettings::default(), weights.len());
    let mut gradient = vec![0.0; weights.len()];
    for expected in flat(&numbers["adam"]["losses_before_each_step"]) {
        let loss = engine.gradient(&weights, &corpus, &[0], &mut gradient);
        assert_near(&[loss], &[expected], 1e-12, "loss");
        adam.update(1e-3, &mut weights, &gradient);
    }
    assert_near(&weights, &parameters(&numbers["adam"]["parameters_after_3_steps"]), 1e-9, "parameter");
}

/// Synthetic strokes of different lengths with jumps.
fn scribbles(seed: u64, count: usize) -> Vec<Strokes> {
    let mut rng = Pcg64::seed_from_u64(seed);
    (0..count)
        .map(|_| {
            let length = rng.random_range(2..30);
            let (mut v, mut jump) = (Vec::new(), Vec::new());
            for _ in 0..length {
                let leaps = rng.random_range(0..9) == 0;
                let reach = if leaps { 20.0 } else { 2.0 };
                v.push([rng.random_range(-reach..reach), rng.random_range(-reach..reach)]);
                jump.push(leaps);
            }
            Strokes { v, jump }
        })
        .collect()
}

/// Options far from the paper's, all of them at once and singly.
fn variants() -> Vec<Setup> {
    let mut variants = Vec::new();
    for (cells, leads) in [(3, 1), (6, 4), (10, 7)] {
        for clip in [None, Some(0.8)] {
            for residual in [false, true] {
                for (penalty, padding) in
                    [(Penalty::Squared, Padding::Counted), (Penalty::Huber { delta: 0.5 }, Padding::Masked)]
                {
                    for (gate, reset_beyond) in [(None, None), (Some(3.0), Some(3.0))] {
                        variants.push(Setup {
                            network: LstmNetwork {
                                shape: LstmShape { cells, leads },
                                clip,
                                residual,
                                reset_beyond,
                            },
                            objective: Objective {
                                penalty,
                                padding,
                                gate,
                                step: (0..leads).map(|i| 1.0 / (i + 1) as f64).collect(),
                                position: (0..leads)
                                    .map(|i| if leads > 1 { 0.3 + i as f64 } else { 0.0 })
                                    .collect(),
                            },
                            scale: 1.7,
                        });
                    }
                }
            }
        }
    }
    variants
}

#[test]
fn every_option_has_the_gradient_of_its_loss() {
    for (case, setup) in variants().into_iter().enumerate() {
        let sequences = scribbles(case as u64, 11);
        let mut rng = Pcg64::seed_from_u64(99 + case as u64);
        let weights: Vec<f64> = setup.network.shape.initial(&mut rng);
        let (_, gradient) = loss_and_gradient::<f64>(&setup, &weights, &sequences);
        let largest = gradient.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
        assert!(largest > 1e-3, "{setup:?}: nothing to learn");
        // Along random directions: each sees all parameters.
        for _ in 0..3 {
            let direction: Vec<f64> = weights.iter().map(|_| rng.random_range(-1.0..1.0)).collect();
            let at = |h: f64| {
                let moved: Vec<f64> = weights.iter().zip(&direction).map(|(w, d)| w + h * d).collect();
                loss_and_gradient::<f64>(&setup, &moved, &sequences).0
            };
            let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
            let expected: f64 = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();
            assert!(
                (slope - expected).abs() < 1e-6 * largest.max(1.0) * 10.0,
                "{setup:?}: {slope} {expected}"
            );
        }
    }
}

#[test]
fn threads_change_no_bit() {
    let corpus = Arc::new(scribbles(5, 67));
    let all: Vec<usize> = (0..67).collect();
    for setup in [paper(Padding::Counted), variants().pop().unwrap()] {
        let weights: Vec<f32> = setup.network.shape.initial(&mut Pcg64::seed_from_u64(1));
        let results: Vec<(f64, Vec<f32>, _)> = [1, 2, 5]
            .into_iter()
            .map(|threads| {
                let mut engine = Engine::new(setup.clone(), threads);
                let mut gradient = vec![0.0; weights.len()];
                let loss = engine.gradient(&weights, &corpus, &all, &mut gradient);
                (loss, gradient, engine.scores(&weights, &corpus, &all))
            })
            .collect();
        assert_eq!(results[0], results[1]);
        assert_eq!(results[0], results[2]);
    }
}

#[test]
fn scores_are_those_of_the_written_definition() {
    let setup = Setup { scale: 2.0, ..paper(Padding::Counted) };
    let sequences = scribbles(8, 20);
    // A network of zeros predicts zero: its error is the displacement itself.
    let weights = vec![0.0_f32; SHAPE.count()];
    let all: Vec<usize> = (0..20).collect();
    let scores = Engine::new(setup, 2).scores(&weights, &Arc::new(sequences.clone()), &all);
    let (mut squares, mut count, mut within, mut inside) = (0.0, 0.0, 0.0, 0.0);
    for s in &sequences {
        for t in 1..s.v.len() {
            let square = s.v[t][0].powi(2) + s.v[t][1].powi(2);
            (squares, count) = (squares + square, count + 2.0);
            if !s.jump[t] && !s.jump[t - 1] {
                (within, inside) = (within + square, inside + 2.0);
            }
        }
    }
    assert!((scores.mse - squares / count).abs() < 1e-6);
    assert!((scores.within - within / inside).abs() < 1e-6);
    assert!((scores.loss - scores.mse / 4.0).abs() < 1e-5);
}
