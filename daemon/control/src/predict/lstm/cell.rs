//! The cells themselves: weights laid out for the processor, and one step of them.
//!
//! Per step, with x limited to ±clip: z = W_ih x + b_ih + W_hh h + b_hh, split into i, f, g, o;
//! c ← σ(f)·c + σ(i)·tanh(g), h ← σ(o)·tanh(c), y = W_out h + b_out (+ x if residual).
//! *Source*: Hochreiter & Schmidhuber 1997 with forget gates, in PyTorch's form (`nn.LSTM`).
//!
//! Contract: numbers in scaled units; `T` is the precision computed in. `U` cells are worked on together, all four gates
//! of them from sums in registers to the new state; `B` such blocks hold all cells, the rest of the last block idles at
//! zero. Sums run in a fixed order, so the bits are the same whatever instructions the compiler chose.

use super::weights::{GATES, LstmWeights};
use crate::predict::activation::{Scalar, sigmoid, tanh};

/// What multiplies one input: a number per gate and cell of a block.
type Column<T, const U: usize> = [[T; U]; GATES];

/// Parameters in the order they are read.
#[derive(Debug, Clone)]
pub(super) struct Cells<T, const U: usize, const B: usize> {
    hidden: usize,
    residual: bool,
    clip: T,
    /// Per block: bias, 2 inputs, H cells of the step before.
    columns: Box<[Column<T, U>]>,
    /// Per output: a number per cell.
    rows: Box<[[[T; U]; B]]>,
    biases: Box<[T]>,
}

/// What the network remembers: c, h and the newest limited input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Memory<T, const U: usize, const B: usize> {
    pub(super) c: [[T; U]; B],
    pub(super) h: [[T; U]; B],
    pub(super) x: [T; 2],
}

impl<T: Scalar, const U: usize, const B: usize> Memory<T, U, B> {
    pub(super) const EMPTY: Self = Self { c: [[T::ZERO; U]; B], h: [[T::ZERO; U]; B], x: [T::ZERO; 2] };
}

impl<T: Scalar, const U: usize, const B: usize> Cells<T, U, B> {
    pub(super) fn new(weights: &LstmWeights) -> Self {
        let (spec, tensors) = (weights.spec(), weights.tensors());
        let hidden = spec.hidden;
        let at = |tensor: &[f64], index: usize| T::of(tensor.get(index).copied().unwrap_or(0.0));
        let mut columns = Vec::with_capacity(B * (3 + hidden));
        for block in 0..B {
            for input in 0..3 + hidden {
                columns.push(std::array::from_fn(|gate| {
                    std::array::from_fn(|unit| {
                        let cell = block * U + unit;
                        let row = gate * hidden + cell;
                        match input {
                            _ if cell >= hidden => T::ZERO,
                            // In double precision first, like the sum that PyTorch's two biases are.
                            0 => T::of(at64(&tensors.bias_ih, row) + at64(&tensors.bias_hh, row)),
                            1 | 2 => at(&tensors.weight_ih, row * 2 + input - 1),
                            _ => at(&tensors.weight_hh, row * hidden + input - 3),
                        }
                    })
                }));
            }
        }
        let rows = tensors.out_weight.chunks_exact(hidden).map(|row| {
            let cell = |index: usize| row.get(index).map_or(T::ZERO, |w| T::of(*w));
            std::array::from_fn(|block| std::array::from_fn(|unit| cell(block * U + unit)))
        });
        Self {
            hidden,
            residual: spec.residual,
            clip: T::of(spec.clip()),
            columns: columns.into(),
            rows: rows.collect(),
            biases: tensors.out_bias.iter().map(|b| T::of(*b)).collect(),
        }
    }

    /// Takes in one scaled displacement.
    #[inline(always)]
    pub(super) fn step(&self, memory: &mut Memory<T, U, B>, x: [f64; 2]) {
        let x = x.map(|x| T::of(x).within(self.clip));
        let before = memory.h;
        memory.x = x;
        let blocks = self.columns.chunks_exact(3 + self.hidden);
        for ((columns, c), h) in blocks.zip(&mut memory.c).zip(&mut memory.h) {
            let Some((bias, columns)) = columns.split_first() else { continue };
            let mut z = *bias;
            for (column, input) in columns.iter().zip(x.iter().chain(before.as_flattened())) {
                for (sums, weights) in z.iter_mut().zip(column) {
                    for (sum, weight) in sums.iter_mut().zip(weights) {
                        *sum += *weight * *input;
                    }
                }
            }
            let [i, f, g, o] = z;
            let gates = i.iter().zip(&f).zip(g.iter().zip(&o));
            for ((((i, f), (g, o)), c), h) in gates.zip(c).zip(h) {
                *c = sigmoid(*f) * *c + sigmoid(*i) * tanh(*g);
                *h = sigmoid(*o) * tanh(*c);
            }
        }
    }

    /// Predictions in scaled units, as many as `out` takes or the network gives.
    #[inline(always)]
    pub(super) fn outputs(&self, memory: &Memory<T, U, B>, out: &mut [[f64; 2]]) {
        let newest = if self.residual { memory.x } else { [T::ZERO; 2] };
        let rows = self.rows.as_chunks::<2>().0.iter().zip(self.biases.as_chunks::<2>().0);
        for (out, (rows, biases)) in out.iter_mut().zip(rows) {
            for (((out, row), bias), newest) in out.iter_mut().zip(rows).zip(biases).zip(newest) {
                *out = (dot(row, &memory.h) + *bias + newest).wide();
            }
        }
    }
}

fn at64(tensor: &[f64], index: usize) -> f64 {
    tensor.get(index).copied().unwrap_or(0.0)
}

/// Σ a·b, lane by lane over the blocks, then the lanes by halves.
#[inline(always)]
fn dot<T: Scalar, const U: usize, const B: usize>(a: &[[T; U]; B], b: &[[T; U]; B]) -> T {
    let mut sums = [T::ZERO; U];
    for (a, b) in a.iter().zip(b) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += *a * *b;
        }
    }
    let mut width = U;
    while width > 1 {
        width /= 2;
        let (low, high) = sums.split_at_mut(width);
        for (low, high) in low.iter_mut().zip(high) {
            *low += *high;
        }
    }
    let [total, ..] = sums.as_slice() else { return T::ZERO };
    *total
}
