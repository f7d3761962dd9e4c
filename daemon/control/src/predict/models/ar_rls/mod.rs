//! AR-RLS: the next displacement as a linear function of the last [`ORDER`], learned by recursive least
//! squares.
//!
//! x̂ = Σ_l x[t−l] A_l, both axes predicted from both. A displacement longer than the gate is a jump, not
//! motion: it clears the memory and nothing is learned from it or across it. Parameters ([`ArRlsWeights`]),
//! memory ([`ArRlsState`]) and the learner's covariance ([`ArRlsLearner`]) are separate, as for the DyBM.
//! Source: recursive least squares with exponential forgetting (Ljung, System Identification, section 11.2),
//! with a Huber-clipped innovation.

mod weights;
mod learner;

use crate::state::state;
pub use learner::{ArRlsCounters, ArRlsLearner, ArRlsSettings};
pub use weights::ArRlsWeights;

use crate::predict::online::{ModelParameters, WeightsError};
use crate::predict::{Entry, Models, OnlinePredictor, Pace, Predictor, shortened};

pub(super) const ENTRY: Entry =
    Entry::taught::<ArRls>("autoregression by recursive least squares, learning online");

/// Order: displacements in the regressor.
pub const ORDER: usize = 8;
/// Numbers in the regressor: two axes each.
pub const REGRESSORS: usize = 2 * ORDER;

/// The last displacements, newest first; ORDER x 2, zero before the first.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ArRlsState {
    /// x[t−1] … x[t−ORDER].
    pub recent: [[f64; 2]; ORDER],
}

state! { [] ArRlsState { recent } }

impl ArRlsState {
    /// Takes in one displacement.
    #[inline]
    pub fn observe(&mut self, x: [f64; 2]) {
        self.recent.rotate_right(1);
        if let Some(newest) = self.recent.first_mut() {
            *newest = x;
        }
    }

    /// φ, the REGRESSORS numbers that are remembered.
    #[inline]
    pub(crate) fn regressor(&self) -> &[f64] {
        self.recent.as_flattened()
    }
}

/// The predictor: parameters and memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArRls {
    weights: ArRlsWeights,
    state: ArRlsState,
    gate: f64,
}

state! { [] ArRls { weights, state } fixed { gate } }

impl ArRls {
    /// Starts with empty memory; displacements longer than `gate` (in units of the inputs, in the plane) are
    /// jumps.
    ///
    /// # Errors
    ///
    /// Invalid weights, or a gate that is not positive.
    pub fn new(weights: ArRlsWeights, gate: f64) -> Result<Self, WeightsError> {
        weights.validate()?;
        ArRlsSettings::judge_gate(gate)?;
        Ok(Self { weights, state: ArRlsState::default(), gate })
    }

    /// What it remembers of the pen.
    #[must_use]
    pub fn state(&self) -> &ArRlsState {
        &self.state
    }
}

impl OnlinePredictor for ArRls {
    const NAME: &'static str = "ar-rls";
    const PACE: Pace = Pace::Following;
    type Learner = ArRlsLearner;

    fn start(models: &Models) -> ArRlsWeights {
        ArRlsWeights::constant_velocity(models.settings().step_ns)
    }

    fn predictor(models: &Models, weights: &ArRlsWeights) -> Result<Self, WeightsError> {
        Self::new(*weights, models.settings().ar_rls.gate)
    }

    fn learner(models: &Models, weights: &ArRlsWeights) -> Result<ArRlsLearner, WeightsError> {
        ArRlsLearner::new(models.settings().ar_rls, *weights)
    }

    fn weights(&self) -> &ArRlsWeights {
        &self.weights
    }

    fn set_weights(&mut self, weights: &ArRlsWeights) -> Result<(), WeightsError> {
        weights.validate()?;
        self.weights.accepts(weights)?;
        self.weights = *weights;
        Ok(())
    }
}

impl Predictor for ArRls {
    fn observe(&mut self, x: [f64; 2]) {
        if is_motion(x, self.gate) {
            self.state.observe(x);
        } else {
            self.reset();
        }
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        roll_out(&self.weights, self.state, limit, out);
    }

    fn reset(&mut self) {
        self.state = ArRlsState::default();
    }
}

/// `x` is no longer than `gate`; NaN is not motion.
#[inline]
fn is_motion(x: [f64; 2], gate: f64) -> bool {
    let [a, b] = x;
    a * a + b * b <= gate * gate
}

/// Predicts `out.len()` steps from a copy of the memory, each prediction (shortened to `limit`) fed back.
pub(super) fn roll_out(weights: &ArRlsWeights, mut state: ArRlsState, limit: f64, out: &mut [[f64; 2]]) {
    for predicted in out {
        *predicted = shortened(weights.predict(&state), limit);
        state.observe(*predicted);
    }
}
