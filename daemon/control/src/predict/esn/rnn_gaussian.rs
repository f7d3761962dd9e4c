//! `RnnGaussianDybmLearner`: a Gaussian DyBM into whose bias a fixed random network writes.
//!
//! s ← (1 − leak)·s + leak·tanh(x W_in + s W_rec), then **b ← b + s A**: the bias itself accumulates, there is no direct
//! term in μ. g_A = s ⊗ (d/σ²), with its own L1 (1.0 in the reference).
//! Note: on handwriting this does worse than the plain DyBM, and a bias that sums up does not suit a loop that resets its
//! memory; it is here to make the family of the reference complete, not among the predictors one can choose.

use std::sync::Arc;

use super::{Reservoir, ReservoirState, UNITS};
use crate::predict::dybm::{
    DybmSettings, DybmState, GaussianDybmLearner, GaussianDybmWeights, Group, Parameters, Powers, Pull,
    difference,
};
use crate::predict::online::{OnlineModel, WeightsError};

type Readout = [[f64; 2]; UNITS];

/// Parameters, memory and accumulators of one learning run.
#[derive(Debug, Clone, PartialEq)]
pub struct RnnGaussianDybmLearner {
    settings: DybmSettings,
    gaussian: GaussianDybmLearner,
    reservoir: Arc<Reservoir>,
    state: ReservoirState,
    readout: Readout,
    second: Readout,
    first: Readout,
    powers: Powers,
    readout_l1: f64,
}

impl RnnGaussianDybmLearner {
    /// Starts from `weights` and A (UNITS x 2), with empty memory and accumulators.
    ///
    /// *Errors*: invalid settings or weights, weights of another shape, or an L1 outside 0 to 10.
    pub fn new(
        settings: DybmSettings,
        readout_l1: f64,
        weights: GaussianDybmWeights,
        readout: [[f64; 2]; UNITS],
        reservoir: Arc<Reservoir>,
    ) -> Result<Self, WeightsError> {
        WeightsError::bounded("RNN-Gaussian DyBM", "readout L1", readout_l1, 0.0, 10.0)?;
        let numbers = readout.iter().flatten().copied();
        WeightsError::all_within("RNN-Gaussian DyBM", super::DybmEsnWeights::MAX_READOUT, numbers)?;
        let zero = [[0.0; 2]; UNITS];
        Ok(Self {
            settings,
            gaussian: GaussianDybmLearner::new(settings, weights)?,
            reservoir,
            state: [0.0; UNITS],
            readout,
            second: zero,
            first: zero,
            powers: Powers::START,
            readout_l1,
        })
    }

    /// Learns from one real displacement, then remembers it; returns the prediction made before seeing it.
    pub fn learn(&mut self, x: [f64; 2]) -> [f64; 2] {
        let weights = *self.gaussian.parameters();
        let predicted = weights.dybm.predict(self.gaussian.memory());
        let error = difference(x, predicted);
        let ([dx, dy], [sx, sy]) = (error, weights.deviation);
        let (ex, ey) = (dx / (sx * sx), dy / (sy * sy));
        let gradient = self.state.map(|s| [s * ex, s * ey]);
        self.gaussian.step(error);
        self.powers.count(&self.settings.optimiser);
        let group = Group {
            theta: self.readout.as_flattened_mut(),
            second: self.second.as_flattened_mut(),
            first: self.first.as_flattened_mut(),
            gradient: gradient.as_flattened(),
        };
        self.settings.optimiser.ascend(&self.powers, Pull { l1: self.readout_l1, l2: 0.0 }, group);
        self.observe(x);
        predicted
    }

    /// Remembers a displacement; the network moves the bias all the same.
    pub fn observe(&mut self, x: [f64; 2]) {
        self.gaussian.observe(x);
        self.reservoir.observe(&mut self.state, x);
        let bias = self.gaussian.bias_mut();
        for (row, s) in self.readout.iter().zip(&self.state) {
            for (bias, a) in bias.iter_mut().zip(row) {
                *bias += s * a;
            }
        }
    }

    /// Forgets the history, the network's included.
    pub fn reset_state(&mut self) {
        self.gaussian.reset_state();
        self.state = [0.0; UNITS];
    }

    /// b, W, V and σ.
    #[must_use]
    pub fn weights(&self) -> &GaussianDybmWeights {
        self.gaussian.parameters()
    }

    /// A, UNITS x 2.
    #[must_use]
    pub fn readout(&self) -> &[[f64; 2]; UNITS] {
        &self.readout
    }

    /// FIFO and traces.
    #[must_use]
    pub fn memory(&self) -> &DybmState {
        self.gaussian.memory()
    }

    /// s.
    #[must_use]
    pub fn reservoir_state(&self) -> &ReservoirState {
        &self.state
    }

    /// G of b, W, V; of σ; of A.
    #[must_use]
    pub fn second_moments(&self) -> (&Parameters, [f64; 2], &[[f64; 2]; UNITS]) {
        (self.gaussian.second_moments(), self.gaussian.deviation_second_moments(), &self.second)
    }
}
