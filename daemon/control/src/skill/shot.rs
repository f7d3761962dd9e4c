//! Previews that wait for what they foresaw, and what newer samples said about them.

use super::SKILL_LEADS;
use crate::predict::refine::Look;

/// A look at a preview, and how things stood then.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight {
    /// What the preview was refined by.
    pub(super) look: Look,
    /// Where the tool would be then \[m\] if it had been led by feedback alone.
    pub(super) held: [f64; 2],
    /// Steps since the pen began to move.
    pub(super) moved: u32,
}

/// One preview that waits for what it foresaw.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shot {
    /// Grid steps closed since.
    pub(super) age: usize,
    /// The last before the next grid point closed.
    pub(super) sight: Sight,
    /// One from an earlier part of the step: each part of it has to be learned, as each is used.
    pub(super) earlier: Option<Sight>,
    /// Displacement before the preview [m]: what constant velocity goes on with.
    pub(super) velocity: [f64; 2],
    /// Predicted positions \[m\].
    pub(super) path: [[f64; 2]; SKILL_LEADS],
    /// Index of the position for which the predictor named a band, and its radius \[m\].
    pub(super) claim: Option<(usize, f64)>,
}

impl Shot {
    pub(super) const EMPTY: Self = Self {
        age: 0,
        sight: Sight { look: Look::at([0.0; 2]), held: [0.0; 2], moved: 0 },
        earlier: None,
        velocity: [0.0; 2],
        path: [[0.0; 2]; SKILL_LEADS],
        claim: None,
    };
}
