//! The newest sample relative to a preview: what it tells beyond its position.

use super::blend::BlendTerms;
use crate::state::state;

/// What the newest sample tells beyond its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SampleMotion {
    /// Sample − preview at its time \[m\].
    pub(crate) innovation: [f64; 2],
    /// Velocity \[m/step\] and acceleration \[m/step²\] of the pen.
    pub(crate) velocity: [f64; 2],
    pub(crate) acceleration: [f64; 2],
}

state! { whole [] SampleMotion { innovation, velocity, acceleration } }

impl SampleMotion {
    /// Neither a jump nor a filter's response to one, nor NaN; `leap`: the largest ordinary value \[m,
    /// m/step, m/step² per axis\].
    pub(super) fn is_ordinary(&self, leap: f64) -> bool {
        let values = self.innovation.iter().chain(&self.velocity).chain(&self.acceleration);
        values.into_iter().all(|v| v.abs() <= leap)
    }

    /// The terms of a correction for a remaining predicted displacement of `left` \[m\], `ahead` steps after
    /// the sample.
    pub(crate) fn terms(&self, left: [f64; 2], ahead: f64) -> BlendTerms {
        let by_acceleration = self.acceleration.map(|a| 0.5 * ahead * ahead * a);
        [left, self.innovation, self.velocity.map(|v| ahead * v), by_acceleration]
    }
}

/// The newest sample, relative to a preview.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refinement {
    /// Its position \[m\].
    pub(crate) newest: [f64; 2],
    /// Its time after the base of the preview \[steps\].
    pub(crate) phase: f64,
    /// Its innovation and motion; `None`: the preview is used without a newer sample.
    pub(crate) motion: Option<SampleMotion>,
}

state! { whole [] Refinement { newest, phase, motion } }

impl Refinement {
    /// Nothing newer than the base of the preview at `base` \[m\].
    #[must_use]
    pub const fn at(base: [f64; 2]) -> Self {
        Self { newest: base, phase: 0.0, motion: None }
    }
}

/// The displacement to `there` \[m\] from `here` \[m\].
pub(crate) fn from(there: [f64; 2], here: [f64; 2]) -> [f64; 2] {
    let ([tx, ty], [x, y]) = (there, here);
    [tx - x, ty - y]
}
