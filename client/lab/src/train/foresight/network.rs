//! The network while it is trained: its parameters, one pass and its gradient for a piece of a batch.

use foretrace_control::predict::models::foresight::{HIDDEN, LAYERS, OUTPUTS, activation, slope};
use rand::RngExt as _;
use rand_pcg::Pcg64;

use super::product::{COLUMNS, LeftFactor, ROWS, RightFactor, add_product};

/// Examples of a piece: what a thread does at a time, and what is summed on its own.
pub(super) const PIECE: usize = 64;

/// Number of inputs, the hidden layers and outputs being those of the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ForesightShape {
    /// Inputs, a multiple of `ROWS`.
    pub inputs: usize,
}

impl ForesightShape {
    /// For at least so many inputs; those past them are zero.
    #[must_use]
    pub fn of(inputs: usize) -> Self {
        Self { inputs: inputs.next_multiple_of(ROWS) }
    }

    /// Inputs and outputs of each layer.
    #[must_use]
    pub fn layers(self) -> [(usize, usize); LAYERS] {
        let [first, second, third] = HIDDEN;
        [(self.inputs, first), (first, second), (second, third), (third, OUTPUTS)]
    }

    /// Parameters: per layer the weights (a row per input), then the biases.
    #[must_use]
    pub fn count(self) -> usize {
        self.layers().iter().map(|(inputs, outputs)| (inputs + 1) * outputs).sum()
    }

    /// He's initial weights, zero biases.
    #[must_use]
    pub fn initial(self, rng: &mut Pcg64) -> Vec<f32> {
        let mut parameters = Vec::with_capacity(self.count());
        for (inputs, outputs) in self.layers() {
            let reach = (6.0 / inputs as f64).sqrt() as f32;
            parameters.extend((0..inputs * outputs).map(|_| rng.random_range(-reach..reach)));
            parameters.resize(parameters.len() + outputs, 0.0);
        }
        parameters
    }

    /// The parameters of each layer: weights and biases.
    pub(super) fn split(self, parameters: &[f32]) -> [(&[f32], &[f32]); LAYERS] {
        let mut rest = parameters;
        self.layers().map(|(inputs, outputs)| {
            let (weights, others) = rest.split_at(inputs * outputs);
            let (biases, others) = others.split_at(outputs);
            rest = others;
            (weights, biases)
        })
    }
}

/// The parameters as the products want them.
#[derive(Debug, Clone, Default)]
pub(super) struct Packed {
    /// W, inputs x outputs.
    forward: [RightFactor; LAYERS],
    backward: [RightFactor; LAYERS],
    biases: [Vec<f32>; LAYERS],
}

impl Packed {
    pub(super) fn fill(&mut self, shape: ForesightShape, parameters: &[f32], learning: bool) {
        for (layer, ((inputs, outputs), (weights, biases))) in
            shape.layers().into_iter().zip(shape.split(parameters)).enumerate()
        {
            self.forward[layer].fill(inputs, outputs, |i, o| weights[i * outputs + o]);
            if learning && layer > 0 {
                self.backward[layer].fill(outputs, inputs, |o, i| weights[i * outputs + o]);
            }
            self.biases[layer] = biases.to_vec();
        }
    }
}

/// The tools of one thread.
#[derive(Debug, Default)]
pub(super) struct LayerBuffers {
    /// Values before the activation, per layer.
    sums: [Vec<f32>; LAYERS],
    values: [Vec<f32>; LAYERS],
    left: LeftFactor,
    right: RightFactor,
    back: Vec<f32>,
    errors: Vec<f32>,
}

impl LayerBuffers {
    /// Outputs for `inputs`, [`PIECE`] rows.
    pub(super) fn outputs(&mut self, shape: ForesightShape, packed: &Packed, inputs: &[f32]) -> &[f32] {
        for (layer, (width, outputs)) in shape.layers().into_iter().enumerate() {
            let (before, _) = self.values.split_at(layer);
            let given = before.last().map_or(inputs, Vec::as_slice);
            self.left.fill(PIECE, width, |row, k| given[row * width + k]);
            let sums = &mut self.sums[layer];
            sums.clear();
            for _ in 0..PIECE {
                sums.extend_from_slice(&packed.biases[layer]);
            }
            add_product(sums, outputs, &self.left, &packed.forward[layer]);
            let values = &mut self.values[layer];
            values.clear();
            if layer + 1 < LAYERS {
                values.extend(sums.iter().map(|sum| activation(*sum)));
            } else {
                values.extend_from_slice(sums);
            }
        }
        &self.values[LAYERS - 1]
    }

    /// Adds the gradient to `gradient`, for the `slopes` of the loss by the outputs of the last pass.
    pub(super) fn add_gradient(
        &mut self,
        shape: ForesightShape,
        packed: &Packed,
        inputs: &[f32],
        slopes: &[f32],
        gradient: &mut [f32],
    ) {
        self.errors.clear();
        self.errors.extend_from_slice(slopes);
        let mut end = gradient.len();
        for (layer, (width, outputs)) in shape.layers().into_iter().enumerate().rev() {
            let begin = end - (width + 1) * outputs;
            let (weights, biases) = gradient[begin..end].split_at_mut(width * outputs);
            end = begin;
            for row in self.errors.chunks_exact(outputs) {
                for (bias, error) in biases.iter_mut().zip(row) {
                    *bias += error;
                }
            }
            let (before, _) = self.values.split_at(layer);
            let given = before.last().map_or(inputs, Vec::as_slice);
            self.left.fill(width, PIECE, |input, row| given[row * width + input]);
            let errors = &self.errors;
            self.right.fill(PIECE, outputs, |row, output| errors[row * outputs + output]);
            add_product(weights, outputs, &self.left, &self.right);
            if layer == 0 {
                break;
            }
            self.left.fill(PIECE, outputs, |row, output| errors[row * outputs + output]);
            self.back.clear();
            self.back.resize(PIECE * width, 0.0);
            add_product(&mut self.back, width, &self.left, &packed.backward[layer]);
            for (back, sum) in self.back.iter_mut().zip(&self.sums[layer - 1]) {
                *back *= slope(*sum);
            }
            std::mem::swap(&mut self.back, &mut self.errors);
        }
    }
}

const _: () = assert!(PIECE.is_multiple_of(ROWS) && OUTPUTS.is_multiple_of(COLUMNS));
