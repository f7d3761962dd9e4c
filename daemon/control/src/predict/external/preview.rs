//! A preview that another process made, and why one is not used.

use crate::predict::MAX_PREVIEW;

/// Predicted positions of the pen after a closed grid step. Nothing in it is trusted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExternalPreview {
    /// Grid index of the step after which it predicts.
    pub base_index: u64,
    /// How many of `positions` count.
    pub count: usize,
    /// Entry i is the pen's position at the instant (base_index + i + 1)·Δ, plane frame \[m\].
    pub positions: [[f64; 2]; MAX_PREVIEW],
    /// How many of `radii` count: 0, or `count`.
    pub radii_count: usize,
    /// Radius about each position in which the pen is expected in nine of ten cases \[m\].
    pub radii: [f64; MAX_PREVIEW],
}

impl ExternalPreview {
    /// Predicts nothing.
    pub const EMPTY: Self = Self {
        base_index: 0,
        count: 0,
        positions: [[0.0; 2]; MAX_PREVIEW],
        radii_count: 0,
        radii: [0.0; MAX_PREVIEW],
    };

    /// The positions that count; none if there are said to be more than there is room for.
    #[must_use]
    pub fn positions(&self) -> &[[f64; 2]] {
        self.positions.get(..self.count).unwrap_or_default()
    }

    /// The radii that count; none if there are said to be more than there is room for.
    #[must_use]
    pub fn radii(&self) -> &[f64] {
        self.radii.get(..self.radii_count).unwrap_or_default()
    }
}

/// Why a preview of another process is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PreviewRefusal {
    /// No positions, fewer than the plan needs, or more than there is room for; radii for some of them only.
    Malformed,
    /// A position or a radius is not finite, or a radius is negative.
    NonFinite,
    /// For a grid step that has not closed yet.
    Ahead,
    /// For a grid step that is older than previews may be.
    Late,
    /// For a grid step of which a preview came before.
    Repeated,
    /// For a grid step of the stroke before: the pen has begun anew or jumped since.
    OtherStroke,
    /// A displacement much longer than the hand's recent motion.
    Wild,
}

impl PreviewRefusal {
    /// Every reason, in the order of [`Self::index`].
    pub const ALL: [Self; 7] = [
        Self::Malformed,
        Self::NonFinite,
        Self::Ahead,
        Self::Late,
        Self::Repeated,
        Self::OtherStroke,
        Self::Wild,
    ];

    /// Its place in [`Self::ALL`].
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }
}
