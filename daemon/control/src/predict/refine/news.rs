//! What the newest sample says beyond its position.

use super::blend::Terms;

/// What the newest sample says beyond its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct News {
    /// Sample − preview at its instant \[m\].
    pub(crate) innovation: [f64; 2],
    /// Velocity \[m/step\] and acceleration \[m/step²\] of the pen.
    pub(crate) velocity: [f64; 2],
    pub(crate) acceleration: [f64; 2],
}

impl News {
    /// Neither a leap nor what a filter makes of one, nor no number; `leap`: the largest that is none \[m,
    /// m/step, m/step² per axis\].
    pub(super) fn is_ordinary(&self, leap: f64) -> bool {
        let said = self.innovation.iter().chain(&self.velocity).chain(&self.acceleration);
        said.into_iter().all(|v| v.abs() <= leap)
    }

    /// The terms of a correction for `left` \[m\] of predicted way, `ahead` steps after the sample.
    pub(crate) fn terms(&self, left: [f64; 2], ahead: f64) -> Terms {
        let by_acceleration = self.acceleration.map(|a| 0.5 * ahead * ahead * a);
        [left, self.innovation, self.velocity.map(|v| ahead * v), by_acceleration]
    }
}

/// What a preview is refined by: the newest sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Where it lies \[m\].
    pub(crate) newest: [f64; 2],
    /// How far in the step it lies, after the base of the preview \[steps\].
    pub(crate) phase: f64,
    /// What it says; `None`: the preview stands without a newer sample.
    pub(crate) news: Option<News>,
}

impl Look {
    /// Nothing newer than the base of the preview at `base` \[m\].
    #[must_use]
    pub const fn at(base: [f64; 2]) -> Self {
        Self { newest: base, phase: 0.0, news: None }
    }
}

/// The way to `there` \[m\] from `here` \[m\].
pub(crate) fn from(there: [f64; 2], here: [f64; 2]) -> [f64; 2] {
    let ([tx, ty], [x, y]) = (there, here);
    [tx - x, ty - y]
}
