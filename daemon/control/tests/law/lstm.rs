//! The LSTM predictor: fast cells against the plain equations, roll-outs, bounds, and what is refused.
//! PyTorch's numbers are compared in `config/tests/files/models.rs`, where files can be read.

use std::sync::Arc;

use foretrace_control::predict::models::lstm::{
    FADE, HIDDEN_SIZES, LstmError, LstmSpec, LstmState, LstmTensors, LstmWeights, Precision,
};
use foretrace_control::predict::{Lstm, Predictor};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const STEP_NS: u64 = 5_000_000;

fn spec(hidden: usize) -> LstmSpec {
    LstmSpec::plain(hidden, 10.0, STEP_NS)
}

/// Weights like a trained network's: uniform within ±0.5.
fn tensors(spec: &LstmSpec, seed: u64) -> LstmTensors {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut tensors = LstmTensors::zero(spec.hidden, spec.leads);
    for value in tensors.all_mut().into_iter().flatten() {
        *value = random.random_range(-0.5..0.5);
    }
    tensors
}

fn weights(spec: LstmSpec, seed: u64) -> Arc<LstmWeights> {
    Arc::new(LstmWeights::new(spec, tensors(&spec, seed)).unwrap())
}

fn pen(seed: u64, steps: usize) -> Vec<[f64; 2]> {
    let mut random = Pcg64::seed_from_u64(seed);
    (0..steps).map(|_| [random.random_range(-25.0..25.0), random.random_range(-25.0..25.0)]).collect()
}

/// The plain equations rolled out from `state`.
fn plain_roll_out(weights: &LstmWeights, mut state: LstmState, steps: usize) -> Vec<[f64; 2]> {
    let mut out = Vec::new();
    for _ in 0..steps {
        let next = weights.output(&state, 1).unwrap();
        weights.step(&mut state, next);
        out.push(next);
    }
    out
}

