//! `LstmWeights`: the numbers of a trained network and what they were made for, checked once and then
//! immutable.
//!
//! Contract: all sizes fit and every number is finite and bounded. Layout and names are PyTorch's (`nn.LSTM`
//! with one layer, `nn.Linear`): matrices row by row, the 4H gate rows in the order i, f, g, o.

use thiserror::Error;

use crate::pen::TARGET_RMS;
use crate::predict::MAX_PREVIEW;

/// Numbers of cells that are compiled in.
pub const HIDDEN_SIZES: [usize; 3] = [10, 32, 64];
/// Largest of these numbers of cells.
pub const MAX_HIDDEN: usize = 64;
/// Gates per cell: input i, forget f, candidate g, output o.
pub const GATES: usize = 4;
/// Limit of scaled inputs without `input_clip` [per axis, in units of `input_scale`]: a hundred thousand
/// times the typical one.
pub const LARGEST_INPUT: f64 = 1e5;

/// Architecture of a network, and what it was trained for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LstmSpec {
    /// H, one of [`HIDDEN_SIZES`].
    pub hidden: usize,
    /// K: 1 = one step ahead, rolled out by feeding back; more = row pair i − 1 predicts step i directly.
    pub leads: usize,
    /// The output is added to the newest clipped input (residual).
    pub residual: bool,
    /// Scaled inputs are limited to ± this per component; `None` = as they are.
    pub input_clip: Option<f64>,
    /// Inputs are divided by it, outputs multiplied: RMS per component of the displacements trained on.
    pub input_scale: f64,
    /// Step of the displacements trained on \[ns\].
    pub step_ns: u64,
}

impl LstmSpec {
    /// The paper's network (one step ahead, no clip, no residual) for inputs of RMS `input_scale` every
    /// `step_ns` \[ns\].
    #[must_use]
    pub const fn plain(hidden: usize, input_scale: f64, step_ns: u64) -> Self {
        Self { hidden, leads: 1, residual: false, input_clip: None, input_scale, step_ns }
    }

    /// Limit of scaled inputs.
    #[must_use]
    pub fn clip(&self) -> f64 {
        self.input_clip.unwrap_or(LARGEST_INPUT)
    }
}

/// The six tensors, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LstmTensors {
    /// `lstm.weight_ih_l0`, 4H x 2.
    pub weight_ih: Vec<f64>,
    /// `lstm.weight_hh_l0`, 4H x H.
    pub weight_hh: Vec<f64>,
    /// `lstm.bias_ih_l0`, 4H.
    pub bias_ih: Vec<f64>,
    /// `lstm.bias_hh_l0`, 4H.
    pub bias_hh: Vec<f64>,
    /// `out.weight`, 2K x H.
    pub out_weight: Vec<f64>,
    /// `out.bias`, 2K.
    pub out_bias: Vec<f64>,
}

impl LstmTensors {
    /// Names in files, in the order of the fields.
    pub const NAMES: [&'static str; 6] = [
        "lstm.weight_ih_l0",
        "lstm.weight_hh_l0",
        "lstm.bias_ih_l0",
        "lstm.bias_hh_l0",
        "out.weight",
        "out.bias",
    ];

    /// Rows and columns (0 = a plain vector) of each, in the order of the fields.
    #[must_use]
    pub const fn shapes(hidden: usize, leads: usize) -> [(usize, usize); 6] {
        let (rows, outputs) = (GATES * hidden, 2 * leads);
        [(rows, 2), (rows, hidden), (rows, 0), (rows, 0), (outputs, hidden), (outputs, 0)]
    }

    /// All of them, in the order of the fields.
    #[must_use]
    pub fn all(&self) -> [&Vec<f64>; 6] {
        [&self.weight_ih, &self.weight_hh, &self.bias_ih, &self.bias_hh, &self.out_weight, &self.out_bias]
    }

    /// As `all`, to be written.
    #[must_use]
    pub fn all_mut(&mut self) -> [&mut Vec<f64>; 6] {
        [
            &mut self.weight_ih,
            &mut self.weight_hh,
            &mut self.bias_ih,
            &mut self.bias_hh,
            &mut self.out_weight,
            &mut self.out_bias,
        ]
    }

    /// All zero, of the right sizes.
    #[must_use]
    pub fn zero(hidden: usize, leads: usize) -> Self {
        let mut tensors = Self::default();
        for (tensor, (rows, columns)) in tensors.all_mut().into_iter().zip(Self::shapes(hidden, leads)) {
            tensor.resize(rows * columns.max(1), 0.0);
        }
        tensors
    }
}

