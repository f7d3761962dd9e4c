//! Online learning: a candidate learns from the pen, the live weights are frozen, evidence decides.
//!
//! Contract: one call per grid step, no clock and no allocation, so that the learner thread, the lab and replay give the
//! same weights. What reaches the loop is whole, finite and was not worse than the live weights on recent motion.

use crate::pen::Motion;

/// What the learner needs of one grid step; made by [`crate::predict::Previewer::observe`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LearnStep {
    /// Grid index k.
    pub index: u64,
    /// Normalised displacement, zero unless the motion continues.
    pub x: [f64; 2],
    /// Only `Continues` is learned from; the others empty the memory.
    pub motion: Motion,
    /// The pen touches the paper.
    pub contact: bool,
    /// Metres per normalised unit.
    pub scale_m: f64,
}
