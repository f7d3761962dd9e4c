//! The rows of one tick that matter: those that some velocity in the box could violate.

use crate::arm::limits::VelocityBox;
use crate::qp::row_qp::RowSet;
use crate::state::state;

/// Rows of one tick, and the room that each leaves \[m/s\]: negative, the box can violate it by so much.
#[derive(Debug, Clone)]
pub(crate) struct OfferedRows<const J: usize> {
    rows: RowSet<J>,
    room: [f64; 32],
}

state! { [const J: usize] OfferedRows<J> { rows, room } }

impl<const J: usize> Default for OfferedRows<J> {
    fn default() -> Self {
        Self { rows: RowSet::default(), room: [0.0; 32] }
    }
}

impl<const J: usize> OfferedRows<J> {
    pub(crate) fn rows(&self) -> &RowSet<J> {
        &self.rows
    }

    pub(crate) fn clear(&mut self) {
        self.rows.clear();
    }

    /// Adds a row that some velocity in the box violates; if the set is full, it replaces the row with most
    /// room.
    pub(crate) fn offer(&mut self, row: &[f64; J], bound: f64, allowed: &VelocityBox<J>) {
        let ends = allowed.lower.iter().zip(&allowed.upper).zip(row);
        let worst: f64 = ends.map(|((low, high), c)| (c * low).min(c * high)).sum();
        let room = worst - bound;
        if !(room < 0.0) {
            return;
        }
        let capacity = RowSet::<J>::CAPACITY.min(self.room.len());
        let mut slot = self.rows.len();
        if slot >= capacity {
            let kept = self.room.iter().copied().take(capacity).enumerate();
            let loosest = kept.fold((0, f64::NEG_INFINITY), |a, b| if b.1 > a.1 { b } else { a });
            if loosest.1 <= room {
                return;
            }
            slot = loosest.0;
        }
        if let Some(slack) = self.room.get_mut(slot) {
            *slack = room;
            self.rows.put(slot, row, bound);
        }
    }
}
