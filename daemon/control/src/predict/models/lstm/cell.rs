//! The LSTM cells: weights in a layout for vector instructions, and one step.
//!
//! Per step, with x limited to ±clip: z = W_ih x + b_ih + W_hh h + b_hh, split into i, f, g, o;
//! c ← σ(f)·c + σ(i)·tanh(g), h ← σ(o)·tanh(c), y = W_out h + b_out (+ x if residual).
//! *Source*: Hochreiter & Schmidhuber 1997 with forget gates, in PyTorch's form (`nn.LSTM`).
//!
//! Contract: numbers in scaled units; `T` is the precision of the computation. `U` cells are processed
//! together, all four gates from sums in registers to the new state; `B` such blocks hold all cells, and the
//! rest of the last block stays zero. Sums run in a fixed order, so the bits do not depend on the compiler's
//! choice of instructions.

use crate::predict::models::activation::{Scalar, exp_gate, tanh_parts};
use crate::predict::models::lstm::weights::{GATES, LstmWeights};
use crate::state::state;

/// Weights of one input: a number per gate and cell of a block.
type InputWeights<T, const U: usize> = [[T; U]; GATES];

/// Parameters of a block of cells.
#[derive(Debug, Clone)]
struct Block<T, const H: usize, const U: usize> {
    bias: InputWeights<T, U>,
    inputs: [InputWeights<T, U>; 2],
    cells: [InputWeights<T, U>; H],
}

/// Parameters in the order they are read.
#[derive(Debug, Clone)]
pub(super) struct Cells<T, const H: usize, const U: usize, const B: usize> {
    residual: bool,
    clip: T,
    blocks: Box<[Block<T, H, U>]>,
    /// Per output: a number per cell.
    rows: Box<[[[T; U]; B]]>,
    biases: Box<[T]>,
}

/// Memory of the network: c, h and the newest limited input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Memory<T, const U: usize, const B: usize> {
    pub(super) c: [[T; U]; B],
    pub(super) h: [[T; U]; B],
    pub(super) x: [T; 2],
}

state! { [T: crate::state::State, const U: usize, const B: usize] Memory<T, U, B> { c, h, x } }

impl<T: Scalar, const U: usize, const B: usize> Memory<T, U, B> {
    pub(super) const EMPTY: Self = Self { c: [[T::ZERO; U]; B], h: [[T::ZERO; U]; B], x: [T::ZERO; 2] };
}

impl<T: Scalar, const H: usize, const U: usize, const B: usize> Cells<T, H, U, B> {
    pub(super) fn new(weights: &LstmWeights) -> Self {
        let (spec, tensors) = (weights.spec(), weights.tensors());
        // Numbers per gate and cell of a block, from their rows in PyTorch's tensors.
        let column = |block: usize, number: &dyn Fn(usize) -> f64| -> InputWeights<T, U> {
            std::array::from_fn(|gate| {
                std::array::from_fn(|unit| match block * U + unit {
                    cell if cell < H => T::of(number(gate * H + cell)),
                    _ => T::ZERO,
                })
            })
        };
        let blocks = (0..B).map(|block| Block {
            // Added in double precision.
            bias: column(block, &|row| at(&tensors.bias_ih, row) + at(&tensors.bias_hh, row)),
            inputs: std::array::from_fn(|axis| column(block, &|row| at(&tensors.weight_ih, row * 2 + axis))),
            cells: std::array::from_fn(|cell| column(block, &|row| at(&tensors.weight_hh, row * H + cell))),
        });
        let rows = tensors.out_weight.chunks_exact(H).map(|row| {
            let cell = |index: usize| T::of(row.get(index).copied().unwrap_or(0.0));
            std::array::from_fn(|block| std::array::from_fn(|unit| cell(block * U + unit)))
        });
        Self {
            residual: spec.residual,
            clip: T::of(spec.clip()),
            blocks: blocks.collect(),
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
        for ((block, c), h) in self.blocks.iter().zip(&mut memory.c).zip(&mut memory.h) {
            let mut z = block.bias;
            for (column, input) in block.inputs.iter().zip(x) {
                accumulate(&mut z, column, input);
            }
            for (column, input) in block.cells.iter().zip(before.as_flattened()) {
                accumulate(&mut z, column, *input);
            }
            let [i, f, g, o] = z;
            let gates = i.iter().zip(&f).zip(g.iter().zip(&o));
            for ((((i, f), (g, o)), c), h) in gates.zip(c).zip(h) {
                *c = carried(*i, *f, *g, *c);
                *h = shown(*o, *c);
            }
        }
    }

    /// Predictions in scaled units, as many as fit `out` or the network gives.
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

/// z += column · input.
#[inline(always)]
fn accumulate<T: Scalar, const U: usize>(z: &mut InputWeights<T, U>, column: &InputWeights<T, U>, input: T) {
    for (sum, weight) in z.as_flattened_mut().iter_mut().zip(column.as_flattened()) {
        *sum += *weight * input;
    }
}

/// σ(f)·c + σ(i)·tanh(g) over one common denominator: a division costs as much as an exponential.
#[inline(always)]
fn carried<T: Scalar>(i: T, f: T, g: T, c: T) -> T {
    let (i, f) = (T::ONE + exp_gate(-i), T::ONE + exp_gate(-f));
    let (g, g2) = tanh_parts(g);
    let ig2 = i * g2;
    (c * ig2 + g * f) / (f * ig2)
}

/// σ(o)·tanh(c), what the cell outputs.
#[inline(always)]
fn shown<T: Scalar>(o: T, c: T) -> T {
    let (c, c2) = tanh_parts(c);
    c / ((T::ONE + exp_gate(-o)) * c2)
}

fn at(tensor: &[f64], index: usize) -> f64 {
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
    let mut rest = sums.as_mut_slice();
    while rest.len() > 1 {
        let (low, high) = rest.split_at_mut(rest.len().div_ceil(2));
        for (low, high) in low.iter_mut().zip(high) {
            *low += *high;
        }
        rest = low;
    }
    let [total, ..] = rest else { return T::ZERO };
    *total
}
