//! A closed grid step as the learner receives it.

use crate::pen::{Motion, Touch};

/// Input of the learner for one grid step; made by [`super::Previewer::observe`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnStep {
    /// Grid index k.
    pub index: u64,
    /// Normalised displacement, zero unless the motion continues.
    pub x: [f64; 2],
    /// Only `Continues` is learned from; the others clear the memory.
    pub motion: Motion,
    /// The pen touches the paper.
    pub contact: bool,
    /// Steps since it came to touch the paper or left it.
    pub contact_steps: u32,
    /// Metres per normalised unit.
    pub scale_m: f64,
    /// Bound on predicted displacements after this step, normalised \[in the plane\].
    pub limit: f64,
    /// The recent step, normalised \[in the plane\].
    pub level: f64,
}

impl LearnStep {
    /// Whether the pen touches the paper, and since when.
    #[must_use]
    pub const fn touch(&self) -> Touch {
        Touch { contact: self.contact, steps: self.contact_steps }
    }
}

impl Default for LearnStep {
    fn default() -> Self {
        Self {
            index: 0,
            x: [0.0; 2],
            motion: Motion::default(),
            contact: false,
            contact_steps: 0,
            scale_m: 1e-4,
            limit: f64::INFINITY,
            level: crate::pen::REST,
        }
    }
}
