//! DyBM + ESN: the sum of a linear DyBM and an echo state network, μ = μ_DyBM + s A.
//!
//! The reservoir s receives the same displacements and is fixed; A learns. Parameters ([`DybmEsnWeights`]),
//! memory ([`DybmEsnState`]) and accumulators ([`DybmEsnLearner`]) are separate, as for the linear DyBM.
//! Source: Dasgupta & Osogami 2017, as in IBM's reference implementation, whose numbers the tests reproduce.

mod network;
mod reservoir;
mod weights;
mod learner;

use crate::state::state;
pub use learner::{DybmEsnLearner, DybmEsnSettings, ReadoutRule};
pub use reservoir::{Reservoir, ReservoirSettings, ReservoirState, UNITS};
pub use weights::DybmEsnWeights;

use std::sync::Arc;

use crate::predict::models::dybm::{Dybm, DybmState};
use crate::predict::online::{ModelParameters, WeightsError, is_usable};
use crate::predict::{Entry, ModelSettings, Models, OnlinePredictor, Pace, Predictor};

pub(super) const ENTRY: Entry =
    Entry::taught::<DybmEsn>("DyBM with an echo state network beside it, learning online");

/// Memory of the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DybmEsnState {
    /// FIFO and traces of the DyBM.
    pub dybm: DybmState,
    /// s, the state of the reservoir.
    pub reservoir: ReservoirState,
}

state! { [] DybmEsnState { dybm, reservoir } }

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
///
/// Its memory is exact; roll-outs are computed in single precision from there, which halves their time at an
/// error below 1e-4 of a typical displacement after ten steps. [`DybmEsnLearner`] rolls out in double
/// precision.
#[derive(Debug, Clone, PartialEq)]
pub struct DybmEsn {
    weights: DybmEsnWeights,
    /// A in single precision.
    readout: [[f32; 2]; UNITS],
    state: DybmEsnState,
    reservoir: Arc<Reservoir>,
}

state! { [] DybmEsn { weights, readout, state } fixed { reservoir } }

impl DybmEsn {
    /// Starts with empty memory.
    ///
    /// # Errors
    ///
    /// Invalid weights, or weights of another reservoir.
    pub fn new(weights: DybmEsnWeights, reservoir: Arc<Reservoir>) -> Result<Self, WeightsError> {
        weights.validate()?;
        judge(&weights, &reservoir)?;
        Ok(Self { weights, readout: single(&weights.readout), state: DybmEsnState::default(), reservoir })
    }

    /// What it remembers of the pen.
    #[must_use]
    pub fn state(&self) -> &DybmEsnState {
        &self.state
    }
}

impl OnlinePredictor for DybmEsn {
    const NAME: &'static str = "dybm-esn";
    const PACE: Pace = Pace::Settled;
    type Learner = DybmEsnLearner;

    fn start(models: &Models) -> DybmEsnWeights {
        DybmEsnWeights::new(Dybm::start(models), models.reservoir().digest())
    }

    fn predictor(models: &Models, weights: &DybmEsnWeights) -> Result<Self, WeightsError> {
        Self::new(*weights, models.reservoir().clone())
    }

    fn learner(models: &Models, weights: &DybmEsnWeights) -> Result<DybmEsnLearner, WeightsError> {
        let ModelSettings { dybm, readout, .. } = *models.settings();
        let settings = DybmEsnSettings { dybm, readout, rule: ReadoutRule::SharedResidual };
        DybmEsnLearner::new(settings, *weights, models.reservoir().clone())
    }

    fn weights(&self) -> &DybmEsnWeights {
        &self.weights
    }

    fn set_weights(&mut self, weights: &DybmEsnWeights) -> Result<(), WeightsError> {
        weights.validate()?;
        self.weights.accepts(weights)?;
        self.weights = *weights;
        self.readout = single(&weights.readout);
        Ok(())
    }
}

impl Predictor for DybmEsn {
    fn observe(&mut self, x: [f64; 2]) {
        if is_usable(x) {
            self.state.observe(&self.weights, &self.reservoir, x);
        } else {
            self.reset();
        }
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        let dybm = (&self.weights.dybm, &self.state.dybm);
        self.reservoir.single.roll_out(dybm, (&self.readout, &self.state.reservoir), limit, out);
    }

    fn reset(&mut self) {
        self.state = DybmEsnState::default();
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

fn single(readout: &[[f64; 2]; UNITS]) -> [[f32; 2]; UNITS] {
    readout.map(|row| row.map(|a| a as f32))
}
