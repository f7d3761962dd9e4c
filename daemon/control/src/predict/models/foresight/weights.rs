//! `ForesightWeights`: the numbers of a trained network and what they were made for, checked once and then
//! immutable.
//!
//! Contract: every number is finite and bounded. Layout and names are PyTorch's (`nn.Linear`): a row per
//! output.

use thiserror::Error;

use super::features::{FEATURES, LONGEST_BLOCK};
use crate::pen::TARGET_RMS;
use crate::predict::models::mixture::NODE_COUNT;

/// Units of the hidden layers.
pub const HIDDEN: [usize; 3] = [128, 128, 64];
/// Outputs: x and y at every node of the mixture.
pub const OUTPUTS: usize = 2 * NODE_COUNT;
/// Number of layers that have weights.
pub const LAYERS: usize = HIDDEN.len() + 1;
/// Inputs and outputs of each layer.
pub const SHAPES: [(usize, usize); LAYERS] = {
    let [first, second, third] = HIDDEN;
    [(FEATURES, first), (first, second), (second, third), (third, OUTPUTS)]
};

/// What a network was trained for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForesightSpec {
    /// Step of the displacements trained on \[ns\].
    pub step_ns: u64,
    /// RMS per component of the displacements trained on.
    pub input_scale: f64,
    /// Steps of a block of the history, see [`super::features`].
    pub block: usize,
}

/// One layer: a row of weights per output, and a bias per output.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Dense {
    /// `layers.N.weight`, outputs x inputs.
    pub weight: Vec<f64>,
    /// `layers.N.bias`, outputs.
    pub bias: Vec<f64>,
}

/// Names in files, weight and bias of each layer.
pub const NAMES: [[&str; 2]; LAYERS] = [
    ["layers.0.weight", "layers.0.bias"],
    ["layers.1.weight", "layers.1.bias"],
    ["layers.2.weight", "layers.2.bias"],
    ["layers.3.weight", "layers.3.bias"],
];

/// A network that must not reach the loop.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ForesightError {
    /// A number of the specification outside its bounds.
    #[error("the network's {name} is {got}, legal are {min} to {max}")]
    Range {
        /// Name of the number, as in the message.
        name: &'static str,
        /// The refused value, as it was given.
        got: f64,
        /// Smallest value that is legal, itself included.
        min: f64,
        /// Largest value that is legal, itself included.
        max: f64,
    },
    /// A tensor of another size.
    #[error("tensor {tensor} has {got} numbers, {wanted} are needed")]
    Length {
        /// Name of the tensor, as in the file.
        tensor: &'static str,
        /// The refused value, as it was given.
        got: usize,
        /// Outputs x inputs, or outputs.
        wanted: usize,
    },
    /// A parameter is NaN, infinite or too large.
    #[error(
        "tensor {tensor} holds {got} at index {index} (counted row by row from 0), legal are finite values \
         within ±{limit}: the training diverged or the file is damaged",
        limit = ForesightWeights::MAX_MAGNITUDE
    )]
    Magnitude {
        /// Name of the tensor, as in the file.
        tensor: &'static str,
        /// Index, row by row from 0.
        index: usize,
        /// The number that is refused.
        got: f64,
    },
    /// Trained at another step.
    #[error(
        "the network was trained at a step of {got_ns} ns, the loop runs at {loop_ns} ns: take a model for \
         this step, or train one"
    )]
    LoopStep {
        /// Of the network \[ns\].
        got_ns: u64,
        /// Of the loop \[ns\].
        loop_ns: u64,
    },
    /// Trained on displacements of another size.
    #[error(
        "the network expects displacements of RMS {got}, the loop normalises them to {TARGET_RMS}: train on \
         normalised displacements"
    )]
    LoopScale {
        /// What the network was trained for.
        got: f64,
    },
}

/// A network whose sizes fit and whose numbers are finite and bounded.
#[derive(Debug, Clone, PartialEq)]
pub struct ForesightWeights {
    spec: ForesightSpec,
    layers: [Dense; LAYERS],
}

impl ForesightWeights {
    /// Largest magnitude of a parameter; trained ones stay below 10.
    pub const MAX_MAGNITUDE: f64 = 100.0;

    /// Checks everything once.
    ///
    /// # Errors
    ///
    /// The first bound that is broken.
    pub fn new(spec: ForesightSpec, layers: [Dense; LAYERS]) -> Result<Self, ForesightError> {
        range("input_scale", spec.input_scale, 1e-9, 1e9)?;
        range("step_ns", spec.step_ns as f64, 1e5, 1e9)?;
        range("block", spec.block as f64, 1.0, LONGEST_BLOCK as f64)?;
        for ((layer, names), (inputs, outputs)) in layers.iter().zip(NAMES).zip(SHAPES) {
            let tensors = [(&layer.weight, inputs * outputs), (&layer.bias, outputs)];
            for (tensor, (numbers, wanted)) in names.into_iter().zip(tensors) {
                if numbers.len() != wanted {
                    return Err(ForesightError::Length { tensor, got: numbers.len(), wanted });
                }
                let illegal = |number: &f64| !(number.abs() <= Self::MAX_MAGNITUDE);
                let found = numbers.iter().copied().enumerate().find(|(_, number)| illegal(number));
                if let Some((index, got)) = found {
                    return Err(ForesightError::Magnitude { tensor, index, got });
                }
            }
        }
        Ok(Self { spec, layers })
    }

    /// What the network was trained for.
    #[must_use]
    pub const fn spec(&self) -> &ForesightSpec {
        &self.spec
    }

    /// The numbers of all its tensors.
    #[must_use]
    pub const fn layers(&self) -> &[Dense; LAYERS] {
        &self.layers
    }

    /// Checks that the network was made for a loop with step `loop_ns` \[ns\] and normalised displacements.
    ///
    /// # Errors
    ///
    /// Another step or scale.
    pub fn fits(&self, loop_ns: u64) -> Result<(), ForesightError> {
        let ForesightSpec { step_ns, input_scale, .. } = self.spec;
        if step_ns != loop_ns {
            return Err(ForesightError::LoopStep { got_ns: step_ns, loop_ns });
        }
        let matches = (input_scale - TARGET_RMS).abs() <= 1e-9 * TARGET_RMS;
        if matches { Ok(()) } else { Err(ForesightError::LoopScale { got: input_scale }) }
    }
}

fn range(name: &'static str, got: f64, min: f64, max: f64) -> Result<(), ForesightError> {
    if (min..=max).contains(&got) { Ok(()) } else { Err(ForesightError::Range { name, got, min, max }) }
}
