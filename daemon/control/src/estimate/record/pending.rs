//! Pending previews: predictions whose outcome is not known yet, with the newer samples that refined them.

use crate::estimate::LEADS;
use crate::estimate::refine::Refinement;
use crate::state::state;

/// One refinement of a preview, with the situation at that time.
#[derive(Debug, Clone, Copy)]
pub(super) struct PendingRefinement {
    pub(super) refinement: Refinement,
    /// Tool position under feedback alone \[m\].
    pub(super) held: [f64; 2],
    /// Steps since the pen began to move.
    pub(super) moved: u32,
}

state! { [] PendingRefinement { refinement, held, moved } }

#[derive(Debug, Clone, Copy)]
pub(super) struct PendingPreview {
    /// Grid steps closed since.
    pub(super) age: usize,
    /// The last refinement before the next grid point closed.
    pub(super) last: PendingRefinement,
    /// Predicted positions \[m\].
    pub(super) path: [[f64; 2]; LEADS],
}

state! { [] PendingPreview { age, last, path } }

impl PendingPreview {
    pub(super) const EMPTY: Self = Self {
        age: 0,
        last: PendingRefinement { refinement: Refinement::at([0.0; 2]), held: [0.0; 2], moved: 0 },
        path: [[0.0; 2]; LEADS],
    };
}
