//! ConstantVelocity: the pen repeats its last displacement (the baseline of the paper's Table 1).

use crate::predict::{Entry, Predictor, shortened};
use crate::state::state;

pub(super) const ENTRY: Entry =
    Entry::plain::<ConstantVelocity>("constant-velocity", "repeats the last velocity (the paper's baseline)");

/// Predicts the last observed displacement for every step; zero before the first.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ConstantVelocity {
    last: [f64; 2],
}

state! { [] ConstantVelocity { last } }

impl Predictor for ConstantVelocity {
    fn observe(&mut self, x: [f64; 2]) {
        self.last = x;
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        out.fill(shortened(self.last, limit));
    }

    fn reset(&mut self) {
        self.last = [0.0; 2];
    }
}
