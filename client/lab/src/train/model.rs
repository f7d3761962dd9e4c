//! From trained parameters to the file that the loop and the tables load.

use std::collections::BTreeMap;
use std::sync::Arc;

use foretrace_config::models::LstmModel;
use foretrace_control::predict::models::lstm::{LstmError, LstmSpec, LstmTensors, LstmWeights};

use super::engine::Setup;

/// A model of `file` with the parameters of a training at `step_ms`, and `notes` on where it comes from.
///
/// # Errors
/// [`LstmError`]: a size or number that the loop would refuse.
pub fn model(
    file: &str,
    setup: &Setup,
    parameters: &[f32],
    step_ms: f64,
    mut notes: BTreeMap<String, String>,
) -> Result<LstmModel, LstmError> {
    let network = &setup.network;
    let spec = LstmSpec {
        hidden: network.shape.cells,
        leads: network.shape.leads,
        residual: network.residual,
        input_clip: network.clip,
        input_scale: setup.scale,
        step_ns: (step_ms * 1e6).round() as u64,
    };
    let mut tensors = LstmTensors::default();
    for (into, tensor) in tensors.all_mut().into_iter().zip(network.shape.tensors()) {
        *into = parameters.get(tensor.range).unwrap_or_default().iter().map(|&p| f64::from(p)).collect();
    }
    if let Some(gate) = network.reset_beyond {
        notes.insert("reset_beyond".to_owned(), gate.to_string());
    }
    Ok(LstmModel { file: file.to_owned(), weights: Arc::new(LstmWeights::new(spec, tensors)?), notes })
}

/// How to cite the sets that are known by the name of their folder.
#[must_use]
pub fn citation(set: &str) -> Option<&'static str> {
    match set {
        "unipen-ced" | "unipen-tos" => Some(
            "I. Guyon, L. Schomaker, R. Plamondon, M. Liberman, S. Janet: UNIPEN project of on-line data \
             exchange and \
             recognizer benchmarks, ICPR 1994, pp. 29-33; International Unipen Foundation: train_r01_v07 \
             (1999), \
             doi:10.5281/zenodo.1195803, CC BY 4.0",
        ),
        "character-trajectories" => Some(
            "B. H. Williams, M. Toussaint, A. J. Storkey: Character Trajectories, UCI Machine Learning \
             Repository, 2006, \
             CC BY 4.0",
        ),
        "pendigits-orig" => Some(
            "F. Alimoglu, E. Alpaydin: Pen-Based Recognition of Handwritten Digits, UCI Machine Learning \
             Repository, \
             1998, CC BY 4.0",
        ),
        _ => None,
    }
}
