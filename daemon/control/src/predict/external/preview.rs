//! A preview that another process made, and why one is not used.

use crate::predict::MAX_PREVIEW;
use crate::state::{Reader, State, StateError, Writer};

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
    /// Which process made it: another number is another process.
    pub sender: u64,
}

/// Only what counts, because recordings hold one per grid step.
impl State for ExternalPreview {
    fn save(&self, to: &mut Writer<'_>) {
        self.base_index.save(to);
        self.count.save(to);
        self.radii_count.save(to);
        self.positions().iter().for_each(|position| position.save(to));
        self.radii().iter().for_each(|radius| radius.save(to));
        self.sender.save(to);
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        *self = Self::EMPTY;
        self.base_index.load(from)?;
        self.count.load(from)?;
        self.radii_count.load(from)?;
        let (count, radii_count) = (self.count, self.radii_count);
        if count <= MAX_PREVIEW {
            self.positions.iter_mut().take(count).try_for_each(|position| position.load(from))?;
        }
        if radii_count <= MAX_PREVIEW {
            self.radii.iter_mut().take(radii_count).try_for_each(|radius| radius.load(from))?;
        }
        self.sender.load(from)
    }
}

impl ExternalPreview {
    /// A preview without positions: refused.
    pub const EMPTY: Self = Self {
        base_index: 0,
        count: 0,
        positions: [[0.0; 2]; MAX_PREVIEW],
        radii_count: 0,
        radii: [0.0; MAX_PREVIEW],
        sender: 0,
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
    /// No positions, fewer than the plan looks at from now on, or more than there is room for; radii for some
    /// of them only.
    Malformed,
    /// A position or a radius is not finite, or a radius is negative.
    NonFinite,
    /// For a grid step that has not closed yet.
    Ahead,
    /// For a grid step that is older than previews may be.
    Late,
    /// For a grid step of which a preview came before, or after another one since the newest step closed.
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
