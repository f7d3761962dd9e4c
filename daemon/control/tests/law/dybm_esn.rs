//! The DyBM with an echo state network against IBM's reference implementation.
//! Parameters, accumulators, memory and predictions of whole learning runs, step by step.

use crate::support::dybm as reference;

use std::sync::Arc;

use foretrace_control::predict::models::dybm::DybmWeights;
use foretrace_control::predict::models::esn::{
    DybmEsn, DybmEsnLearner, DybmEsnSettings, ReadoutRule, Reservoir,
};
use foretrace_control::predict::{OnlineModel, Optimiser, Predictor};
use reference::{close, numbers, pairs, parameters_differ_by, settings, worst};
use serde_json::Value;

const STEP_NS: u64 = 10_000_000;

fn fixture(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

/// `rows` x `columns` numbers, as stored.
fn matrix<const COLUMNS: usize, const ROWS: usize>(value: &Value) -> [[f64; COLUMNS]; ROWS] {
    let rows = value.as_array().unwrap().iter().map(|row| numbers(row).try_into().unwrap());
    rows.collect::<Vec<[f64; COLUMNS]>>().try_into().unwrap()
}

fn memory_matches(at: &str, step: &Value, fifo: &[[f64; 2]], traces: &[[f64; 2]]) {
    close(at, "fifo", worst(&numbers(&step["fifo_before"]), fifo.as_flattened()));
    close(at, "traces", worst(&numbers(&step["e_trace_before"]), traces.as_flattened()));
}

#[test]
fn dybm_with_echo_state_network_reproduces_the_reference() {
    let fixture = fixture(include_str!("fixtures/dybm/linear_esn50_adagrad.json"));
    let (meta, esn) = (&fixture["meta"], &fixture["esn"]);
    let dybm = settings(meta);
    let shape = dybm.shape;
    let sequence = pairs(&fixture["sequence"]);
    let leak = meta["leak"].as_f64().unwrap();
    let reservoir =
        Arc::new(Reservoir::from_matrices(leak, matrix(&esn["W_in"]), matrix(&esn["W_rec"])).unwrap());
    assert!(numbers(&esn["initial_A"]).iter().all(|a| *a == 0.0));
    let readout = Optimiser::ada_grad(meta["esn_rate"].as_f64().unwrap());
    let settings = DybmEsnSettings { dybm, readout, rule: ReadoutRule::OwnError };
    let mut learner =
        DybmEsnLearner::untrained(settings, DybmWeights::zero(STEP_NS, shape), reservoir.clone()).unwrap();
    let mut compared = 0;
    for step in fixture["steps"].as_array().unwrap() {
        let t = step["t"].as_u64().unwrap() as usize;
        let at = format!("pass {} step {t}", step["passno"]);
        if t == 0 {
            learner.reset_state();
        }
        let memory = learner.memory();
        memory_matches(&at, step, &memory.dybm.fifo[..shape.fifo_len()], &memory.dybm.traces[..shape.traces]);
        close(&at, "reservoir", worst(&numbers(&step["esn_state_before"]), &memory.reservoir));
        let contribution = learner.parameters().contribution(memory);
        close(&at, "contribution", worst(&numbers(&step["esn_contribution"]), &contribution));
        let predicted = learner.learn(sequence[t]);
        close(&at, "prediction", worst(&numbers(&step["prediction"]), &predicted));
        if let Some(stored) = step.get("params_after") {
            let weights = learner.parameters();
            close(&at, "parameters", parameters_differ_by(stored, &weights.dybm.parameters, &shape));
            close(&at, "A", worst(&numbers(&step["esn_A_after"]), weights.readout.as_flattened()));
            let moments = &step["sgd_second_after"];
            close(&at, "G", parameters_differ_by(moments, learner.second_moments(), &shape));
            let moments = numbers(&step["esn_sgd_second_after"]);
            close(&at, "G of A", worst(&moments, learner.readout_second_moments().as_flattened()));
            compared += 1;
        }
    }
    assert!(compared >= 8, "the fixture compares too little");
    learner.reset_state();
    let mut predictor = DybmEsn::new(*learner.parameters(), reservoir).unwrap();
    for x in &sequence[..20] {
        learner.observe(*x);
        predictor.observe(*x);
    }
    let before = *predictor.state();
    assert_eq!(before, *learner.memory());
    let (mut exact, mut out) = ([[0.0; 2]; 10], [[0.0; 2]; 10]);
    learner.preview(&mut exact);
    let stored = numbers(&fixture["rollout_after_reset_and_first_20_inputs"]);
    close("esn", "rollout", worst(&stored, exact.as_flattened()));
    Predictor::preview(&predictor, &mut out);
    let difference = worst(&stored, out.as_flattened());
    assert!(difference < 1e-4, "single precision is off by {difference:e}");
    assert_eq!(before, *predictor.state(), "the rollout changed the memory");
}
