//! What a network is and the flat vector of its parameters, in PyTorch's names, shapes and order.
//!
//! z = W_ih x + b_ih + W_hh h + b_hh, gate rows i, f, g, o (H each); i, f, o = sigmoid, g = tanh; c <- f c +
//! i g; h <- o tanh(c); y = W_out h + b_out. h = c = 0 before each sequence.

use std::ops::Range;

use rand::RngExt as _;
use rand_pcg::Pcg64;

use super::real::Real;

/// Sizes of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LstmShape {
    /// Cells H of the one layer.
    pub cells: usize,
    /// Leads K: output rows 2(i-1)..2i predict the displacement i steps ahead.
    pub leads: usize,
}

/// One named tensor inside the flat vector.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TensorSlot {
    pub name: &'static str,
    /// Its shape; one number for a bias.
    pub shape: Vec<usize>,
    /// Where it stands, rows first.
    pub range: Range<usize>,
}

impl LstmShape {
    /// The six tensors in order.
    #[must_use]
    pub fn tensors(self) -> [TensorSlot; 6] {
        let Self { cells, leads } = self;
        let mut at = 0;
        [
            ("lstm.weight_ih_l0", vec![4 * cells, 2]),
            ("lstm.weight_hh_l0", vec![4 * cells, cells]),
            ("lstm.bias_ih_l0", vec![4 * cells]),
            ("lstm.bias_hh_l0", vec![4 * cells]),
            ("out.weight", vec![2 * leads, cells]),
            ("out.bias", vec![2 * leads]),
        ]
        .map(|(name, shape)| {
            let from = at;
            at += shape.iter().product::<usize>();
            TensorSlot { name, shape, range: from..at }
        })
    }

    #[must_use]
    pub fn count(self) -> usize {
        self.tensors().last().map_or(0, |last| last.range.end)
    }

    /// PyTorch's default start: every parameter uniform in +-1/sqrt(H), from `rng`.
    #[must_use]
    pub fn initial<F: Real>(self, rng: &mut Pcg64) -> Vec<F> {
        let bound = 1.0 / (self.cells as f64).sqrt();
        (0..self.count()).map(|_| F::of(rng.random_range(-bound..bound))).collect()
    }
}

/// A network without its parameters: sizes and what is done around the layer. Lengths are in units of the
/// input scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LstmNetwork {
    pub shape: LstmShape,
    /// Inputs are cut to +-clip per component.
    pub clip: Option<f64>,
    /// Output = cut input + linear(h), for every lead.
    pub residual: bool,
    /// Longer input steps are not motion: the state is forgotten before them and they are taken for a zero
    /// step.
    pub reset_beyond: Option<f64>,
}

/// Weights as the kernels read them: four gates of a cell side by side, inputs `[x, y, 1, h]`, transposes
/// ready.
#[derive(Debug, Clone, Default)]
pub(super) struct PackedWeights<F> {
    /// `[cell][input][gate]`, inputs 3 + H.
    pub(super) forward: Vec<[F; 4]>,
    /// `[block of 4 cells][cell, gate][cell in block]`: W_hh transposed, zeros beyond H.
    pub(super) back: Vec<[F; 4]>,
    /// `[output][1 + H]`, the bias first.
    pub(super) out: Vec<F>,
    /// `[cell][output]`.
    pub(super) out_back: Vec<F>,
}

impl<F: Real> PackedWeights<F> {
    /// Takes over the flat parameters of a network of that shape.
    pub(super) fn fill(&mut self, shape: LstmShape, flat: &[F]) {
        let [w_ih, w_hh, b_ih, b_hh, w_out, b_out] = shape.tensors().map(|t| &flat[t.range]);
        let (cells, outputs) = (shape.cells, 2 * shape.leads);
        self.forward.clear();
        for cell in 0..cells {
            let rows = [cell, cells + cell, 2 * cells + cell, 3 * cells + cell];
            self.forward.push(rows.map(|r| w_ih[2 * r]));
            self.forward.push(rows.map(|r| w_ih[2 * r + 1]));
            self.forward.push(rows.map(|r| b_ih[r] + b_hh[r]));
            self.forward.extend((0..cells).map(|k| rows.map(|r| w_hh[r * cells + k])));
        }
        self.back.clear();
        for block in (0..cells).step_by(4) {
            for cell in 0..cells {
                for gate in 0..4 {
                    let row = (gate * cells + cell) * cells;
                    let at = |k: usize| if k < cells { w_hh[row + k] } else { F::default() };
                    self.back.push([at(block), at(block + 1), at(block + 2), at(block + 3)]);
                }
            }
        }
        self.out.clear();
        for o in 0..outputs {
            self.out.push(b_out[o]);
            self.out.extend_from_slice(&w_out[o * cells..(o + 1) * cells]);
        }
        self.out_back.clear();
        self.out_back.extend((0..cells).flat_map(|k| (0..outputs).map(move |o| w_out[o * cells + k])));
    }
}

/// Gradients as the kernels sum them.
#[derive(Debug, Clone)]
pub(super) struct PackedGradient<F> {
    /// As [`PackedWeights::forward`].
    pub(super) layer: Vec<[F; 4]>,
    /// As [`PackedWeights::out`].
    pub(super) out: Vec<F>,
}

impl<F: Real> PackedGradient<F> {
    pub(super) fn zero(shape: LstmShape) -> Self {
        Self {
            layer: vec![[F::default(); 4]; shape.cells * (shape.cells + 3)],
            out: vec![F::default(); 2 * shape.leads * (shape.cells + 1)],
        }
    }

    pub(super) fn clear(&mut self) {
        self.layer.fill([F::default(); 4]);
        self.out.fill(F::default());
    }

    /// Adds this gradient to a flat one.
    pub(super) fn add_to(&self, shape: LstmShape, flat: &mut [F]) {
        let [w_ih, w_hh, b_ih, b_hh, w_out, b_out] = shape.tensors().map(|t| t.range.start);
        let (cells, inputs) = (shape.cells, shape.cells + 3);
        for (cell, rows) in self.layer.chunks_exact(inputs).enumerate() {
            for gate in 0..4 {
                let row = gate * cells + cell;
                flat[w_ih + 2 * row] += rows[0][gate];
                flat[w_ih + 2 * row + 1] += rows[1][gate];
                flat[b_ih + row] += rows[2][gate];
                flat[b_hh + row] += rows[2][gate];
                for k in 0..cells {
                    flat[w_hh + row * cells + k] += rows[3 + k][gate];
                }
            }
        }
        for (o, row) in self.out.chunks_exact(cells + 1).enumerate() {
            flat[b_out + o] += row[0];
            for k in 0..cells {
                flat[w_out + o * cells + k] += row[1 + k];
            }
        }
    }
}
