//! The DyBM against IBM's reference implementation: stored numbers of whole learning runs. Sequence,
//! hyper-parameters and semantics: `fixtures/dybm/*.json`, dumped from the reference used as a black box.

use crate::support::dybm as reference;

use foretrace_control::predict::models::dybm::{
    DybmLearner, DybmSettings, DybmShape, DybmWeights, MAX_DELAY, MAX_TRACES, Optimiser, TraceInput,
    WeightsError,
};
use foretrace_control::predict::{Dybm, OnlineModel, OnlinePredictor, Predictor};
use reference::{close, numbers, pairs, parameters_differ_by, settings, worst};
use serde_json::Value;

const STEP_NS: u64 = 10_000_000;

const FIXTURES: [(&str, &str); 5] = [
    ("adagrad_d2", include_str!("fixtures/dybm/linear_adagrad_d2.json")),
    ("adagrad_d4_k3", include_str!("fixtures/dybm/linear_adagrad_d4_k3.json")),
    ("adagrad_d4_k2_wdelay_l1l2", include_str!("fixtures/dybm/linear_adagrad_d4_k2_wdelay_l1l2.json")),
    ("rmsprop_d3_k1", include_str!("fixtures/dybm/linear_rmsprop_d3_k1.json")),
    ("adam_d3_k1", include_str!("fixtures/dybm/linear_adam_d3_k1.json")),
];

#[test]
fn learning_reproduces_the_reference_step_by_step() {
    for (name, text) in FIXTURES {
        let fixture: Value = serde_json::from_str(text).unwrap();
        let settings = settings(&fixture["meta"]);
        let shape = settings.shape;
        let sequence = pairs(&fixture["sequence"]);
        let mut learner = DybmLearner::new(settings, DybmWeights::zero(STEP_NS, shape)).unwrap();
        let (mut parameters_seen, mut moments_seen) = (0, 0);
        for step in fixture["steps"].as_array().unwrap() {
            let t = step["t"].as_u64().unwrap() as usize;
            let at = format!("{name} pass {} step {t}", step["passno"]);
            if t == 0 {
                learner.reset_state();
            }
            let fifo: Vec<f64> = learner.state().fifo[..shape.fifo_len()].iter().flatten().copied().collect();
            let traces: Vec<f64> = learner.state().traces[..shape.traces].iter().flatten().copied().collect();
            close(&at, "fifo", worst(&numbers(&step["fifo_before"]), &fifo));
            close(&at, "traces", worst(&numbers(&step["e_trace_before"]), &traces));
            let predicted = learner.learn(sequence[t]);
            close(&at, "prediction", worst(&numbers(&step["prediction"]), &predicted));
            if let Some(stored) = step.get("params_after") {
                let own = &learner.weights().parameters;
                close(&at, "parameters", parameters_differ_by(stored, own, &shape));
                parameters_seen += 1;
            }
            if let Some(stored) = step.get("sgd_second_after") {
                close(&at, "G", parameters_differ_by(stored, learner.second_moments(), &shape));
                moments_seen += 1;
            }
            if let Some(stored) = step.get("sgd_first_after") {
                close(&at, "M", parameters_differ_by(stored, learner.first_moments(), &shape));
            }
        }
        assert!(parameters_seen >= 8 && moments_seen >= 8, "{name}: the fixture compares too little");
    }
}

#[test]
fn rollout_reproduces_the_reference_and_leaves_memory_untouched() {
    for (name, text) in FIXTURES {
        let fixture: Value = serde_json::from_str(text).unwrap();
        let settings = settings(&fixture["meta"]);
        let sequence = pairs(&fixture["sequence"]);
        let mut learner = DybmLearner::new(settings, DybmWeights::zero(STEP_NS, settings.shape)).unwrap();
        for step in fixture["steps"].as_array().unwrap() {
            if step["t"] == 0 {
                learner.reset_state();
            }
            learner.learn(sequence[step["t"].as_u64().unwrap() as usize]);
        }
        let mut dybm = Dybm::new(*learner.weights()).unwrap();
        for x in &sequence[..20] {
            dybm.observe(*x);
        }
        let before = *dybm.state();
        let stored = &fixture["rollout_after_reset_and_first_20_inputs"];
        let mut out = [[0.0; 2]; 10];
        dybm.preview(&mut out);
        close(name, "rollout", worst(&numbers(stored), out.as_flattened()));
        assert_eq!(before, *dybm.state(), "{name}: the rollout changed the memory");
    }
}

