//! Oracle: the recorded future, for experiments that need a perfect prediction. Never part of a live loop.

use crate::predict::{Entry, Predictor, shortened};
use crate::state::state;

pub(super) const ENTRY: Entry = Entry::recorded("oracle", "the recorded future, for experiments");

/// Displacements of a recording on the absolute grid; past its end the pen rests.
#[derive(Debug, Clone, PartialEq)]
pub struct Oracle {
    first_index: u64,
    displacements_m: Box<[[f64; 2]]>,
    cursor: u64,
    scale_m: f64,
}

state! { [] Oracle { cursor, scale_m } fixed { first_index, displacements_m } }

impl Oracle {
    /// `displacements_m[i]` is position(first_index + i) − position(first_index + i − 1) \[m\].
    #[must_use]
    pub fn new(first_index: u64, displacements_m: Box<[[f64; 2]]>) -> Self {
        Self { first_index, displacements_m, cursor: first_index.saturating_sub(1), scale_m: 1.0 }
    }
}

impl Predictor for Oracle {
    fn observe(&mut self, _x: [f64; 2]) {
        self.cursor = self.cursor.saturating_add(1);
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        for (ahead, predicted) in (1..).zip(out) {
            let recorded = (self.cursor.saturating_add(ahead))
                .checked_sub(self.first_index)
                .and_then(|offset| self.displacements_m.get(usize::try_from(offset).ok()?));
            *predicted = recorded.map_or([0.0; 2], |d| shortened(d.map(|d| d / self.scale_m), limit));
        }
    }

    /// The recording is kept, and the cursor stays where `set_cursor` put it.
    fn reset(&mut self) {}

    fn set_cursor(&mut self, index: u64, scale_m: f64) {
        self.cursor = index;
        self.scale_m = scale_m;
    }
}