/// A network that must not reach the loop.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum LstmError {
    /// A number of cells that is not compiled in.
    #[error("the LSTM has {got} cells, compiled are 10, 32 and 64: train one of these sizes")]
    Hidden {
        /// The refused value, as it was given.
        got: usize,
    },
    /// Too many or no leads.
    #[error("the LSTM predicts {got} steps directly, legal are 1 to {MAX_PREVIEW}")]
    Leads {
        /// The refused value, as it was given.
        got: usize,
    },
    /// A number of the specification outside its bounds.
    #[error("the LSTM's {name} is {got}, legal are {min} to {max}")]
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
        /// 4H x 2 etc.
        wanted: usize,
    },
    /// A parameter is NaN, infinite or too large.
    #[error(
        "tensor {tensor} holds {got} at index {index} (counted row by row from 0), legal are finite values \
         within ±{limit}: \
         the training diverged or the file is damaged",
        limit = LstmWeights::MAX_MAGNITUDE
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
        "the LSTM was trained at a step of {got_ns} ns, the loop runs at {loop_ns} ns: take a model for this \
         step, or train one"
    )]
    LoopStep {
        /// Of the network \[ns\].
        got_ns: u64,
        /// Of the loop \[ns\].
        loop_ns: u64,
    },
    /// Trained on displacements of another size.
    #[error(
        "the LSTM expects displacements of RMS {got}, the loop normalises them to about {wanted}; legal are \
         half to twice \
         that: train on normalised displacements"
    )]
    LoopScale {
        /// What the network was trained for.
        got: f64,
        /// What the loop has.
        wanted: f64,
    },
}

/// A network whose sizes fit and whose numbers are finite and bounded.
#[derive(Debug, Clone, PartialEq)]
pub struct LstmWeights {
    spec: LstmSpec,
    tensors: LstmTensors,
}

impl LstmWeights {
    /// Largest magnitude of a parameter; trained ones stay below 20.
    pub const MAX_MAGNITUDE: f64 = 1000.0;

    /// Checks everything once.
    ///
    /// # Errors
    ///
    /// The first bound that is broken.
    pub fn new(spec: LstmSpec, tensors: LstmTensors) -> Result<Self, LstmError> {
        if !HIDDEN_SIZES.contains(&spec.hidden) {
            return Err(LstmError::Hidden { got: spec.hidden });
        }
        if !(1..=MAX_PREVIEW).contains(&spec.leads) {
            return Err(LstmError::Leads { got: spec.leads });
        }
        range("input_scale", spec.input_scale, 1e-9, 1e9)?;
        range("input_clip", spec.clip(), 1e-3, LARGEST_INPUT)?;
        range("step_ns", spec.step_ns as f64, 1e5, 1e9)?;
        let shapes = LstmTensors::shapes(spec.hidden, spec.leads);
        for ((tensor, values), (rows, columns)) in
            LstmTensors::NAMES.into_iter().zip(tensors.all()).zip(shapes)
        {
            let wanted = rows * columns.max(1);
            if values.len() != wanted {
                return Err(LstmError::Length { tensor, got: values.len(), wanted });
            }
            let illegal = |value: &f64| !(value.abs() <= Self::MAX_MAGNITUDE);
            if let Some((index, got)) = values.iter().copied().enumerate().find(|(_, value)| illegal(value)) {
                return Err(LstmError::Magnitude { tensor, index, got });
            }
        }
        Ok(Self { spec, tensors })
    }

    /// Size, and what the network was trained for.
    #[must_use]
    pub const fn spec(&self) -> &LstmSpec {
        &self.spec
    }

    /// The numbers of all its tensors.
    #[must_use]
    pub const fn tensors(&self) -> &LstmTensors {
        &self.tensors
    }

    /// Checks that the network was made for a loop with step `loop_ns` \[ns\] and normalised displacements.
    ///
    /// # Errors
    ///
    /// Another step; inputs of less than half or more than twice the loop's RMS.
    pub fn fits(&self, loop_ns: u64) -> Result<(), LstmError> {
        let LstmSpec { step_ns, input_scale, .. } = self.spec;
        if step_ns != loop_ns {
            return Err(LstmError::LoopStep { got_ns: step_ns, loop_ns });
        }
        if !(0.5 * TARGET_RMS..=2.0 * TARGET_RMS).contains(&input_scale) {
            return Err(LstmError::LoopScale { got: input_scale, wanted: TARGET_RMS });
        }
        Ok(())
    }
}

fn range(name: &'static str, got: f64, min: f64, max: f64) -> Result<(), LstmError> {
    if (min..=max).contains(&got) { Ok(()) } else { Err(LstmError::Range { name, got, min, max }) }
}
