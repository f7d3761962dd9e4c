//! One closed step of the pen grid as the law uses it: what predictors observe, and what learning and judging
//! need besides.

use crate::pen::{Motion, REST, Touch};

/// What predictors observe of one step, normalised.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PenStep {
    /// Normalised displacement of the step.
    pub x: [f64; 2],
    /// Its part in the first half of the step: devices faster than the grid tell more than its end.
    pub half: [f64; 2],
    /// From the step's end to the newest sample, normalised; zero where that is not known.
    pub ahead: [f64; 2],
    /// How long after the step's end that sample is stamped \[s\].
    pub ahead_s: f64,
    /// The pen's touch after it.
    pub touch: Touch,
}

impl PenStep {
    /// An even displacement `x` of a pen on the paper: all that recordings of displacements hold.
    #[must_use]
    pub const fn of([x, y]: [f64; 2]) -> Self {
        Self { x: [x, y], half: [0.5 * x, 0.5 * y], ahead: [0.0; 2], ahead_s: 0.0, touch: Touch::INK }
    }
}

/// One closed step for learning and judging; made by [`super::Previewer::observe`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnStep {
    /// Index k of the grid.
    pub index: u64,
    /// Only `Continues` is learned from; the others clear the memory.
    pub motion: Motion,
    /// Position of the pen at its end, plane frame \[m\].
    pub position: [f64; 2],
    /// What predictors observe; no displacement unless the motion continues.
    pub pen: PenStep,
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
            motion: Motion::default(),
            position: [0.0; 2],
            pen: PenStep::default(),
            scale_m: 1e-4,
            limit: f64::INFINITY,
            level: REST,
        }
    }
}
