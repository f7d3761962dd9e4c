//! From trained parameters to the network of the loop.

use foretrace_control::pen::TARGET_RMS;
use foretrace_control::predict::models::foresight::{
    Dense, FEATURES, ForesightError, ForesightSpec, ForesightWeights, LAYERS, SHAPES,
};

use super::network::ForesightShape;
use super::study::Study;

/// The network of a training on a grid of `step_ns` \[ns\]; inputs that an ablation left out get weight 0.
///
/// # Errors
/// [`ForesightError`]: a number that the loop would refuse.
pub fn weights_of(
    study: &Study,
    parameters: &[f32],
    step_ns: u64,
) -> Result<ForesightWeights, ForesightError> {
    let shape = ForesightShape { inputs: study.inputs() };
    let absent: Vec<usize> = study.absent().collect();
    let mut layers: [Dense; LAYERS] = Default::default();
    let trained = shape.split(parameters).into_iter().zip(SHAPES).enumerate();
    for (into, (layer, ((weights, biases), (inputs, outputs)))) in layers.iter_mut().zip(trained) {
        let held = |input: usize| layer == 0 && (absent.contains(&input) || input >= FEATURES);
        let weight = |input: usize, output: usize| {
            if held(input) { 0.0 } else { f64::from(weights[input * outputs + output]) }
        };
        into.weight =
            (0..outputs).flat_map(|o| (0..inputs).map(move |i| (i, o))).map(|(i, o)| weight(i, o)).collect();
        into.bias = biases.iter().map(|b| f64::from(*b)).collect();
    }
    let spec = ForesightSpec { step_ns, input_scale: TARGET_RMS, block: study.block(step_ns as f64 * 1e-9) };
    ForesightWeights::new(spec, layers)
}
