//! `SpeedScale`: the running normaliser between metres and the units of the predictors.
//!
//! Normalised displacement = displacement / scale, with the scale chosen so that the RMS per component of
//! moving steps is about [`TARGET_RMS`]. Pauses do not shrink it, jumps do not affect it, one fast step
//! changes it little.

use super::{GridStep, Motion, PenError};
use crate::state::state;

/// RMS per component of a normalised displacement while the pen moves: the order of the reference recordings.
pub const TARGET_RMS: f64 = 10.0;

/// A pen with shorter steps rests [normalised, length in the plane]: a fourteenth of an ordinary step. Used
/// wherever motion is learned or judged.
pub const REST: f64 = 0.1 * TARGET_RMS;

/// Whether a step `x` \[normalised\] is rest. NaN counts as motion, so that it stays visible.
#[must_use]
#[inline]
pub fn rests([x, y]: [f64; 2]) -> bool {
    x * x + y * y < REST * REST
}

/// A step shorter than this share of the typical one is a pause or a turning point and has little weight.
const SLOW: f64 = 0.2;
/// That weight, so that a pause in which the pen trembles hardly matters.
const SLOW_WEIGHT: f64 = 0.05;
/// After this many slow steps without a fast one the scale is too large, and slow steps have full weight.
const SLOW_PATIENCE: u32 = 200;
/// A step longer than this many typical ones is clipped to that.
const FAST: f64 = 3.0;
/// Weight of the initial value in steps: after as many moving steps the pen's own speed has half the weight.
const PRIOR_STEPS: f64 = 20.0;

/// How the scale starts and how fast it adapts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedScaleSettings {
    /// Scale before any motion \[m per unit\]; 1e-4 is 0.14 m/s at a step of 10 ms, letters of 3 cm.
    pub initial_m: f64,
    /// Smallest scale \[m per unit\].
    pub min_m: f64,
    /// Largest scale \[m per unit\].
    pub max_m: f64,
    /// Memory in moving steps.
    pub memory_steps: f64,
    /// Smaller displacements are rest \[m\].
    pub still_m: f64,
    /// Largest relative change of the scale per step.
    pub max_change: f64,
}

impl Default for SpeedScaleSettings {
    fn default() -> Self {
        Self {
            initial_m: 1e-4,
            min_m: 1e-7,
            max_m: 1e-2,
            memory_steps: 500.0,
            still_m: 5e-6,
            max_change: 0.05,
        }
    }
}

/// The running scale \[m per normalised unit\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedScale {
    settings: SpeedScaleSettings,
    /// Mean squared displacement per component of moving steps \[m²\].
    mean_square: f64,
    /// Steps in that mean, up to the memory.
    weight: f64,
    /// Slow steps since the last fast one.
    slow_run: u32,
    scale_m: f64,
}

state! { [] SpeedScale { mean_square, weight, slow_run, scale_m } fixed { settings } }

impl SpeedScale {
    /// A scale at its initial value.
    ///
    /// # Errors
    ///
    /// [`PenError::Scale`] if the bounds do not enclose the initial value.
    pub fn new(settings: SpeedScaleSettings) -> Result<Self, PenError> {
        let SpeedScaleSettings { initial_m, min_m, max_m, memory_steps, still_m, max_change } = settings;
        let ordered = 0.0 < min_m && min_m <= initial_m && initial_m <= max_m && max_m.is_finite();
        let follows = memory_steps >= 10.0 && memory_steps.is_finite() && still_m >= 0.0 && max_change > 0.0;
        if !(ordered && follows) {
            return Err(PenError::Scale { initial_m, min_m, max_m, memory_steps });
        }
        let rms = initial_m * TARGET_RMS;
        Ok(Self { settings, mean_square: rms * rms, weight: PRIOR_STEPS, slow_run: 0, scale_m: initial_m })
    }

    /// Metres per normalised unit.
    #[must_use]
    pub fn metres_per_unit(&self) -> f64 {
        self.scale_m
    }

    /// Displacement \[m\] in normalised units at the present scale.
    #[must_use]
    pub fn normalise(&self, displacement: [f64; 2]) -> [f64; 2] {
        displacement.map(|d| d / self.scale_m)
    }

    /// Adapts to one grid step; only ordinary motion counts.
    pub fn observe(&mut self, step: &GridStep) {
        if step.motion != Motion::Continues {
            return;
        }
        let [x, y] = step.displacement;
        let length = x.hypot(y);
        if !(length > self.settings.still_m && length.is_finite()) {
            return;
        }
        let typical = (2.0 * self.mean_square).sqrt();
        self.slow_run = if length < SLOW * typical { self.slow_run.saturating_add(1) } else { 0 };
        let weight = if (1..=SLOW_PATIENCE).contains(&self.slow_run) { SLOW_WEIGHT } else { 1.0 };
        let counted = length.min(FAST * typical);
        self.weight = (self.weight + weight).min(self.settings.memory_steps);
        self.mean_square += (0.5 * counted * counted - self.mean_square) * weight / self.weight;
        let wanted = self.mean_square.sqrt() / TARGET_RMS;
        let change = 1.0 + self.settings.max_change;
        self.scale_m = wanted
            .clamp(self.scale_m / change, self.scale_m * change)
            .clamp(self.settings.min_m, self.settings.max_m);
        // The mean stays within the scale's bounds, or it would drift beyond what the scale can express.
        let (lowest, highest) = (self.settings.min_m * TARGET_RMS, self.settings.max_m * TARGET_RMS);
        self.mean_square = self.mean_square.clamp(lowest * lowest, highest * highest);
    }
}
