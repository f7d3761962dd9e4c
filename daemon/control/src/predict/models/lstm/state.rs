//! `LstmState` and the plain step: the network written as its equations, in `f64` and in scaled units.
//!
//! Contract: readable, not fast; for offline use and as reference for the fast cells. Allocation-free.

use crate::predict::models::activation::{sigmoid, tanh};
use crate::predict::models::lstm::weights::{GATES, LstmWeights, MAX_HIDDEN};

/// What the network remembers, in scaled units; zero past H.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LstmState {
    /// Outputs of the cells.
    pub h: [f64; MAX_HIDDEN],
    /// c, the states of the cells.
    pub c: [f64; MAX_HIDDEN],
    /// The newest input after scaling and clipping.
    pub x: [f64; 2],
}

impl LstmState {
    /// h = c = 0: the state at the start of a sequence.
    #[must_use]
    pub const fn empty() -> Self {
        Self { h: [0.0; MAX_HIDDEN], c: [0.0; MAX_HIDDEN], x: [0.0; 2] }
    }
}

impl Default for LstmState {
    fn default() -> Self {
        Self::empty()
    }
}

impl LstmWeights {
    /// Takes in one displacement, in units of which `input_scale` make 1 (as the predictor does).
    pub fn step(&self, state: &mut LstmState, displacement: [f64; 2]) {
        let (spec, tensors) = (self.spec(), self.tensors());
        let clip = spec.clip();
        state.x = displacement.map(|x| (x / spec.input_scale).clamp(-clip, clip));
        let mut z = [[0.0; MAX_HIDDEN]; GATES];
        let biases = tensors.bias_ih.iter().zip(&tensors.bias_hh);
        let rows = tensors.weight_ih.chunks_exact(2).zip(tensors.weight_hh.chunks_exact(spec.hidden));
        let mut sums = rows.zip(biases).map(|((input, before), (bias_ih, bias_hh))| {
            bias_ih + bias_hh + dot(input, &state.x) + dot(before, &state.h)
        });
        for z in z.iter_mut().flat_map(|gate| gate.iter_mut().take(spec.hidden)) {
            *z = sums.next().unwrap_or(0.0);
        }
        drop(sums);
        let [i, f, g, o] = &z;
        let cells = state.c.iter_mut().zip(&mut state.h).take(spec.hidden);
        for ((c, h), ((i, f), (g, o))) in cells.zip(i.iter().zip(f).zip(g.iter().zip(o))) {
            *c = sigmoid(*f) * *c + sigmoid(*i) * tanh(*g);
            *h = sigmoid(*o) * tanh(*c);
        }
    }

    /// The predicted displacement of step `lead` ahead (1 = the next), in the caller's units; `None` beyond
    /// the last lead.
    #[must_use]
    pub fn output(&self, state: &LstmState, lead: usize) -> Option<[f64; 2]> {
        let (spec, tensors) = (self.spec(), self.tensors());
        let first = lead.checked_sub(1)?.checked_mul(2)?;
        let mut out = if spec.residual { state.x } else { [0.0; 2] };
        for (axis, out) in out.iter_mut().enumerate() {
            let row = tensors.out_weight.chunks_exact(spec.hidden).nth(first + axis)?;
            *out += tensors.out_bias.get(first + axis)? + dot(row, &state.h);
        }
        Some(out.map(|y| y * spec.input_scale))
    }
}

/// Σ a·b over the shorter of the two.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
