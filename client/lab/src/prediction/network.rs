//! LSTMs in the tables: shipped ones and those in files.
//!
//! Which displacements a network wants stands in its metadata key `units`: `raw`, those of the device it was
//! trained on, with `input_scale` their RMS; or `normalised`, those of the loop's running scale. Without the
//! key it gets the set's raw units whatever their size. `reset_beyond`: the state is forgotten before inputs
//! longer than this many `input_scale`.

use foretrace_config::models::LstmModel;
use foretrace_control::pen::TARGET_RMS;
use foretrace_control::predict::{Lstm, Predictor};

use super::model::Contestant;
use super::registry::{REFERENCE_MOVING_RMS, REFERENCE_RMS, Setting, fitted};

/// An LSTM with the reset rule it was trained by.
#[derive(Debug, Clone)]
struct GatedLstm {
    lstm: Lstm,
    /// Longest input that continues a stroke \[units of its inputs\].
    longest: f64,
}

impl Contestant for GatedLstm {
    fn start_sequence(&mut self) {
        self.lstm.reset();
    }

    fn observe(&mut self, v: [f64; 2]) {
        if v[0].hypot(v[1]) > self.longest {
            self.lstm.reset();
        }
        self.lstm.observe(v);
    }

    fn preview(&self, out: &mut [[f64; 2]]) {
        self.lstm.preview(out);
    }
}

/// The network of `model` for a set; `notes` hear how it is used.
pub(super) fn network(model: &LstmModel, setting: &Setting, notes: &mut Vec<String>) -> Box<dyn Contestant> {
    let spec = *model.weights.spec();
    let note = |key: &str| model.notes.get(key).map(|text| text.trim());
    let gate = note("reset_beyond").and_then(|text| text.parse::<f64>().ok());
    let longest = gate.map_or(f64::INFINITY, |gate| gate * spec.input_scale);
    // The tables are compared to the last digits.
    let network = GatedLstm { lstm: Lstm::exact(model.weights.clone()), longest };
    let [trained, here] = [spec.step_ns as f64, setting.step_ns].map(|ns| ns * 1e-6);
    if !((here / trained - 1.0).abs() <= 0.01) {
        notes.push(format!("trained on steps of {trained:.4} ms, used on steps of {here:.4} ms"));
    }
    match note("units") {
        Some("normalised") => fitted(network, false, TARGET_RMS, notes),
        Some(_) => {
            let moving = spec.input_scale * REFERENCE_MOVING_RMS / REFERENCE_RMS;
            fitted(network, setting.is_about(spec.input_scale), moving, notes)
        }
        None => Box::new(network),
    }
}
