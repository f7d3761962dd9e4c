//! DyBM + ESN: a linear DyBM and an echo state network whose predictions add up, μ = μ_DyBM + s A.
//!
//! The reservoir s sees the same displacements and is fixed; A learns. Parameters ([`DybmEsnWeights`]), memory
//! ([`DybmEsnState`]) and accumulators ([`DybmEsnLearner`]) are apart, as for the linear DyBM.
//! Source: Dasgupta & Osogami 2017, as in IBM's reference implementation whose numbers the tests reproduce.

mod reservoir;
mod weights;
mod learner;
mod rnn_gaussian;

pub use learner::{DybmEsnLearner, DybmEsnSettings, ReadoutRule};
pub use reservoir::{Reservoir, ReservoirSettings, ReservoirState, UNITS};
pub use rnn_gaussian::RnnGaussianDybmLearner;
pub use weights::DybmEsnWeights;

use std::sync::Arc;

use super::dybm::DybmState;
use super::online::{ModelParameters, WeightsError};
use super::{Predictor, shortened};

/// What the model remembers of the pen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DybmEsnState {
    /// FIFO and traces.
    pub dybm: DybmState,
    /// s.
    pub reservoir: ReservoirState,
}

impl Default for DybmEsnState {
    fn default() -> Self {
        Self { dybm: DybmState::default(), reservoir: [0.0; UNITS] }
    }
}

impl DybmEsnState {
    /// Takes in one displacement.
    #[inline]
    pub fn observe(&mut self, weights: &DybmEsnWeights, reservoir: &Reservoir, x: [f64; 2]) {
        self.dybm.observe(&weights.dybm.shape, x);
        reservoir.observe(&mut self.reservoir, x);
    }
}

/// The predictor: parameters, memory and the reservoir they belong to.
#[derive(Debug, Clone, PartialEq)]
pub struct DybmEsn {
    weights: DybmEsnWeights,
    state: DybmEsnState,
    reservoir: Arc<Reservoir>,
}

impl DybmEsn {
    /// Starts with empty memory.
    ///
    /// *Errors*: invalid weights, or weights of another reservoir.
    pub fn new(weights: DybmEsnWeights, reservoir: Arc<Reservoir>) -> Result<Self, WeightsError> {
        weights.validate()?;
        judge(&weights, &reservoir)?;
        Ok(Self { weights, state: DybmEsnState::default(), reservoir })
    }

    /// Exchanges the parameters and keeps the memory.
    ///
    /// *Errors*: invalid weights, or weights of another shape, reservoir, step or input scale; the old ones stay.
    pub fn set_weights(&mut self, weights: &DybmEsnWeights) -> Result<(), WeightsError> {
        weights.validate()?;
        self.weights.accepts(weights)?;
        self.weights = *weights;
        Ok(())
    }

    /// The parameters in use.
    #[must_use]
    pub fn weights(&self) -> &DybmEsnWeights {
        &self.weights
    }

    /// The memory.
    #[must_use]
    pub fn state(&self) -> &DybmEsnState {
        &self.state
    }
}

impl Predictor for DybmEsn {
    fn observe(&mut self, x: [f64; 2]) {
        self.state.observe(&self.weights, &self.reservoir, x);
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        roll_out(&self.weights, &self.reservoir, &self.state, limit, out);
    }

    fn reset(&mut self) {
        self.state = DybmEsnState::default();
    }
}

/// Predicts `out.len()` steps from a copy of the memory, each prediction (shortened to `limit`) fed back.
fn roll_out(
    weights: &DybmEsnWeights,
    reservoir: &Reservoir,
    state: &DybmEsnState,
    limit: f64,
    out: &mut [[f64; 2]],
) {
    let mut state = *state;
    let mut fed_back = None;
    for predicted in out {
        if let Some(x) = fed_back {
            state.observe(weights, reservoir, x);
        }
        *predicted = shortened(weights.predict(&state), limit);
        fed_back = Some(*predicted);
    }
}

/// The read-out was learned on this reservoir.
fn judge(weights: &DybmEsnWeights, reservoir: &Reservoir) -> Result<(), WeightsError> {
    if weights.reservoir == reservoir.digest() {
        Ok(())
    } else {
        Err(WeightsError::Reservoir { got: weights.reservoir, wanted: reservoir.digest() })
    }
}