fn worst(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn fast_cells_agree_with_the_plain_equations() {
    // Single precision has 24 bits and forgets its errors; the roll-out feeds them back ten times (units of
    // RMS 10).
    for (precision, state_tolerance, path_tolerance) in
        [(Precision::Double, 1e-13, 1e-11), (Precision::Single, 2e-6, 2e-4)]
    {
        for hidden in HIDDEN_SIZES {
            for (clip, residual) in [(None, false), (Some(1.5), true)] {
                let spec = LstmSpec { input_clip: clip, residual, ..spec(hidden) };
                let weights = weights(spec, 7);
                let mut fast = Lstm::with_precision(weights.clone(), precision);
                let mut state = LstmState::empty();
                for x in pen(1, 200) {
                    fast.observe(x);
                    weights.step(&mut state, x);
                    assert!(
                        worst(fast.hidden(), &state.h[..hidden]) < state_tolerance,
                        "{precision:?} {hidden}"
                    );
                    assert!(worst(&fast.state().c, &state.c) < state_tolerance);
                }
                let mut rolled = [[0.0; 2]; 10];
                fast.preview(&mut rolled);
                let plain = plain_roll_out(&weights, state, 10);
                assert!(worst(rolled.as_flattened(), plain.as_flattened()) < path_tolerance);
            }
        }
    }
}

#[test]
fn direct_leads_agree_with_the_plain_equations_and_fade_beyond_the_last() {
    for hidden in HIDDEN_SIZES {
        let weights = weights(LstmSpec { leads: 24, residual: true, ..spec(hidden) }, 3);
        let mut fast = Lstm::with_precision(weights.clone(), Precision::Double);
        let mut state = LstmState::empty();
        for x in pen(2, 50) {
            fast.observe(x);
            weights.step(&mut state, x);
        }
        let mut out = [[f64::NAN; 2]; 30];
        fast.preview(&mut out);
        for (lead, predicted) in (1..=24).zip(&out) {
            assert!(worst(predicted, &weights.output(&state, lead).unwrap()) < 1e-12);
        }
        assert_eq!(weights.output(&state, 25), None);
        for pair in out[23..].windows(2) {
            assert!(worst(&pair[1], &pair[0].map(|x| x * FADE)) < 1e-12);
        }
        // Fewer than the network gives.
        let mut few = [[f64::NAN; 2]; 5];
        fast.preview(&mut few);
        assert_eq!(few, out[..5]);
    }
}

#[test]
fn preview_leaves_the_memory_as_it_was_and_reset_empties_it() {
    for leads in [1, 8] {
        let mut lstm = Lstm::new(weights(LstmSpec { leads, ..spec(32) }, 5));
        let fresh = lstm.state();
        assert_eq!(fresh, LstmState::empty());
        for x in pen(3, 30) {
            lstm.observe(x);
        }
        let before = lstm.state();
        let (mut first, mut second) = ([[0.0; 2]; 20], [[0.0; 2]; 20]);
        lstm.preview(&mut first);
        assert_eq!(lstm.state(), before);
        lstm.preview(&mut second);
        assert_eq!(first, second);
        lstm.reset();
        assert_eq!(lstm.state(), fresh);
        assert!(lstm.hidden().iter().all(|h| *h == 0.0));
    }
}

#[test]
fn cloned_predictors_remember_apart() {
    let mut one = Lstm::new(weights(spec(10), 5));
    let other = one.clone();
    one.observe([3.0, 4.0]);
    assert_ne!(one.state(), other.state());
    assert_eq!(other.state(), LstmState::empty());
}

#[test]
fn no_predicted_displacement_exceeds_the_limit_and_the_limited_one_is_fed_back() {
    for leads in [1, 12] {
        // Large output weights: the free roll-out is much longer than the limit.
        let spec = LstmSpec { leads, ..spec(10) };
        let mut tensors = tensors(&spec, 9);
        tensors.out_weight.iter_mut().for_each(|w| *w *= 100.0);
        let weights = Arc::new(LstmWeights::new(spec, tensors).unwrap());
        let mut lstm = Lstm::exact(weights.clone());
        for x in pen(4, 20) {
            lstm.observe(x);
        }
        let mut state = lstm.state();
        let mut out = [[0.0; 2]; 16];
        lstm.preview_within(12.0, &mut out);
        assert!(out.iter().all(|x| x[0].hypot(x[1]) <= 12.0 * (1.0 + 1e-12)));
        assert!(out.iter().any(|x| x[0].hypot(x[1]) > 11.9), "the limit was never reached: {out:?}");
        if leads == 1 {
            for predicted in out {
                let free = weights.output(&state, 1).unwrap();
                let long = free[0].hypot(free[1]);
                let limited = free.map(|x| x * (12.0 / long).min(1.0));
                assert!(worst(&predicted, &limited) < 1e-9);
                weights.step(&mut state, predicted);
            }
        }
    }
}

#[test]
fn hostile_inputs_never_reach_the_memory() {
    for hidden in HIDDEN_SIZES {
        for residual in [false, true] {
            let mut lstm = Lstm::new(weights(LstmSpec { residual, ..spec(hidden) }, 1));
            lstm.observe([1.0, 2.0]);
            let before = lstm.state();
            for x in [[f64::NAN, 0.0], [0.0, f64::INFINITY], [f64::NEG_INFINITY, f64::NAN]] {
                lstm.observe(x);
                assert_eq!(lstm.state(), before);
            }
            for x in [[f64::MAX, f64::MIN], [1e300, 1e-300], [-f64::MAX, 5e-324]] {
                lstm.observe(x);
                let mut out = [[0.0; 2]; 64];
                lstm.preview(&mut out);
                assert!(out.as_flattened().iter().all(|x| x.is_finite()));
            }
        }
    }
}

#[test]
fn inputs_beyond_the_clip_count_as_the_clip() {
    let weights = weights(LstmSpec { input_clip: Some(4.0), ..spec(10) }, 2);
    let (mut far, mut at) = (Lstm::new(weights.clone()), Lstm::new(weights));
    far.observe([1000.0, -41.0]);
    at.observe([40.0, -40.0]);
    assert_eq!(far.state(), at.state());
}

#[test]
fn scaling_inputs_and_input_scale_together_scales_the_output() {
    let small = LstmSpec { input_scale: 0.5, ..spec(32) };
    let weights_small = Arc::new(LstmWeights::new(small, tensors(&small, 4)).unwrap());
    let (mut large, mut small) = (Lstm::new(weights(spec(32), 4)), Lstm::new(weights_small));
    for x in pen(5, 30) {
        large.observe(x);
        small.observe(x.map(|x| x / 20.0));
    }
    let (mut a, mut b) = ([[0.0; 2]; 5], [[0.0; 2]; 5]);
    large.preview(&mut a);
    small.preview(&mut b);
    // Division by 10 and by 0.5 round differently in single precision.
    assert!(worst(a.as_flattened(), &b.as_flattened().iter().map(|x| x * 20.0).collect::<Vec<_>>()) < 1e-4);
}

#[test]
fn what_does_not_fit_is_refused() {
    let refused =
        |spec: LstmSpec| LstmWeights::new(spec, LstmTensors::zero(spec.hidden, spec.leads)).unwrap_err();
    assert_eq!(refused(spec(11)), LstmError::Hidden { got: 11 });
    assert_eq!(
        refused(spec(11)).to_string(),
        "the LSTM has 11 cells, compiled are 10, 32 and 64: train one of these sizes"
    );
    for leads in [0, 65] {
        assert_eq!(refused(LstmSpec { leads, ..spec(10) }), LstmError::Leads { got: leads });
    }
    for input_scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = refused(LstmSpec { input_scale, ..spec(10) });
        assert!(matches!(error, LstmError::Range { name: "input_scale", .. }), "{error}");
    }
    for clip in [0.0, f64::NAN, 1e6] {
        let error = refused(LstmSpec { input_clip: Some(clip), ..spec(10) });
        assert!(matches!(error, LstmError::Range { name: "input_clip", .. }), "{error}");
    }
    assert!(matches!(refused(LstmSpec { step_ns: 0, ..spec(10) }), LstmError::Range { name: "step_ns", .. }));

    let spec = spec(10);
    for index in 0..6 {
        let mut short = LstmTensors::zero(10, 1);
        short.all_mut()[index].pop();
        assert!(matches!(LstmWeights::new(spec, short), Err(LstmError::Length { .. })));
        for poison in [f64::NAN, f64::INFINITY, -1001.0] {
            let mut poisoned = LstmTensors::zero(10, 1);
            *poisoned.all_mut()[index].last_mut().unwrap() = poison;
            assert!(matches!(LstmWeights::new(spec, poisoned), Err(LstmError::Magnitude { .. })));
        }
    }
}

#[test]
fn loop_of_another_step_or_scale_is_refused() {
    let made = weights(spec(10), 1);
    assert_eq!(made.fits(STEP_NS), Ok(()));
    assert_eq!(
        made.fits(10_000_000).unwrap_err().to_string(),
        "the LSTM was trained at a step of 5000000 ns, the loop runs at 10000000 ns: take a model for this \
         step, or train one"
    );
    let raw = weights(LstmSpec { input_scale: 2.3, ..spec(10) }, 1);
    assert_eq!(raw.fits(STEP_NS), Err(LstmError::LoopScale { got: 2.3, wanted: 10.0 }));
}
