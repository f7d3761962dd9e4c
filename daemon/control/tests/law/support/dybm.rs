//! Reading the stored runs of IBM's reference implementation (`fixtures/dybm/*.json`).

use foretrace_control::predict::models::dybm::{DybmSettings, DybmShape, Optimiser, Parameters, TraceInput};
use serde_json::Value;

/// The reference sums in another order; parameters reach about 10.
const TOLERANCE: f64 = 1e-9;

pub(crate) fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        other => vec![other.as_f64().unwrap_or_else(|| panic!("not a number: {other}"))],
    }
}

pub(crate) fn pairs(value: &Value) -> Vec<[f64; 2]> {
    value.as_array().unwrap().iter().map(|pair| numbers(pair).try_into().unwrap()).collect()
}

pub(crate) fn settings(meta: &Value) -> DybmSettings {
    let number = |key: &str| meta[key].as_f64().unwrap_or_else(|| panic!("meta.{key} missing"));
    let optimiser = match meta["optimizer"].as_str().unwrap() {
        "AdaGrad" => Optimiser::AdaGrad { rate: number("rate"), delta: number("delta") },
        "RMSProp" => {
            Optimiser::RmsProp { rate: number("rate"), gamma: number("gamma"), delta: number("delta") }
        }
        "ADAM" => Optimiser::Adam {
            rate: number("rate"),
            beta: number("beta"),
            gamma: number("gamma"),
            epsilon: number("epsilon"),
        },
        other => panic!("optimiser {other}"),
    };
    let trace_input = match meta["insert_to_etrace"].as_str().unwrap() {
        "wo_delay" => TraceInput::Newest,
        "w_delay" => TraceInput::Delayed,
        other => panic!("insert_to_etrace {other}"),
    };
    let delay = meta["delay"].as_u64().unwrap() as usize;
    let shape = DybmShape::new(delay, &numbers(&meta["decay_rates"]), trace_input);
    DybmSettings { shape, optimiser, l1: number("L1"), l2: number("L2") }
}

/// Largest difference between stored and own numbers, as flat lists of the same length.
pub(crate) fn worst(stored: &[f64], own: &[f64]) -> f64 {
    assert_eq!(stored.len(), own.len(), "different sizes");
    stored.iter().zip(own).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

pub(crate) fn parameters_differ_by(stored: &Value, own: &Parameters, shape: &DybmShape) -> f64 {
    let fifo: Vec<f64> = own.fifo[..shape.fifo_len()].iter().flatten().flatten().copied().collect();
    let traces: Vec<f64> = own.traces[..shape.traces].iter().flatten().flatten().copied().collect();
    worst(&numbers(&stored["b"]), &own.bias)
        .max(worst(&numbers(&stored["W"]), &fifo))
        .max(worst(&numbers(&stored["V"]), &traces))
}

pub(crate) fn close(name: &str, what: &str, difference: f64) {
    assert!(difference <= TOLERANCE, "{name}: {what} is off by {difference:e}");
}
