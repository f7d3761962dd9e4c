//! A closed grid step as the learner receives it.

use crate::pen::{Motion, Touch};

/// What a predictor may see of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Normalised displacement.
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

impl Seen {
    /// An even displacement `x` of a pen on the paper: all that recordings of displacements hold.
    #[must_use]
    pub const fn of([x, y]: [f64; 2]) -> Self {
        Self { x: [x, y], half: [0.5 * x, 0.5 * y], ahead: [0.0; 2], ahead_s: 0.0, touch: Touch::INK }
    }
}

/// Input of the learner for one grid step; made by [`super::Previewer::observe`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearnStep {
    /// Grid index k.
    pub index: u64,
    /// Normalised displacement, zero unless the motion continues.
    pub x: [f64; 2],
    /// Its part in the first half of the step.
    pub half: [f64; 2],
    /// From the step's end to the newest sample, normalised; zero where that is not known.
    pub ahead: [f64; 2],
    /// How long after the step's end that sample is stamped \[s\].
    pub ahead_s: f64,
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
    /// What predictors see of it.
    #[must_use]
    pub const fn seen(&self) -> Seen {
        let touch = Touch { contact: self.contact, steps: self.contact_steps };
        Seen { x: self.x, half: self.half, ahead: self.ahead, ahead_s: self.ahead_s, touch }
    }
}

impl Default for LearnStep {
    fn default() -> Self {
        Self {
            index: 0,
            x: [0.0; 2],
            half: [0.0; 2],
            ahead: [0.0; 2],
            ahead_s: 0.0,
            motion: Motion::default(),
            contact: false,
            contact_steps: 0,
            scale_m: 1e-4,
            limit: f64::INFINITY,
            level: crate::pen::REST,
        }
    }
}
