//! `DybmEsnWeights`: the DyBM's parameters and the read-out A, a plain copy that can cross threads.

use crate::predict::models::dybm::DybmWeights;
use crate::predict::models::esn::network::read;
use crate::predict::models::esn::{DybmEsnState, UNITS};
use crate::predict::online::{ModelParameters, WeightsError};
use crate::state::state;

/// Parameters of a DyBM with an echo state network beside it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DybmEsnWeights {
    /// b, W, V, with version, step and shape of the whole.
    pub dybm: DybmWeights,
    /// A, UNITS x 2 (unit x out).
    pub readout: [[f64; 2]; UNITS],
    /// Digest of the reservoir that A reads.
    pub reservoir: u64,
}

state! { [] DybmEsnWeights { dybm, readout, reservoir } }

impl DybmEsnWeights {
    /// Largest magnitude of A's entries; a unit's state is within ±1, so this is a displacement \[per axis\].
    pub const MAX_READOUT: f64 = 1e4;

    /// A = 0 beside `dybm`.
    #[must_use]
    pub fn new(dybm: DybmWeights, reservoir: u64) -> Self {
        Self { dybm, readout: [[0.0; 2]; UNITS], reservoir }
    }

    /// s A, the reservoir's part of the prediction.
    #[must_use]
    #[inline]
    pub fn contribution(&self, state: &DybmEsnState) -> [f64; 2] {
        read(&self.readout, &state.reservoir)
    }

    /// μ for the next step.
    #[must_use]
    #[inline]
    pub fn predict(&self, state: &DybmEsnState) -> [f64; 2] {
        let ([x, y], [dx, dy]) = (self.dybm.predict(&state.dybm), self.contribution(state));
        [x + dx, y + dy]
    }
}

impl ModelParameters for DybmEsnWeights {
    const MODEL: &'static str = "DyBM+ESN";

    fn version(&self) -> u64 {
        self.dybm.version
    }

    fn with_version(self, version: u64) -> Self {
        Self { dybm: self.dybm.with_version(version), ..self }
    }

    fn step_ns(&self) -> u64 {
        self.dybm.step_ns
    }

    fn input_scale(&self) -> f64 {
        self.dybm.input_scale
    }

    fn validate(&self) -> Result<(), WeightsError> {
        self.dybm.validate()?;
        WeightsError::all_within(Self::MODEL, Self::MAX_READOUT, self.readout.iter().flatten().copied())
    }

    fn accepts(&self, other: &Self) -> Result<(), WeightsError> {
        self.dybm.accepts(&other.dybm)?;
        if other.reservoir != self.reservoir {
            return Err(WeightsError::Reservoir { got: other.reservoir, wanted: self.reservoir });
        }
        Ok(())
    }
}
