//! Hold: the pen stays where it is (the paper's conservative model x_c).

use crate::predict::{Entry, Predictor};
use crate::state::state;

pub(crate) const ENTRY: Entry =
    Entry::plain::<Hold>("hold", "the last position, at rest (the paper's conservative model)");

/// Predicts no displacement; has no memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Hold;

state! { [] Hold {} }

impl Predictor for Hold {
    fn observe(&mut self, _x: [f64; 2]) {}

    fn preview_within(&self, _limit: f64, out: &mut [[f64; 2]]) {
        out.fill([0.0; 2]);
    }

    fn reset(&mut self) {}
}
