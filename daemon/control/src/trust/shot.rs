//! Previews that wait for what they foresaw, and what newer samples said about them.

use super::blend::Terms;
use super::evidence::EVIDENCE_LEADS;

/// News beyond this [normalised] tells of a leap, and nothing of where the pen goes next.
const LARGEST_NEWS: f64 = 150.0;

/// What the newest sample says beyond its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct News {
    /// Sample − preview at its instant [m].
    pub(super) innovation: [f64; 2],
    /// Velocity [m/step] and acceleration [m/step²] of the pen.
    pub(super) velocity: [f64; 2],
    pub(super) acceleration: [f64; 2],
}

impl News {
    /// Neither a leap nor what a filter makes of one, nor no number; `unit_m`: metres per normalised unit.
    pub(super) fn is_ordinary(&self, unit_m: f64) -> bool {
        let said = self.innovation.iter().chain(&self.velocity).chain(&self.acceleration);
        said.into_iter().all(|v| v.abs() <= LARGEST_NEWS * unit_m)
    }

    /// The terms of a correction for `left` [m] of predicted way, `ahead` steps after the sample.
    pub(super) fn terms(&self, left: [f64; 2], ahead: f64) -> Terms {
        let by_acceleration = self.acceleration.map(|a| 0.5 * ahead * ahead * a);
        [left, self.innovation, self.velocity.map(|v| ahead * v), by_acceleration]
    }
}

/// What a preview was corrected by: the newest sample [m] of then, where in the step it lay, and what it said.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    pub(super) newest: [f64; 2],
    /// Where the tool would be then [m] if it had been led by feedback alone.
    pub(super) held: [f64; 2],
    /// Steps since the pen began to move.
    pub(super) moved: u32,
    pub(super) phase: f64,
    pub(super) news: Option<News>,
}

/// One preview that waits for what it foresaw.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shot {
    /// Grid steps closed since.
    pub(super) age: usize,
    /// The last before the next grid point closed.
    pub(super) look: Look,
    /// One from an earlier part of the step: each part of it has to be learned, as each is used.
    pub(super) earlier: Option<Look>,
    /// Displacement before the preview [m]: what constant velocity goes on with.
    pub(super) velocity: [f64; 2],
    /// Predicted positions [m].
    pub(super) path: [[f64; 2]; EVIDENCE_LEADS],
    /// Index of the position for which the predictor named a band, and its radius [m].
    pub(super) claim: Option<(usize, f64)>,
}

impl Shot {
    pub(super) const EMPTY: Self = Self {
        age: 0,
        look: Look { newest: [0.0; 2], held: [0.0; 2], moved: 0, phase: 0.0, news: None },
        earlier: None,
        velocity: [0.0; 2],
        path: [[0.0; 2]; EVIDENCE_LEADS],
        claim: None,
    };
}

/// The way to `there` [m] from `here` [m].
pub(super) fn from(there: [f64; 2], here: [f64; 2]) -> [f64; 2] {
    let ([tx, ty], [x, y]) = (there, here);
    [tx - x, ty - y]
}