#[test]
fn one_step_of_learning_agrees_with_a_hand_worked_number() {
    // Delay 2, one trace 0.5, AdaGrad 0.1. First input (3, 0): μ = 0, g_b = (3, 0), G_b = (9, 0), b =
    // 0.1·3/(3 + 1e-6). Second input (5, 0): μ = b, d = 5 − b, g_W = 3·d, so W moves by almost exactly 0.1.
    let shape = DybmShape::new(2, &[0.5], TraceInput::Newest);
    let settings = DybmSettings { shape, optimiser: Optimiser::ada_grad(0.1), l1: 0.0, l2: 0.0 };
    let mut learner = DybmLearner::new(settings, DybmWeights::zero(STEP_NS, shape)).unwrap();
    assert_eq!(learner.learn([3.0, 0.0]), [0.0, 0.0]);
    let bias = 0.3 / (3.0 + 1e-6);
    assert!((learner.weights().parameters.bias[0] - bias).abs() < 1e-15);
    assert!((learner.learn([5.0, 0.0])[0] - bias).abs() < 1e-15);
    let gradient = 3.0 * (5.0 - bias);
    let expected = 0.1 * gradient / (gradient + 1e-6);
    assert!((learner.weights().parameters.fifo[0][0][0] - expected).abs() < 1e-15);
    assert_eq!(learner.state().fifo[0], [5.0, 0.0]);
    assert_eq!(learner.state().traces[0], [6.5, 0.0]);
}

#[test]
fn weights_are_exchanged_without_the_memory_noticing() {
    let shape = DybmShape::new(5, &[0.2, 0.9], TraceInput::Delayed);
    let mut dybm = Dybm::new(DybmWeights::zero(STEP_NS, shape)).unwrap();
    for i in 0..30 {
        dybm.observe([f64::from(i), -0.5 * f64::from(i)]);
    }
    let memory = *dybm.state();
    dybm.set_weights(&DybmWeights::persistent(STEP_NS, shape, 1.0)).unwrap();
    assert_eq!(memory, *dybm.state());
    let mut out = [[0.0; 2]; 3];
    dybm.preview(&mut out);
    assert_eq!(out, [[29.0, -14.5]; 3]);
}

#[test]
fn weights_of_another_loop_are_refused_and_the_old_ones_stay() {
    let shape = DybmShape::new(3, &[0.5], TraceInput::Newest);
    let good = DybmWeights::persistent(STEP_NS, shape, 0.9);
    let mut dybm = Dybm::new(good).unwrap();
    let mut poisoned = good;
    poisoned.parameters.traces[0][1][0] = f64::NAN;
    let mut huge = good;
    huge.parameters.bias[1] = -1e6;
    let mut infinite = good;
    infinite.parameters.fifo[14][0][0] = f64::INFINITY;
    let other_step = DybmWeights { step_ns: 5_000_000, ..good };
    let other_scale = DybmWeights { input_scale: f64::NAN, ..good };
    let other_shape = DybmWeights::zero(STEP_NS, DybmShape::new(4, &[0.5], TraceInput::Newest));
    for bad in [poisoned, huge, infinite, other_step, other_scale, other_shape] {
        assert!(dybm.set_weights(&bad).is_err());
        assert_eq!(*dybm.weights(), good);
    }
    assert!(matches!(dybm.set_weights(&other_step), Err(WeightsError::Step { got_ns: 5_000_000, .. })));
}

#[test]
fn shapes_and_rates_out_of_bounds_are_refused() {
    let newest = TraceInput::Newest;
    for bad in [
        DybmShape::new(1, &[0.5], newest),
        DybmShape::new(MAX_DELAY + 1, &[0.5], newest),
        DybmShape::new(3, &[], newest),
        DybmShape::new(3, &[0.5; MAX_TRACES + 1], newest),
        DybmShape::new(3, &[1.0], newest),
        DybmShape::new(3, &[f64::NAN], newest),
    ] {
        assert!(bad.validate().is_err(), "{bad:?}");
    }
    DybmShape::new(MAX_DELAY, &[0.0, 0.1, 0.5, 0.99], newest).validate().unwrap();
    let shape = DybmShape::new(3, &[0.5], newest);
    for bad in [Optimiser::ada_grad(f64::NAN), Optimiser::adam(-1.0), Optimiser::rms_prop(f64::INFINITY)] {
        assert!(DybmSettings { shape, optimiser: bad, l1: 0.0, l2: 0.0 }.validate().is_err(), "{bad:?}");
    }
    let ok = Optimiser::ada_grad(0.1);
    assert!(DybmSettings { shape, optimiser: ok, l1: -1.0, l2: 0.0 }.validate().is_err());
    assert!(DybmSettings { shape, optimiser: ok, l1: 0.0, l2: f64::NAN }.validate().is_err());
}
