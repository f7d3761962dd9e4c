//! Pending previews: predictions whose outcome is not known yet, with the newer samples that refined them.

use super::SKILL_LEADS;
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

state! { whole [] PendingRefinement { refinement, held, moved } }

#[derive(Debug, Clone, Copy)]
pub(super) struct PendingPreview {
    /// Grid steps closed since.
    pub(super) age: usize,
    /// The last refinement before the next grid point closed.
    pub(super) last: PendingRefinement,
    /// A refinement at an earlier phase of the step: every phase is used, so every phase must be learned.
    pub(super) earlier: Option<PendingRefinement>,
    /// Displacement before the preview \[m\], which constant velocity repeats.
    pub(super) velocity: [f64; 2],
    /// Predicted positions \[m\].
    pub(super) path: [[f64; 2]; SKILL_LEADS],
    /// Index of the position for which the predictor named a band, and its radius \[m\].
    pub(super) claim: Option<(usize, f64)>,
}

state! { [] PendingPreview { age, last, earlier, velocity, path, claim } }

impl PendingPreview {
    pub(super) const EMPTY: Self = Self {
        age: 0,
        last: PendingRefinement { refinement: Refinement::at([0.0; 2]), held: [0.0; 2], moved: 0 },
        earlier: None,
        velocity: [0.0; 2],
        path: [[0.0; 2]; SKILL_LEADS],
        claim: None,
    };
}
