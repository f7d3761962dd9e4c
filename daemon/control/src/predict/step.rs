//! A closed grid step as the learner receives it.

use crate::pen::Motion;

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
    /// Metres per normalised unit.
    pub scale_m: f64,
    /// Bound on predicted displacements after this step, normalised \[in the plane\].
    pub limit: f64,
    /// The recent step, normalised \[in the plane\].
    pub level: f64,
}

impl Default for LearnStep {
    fn default() -> Self {
        Self {
            index: 0,
            x: [0.0; 2],
            motion: Motion::default(),
            contact: false,
            scale_m: 1e-4,
            limit: f64::INFINITY,
            level: crate::pen::REST,
        }
    }
}
