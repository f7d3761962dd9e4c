//! `ArRlsWeights`: the coefficients of both axes, a plain copy that can cross threads.

use crate::pen::TARGET_RMS;
use crate::predict::models::ar_rls::{ArRlsState, ORDER};
use crate::predict::online::{ModelParameters, WeightsError};
use crate::state::state;

/// Parameters of the autoregressive model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArRlsWeights {
    /// Counts every change of the live weights.
    pub version: u64,
    /// Δ they were learned at \[ns\].
    pub step_ns: u64,
    /// RMS per component of the displacements they were learned on.
    pub input_scale: f64,
    /// A_1 … A_ORDER, newest first, in x out each: x̂ = Σ_l x[t−l] A_l; ORDER x 2 x 2.
    pub coefficients: [[[f64; 2]; 2]; ORDER],
}

state! { [] ArRlsWeights { version, step_ns, input_scale, coefficients } }

impl ArRlsWeights {
    /// Largest magnitude of a coefficient: 100 times that of constant velocity.
    pub const MAX_MAGNITUDE: f64 = 100.0;

    /// A useful start: constant velocity (A_1 = I).
    #[must_use]
    pub fn constant_velocity(step_ns: u64) -> Self {
        let mut coefficients = [[[0.0; 2]; 2]; ORDER];
        if let Some(newest) = coefficients.first_mut() {
            *newest = [[1.0, 0.0], [0.0, 1.0]];
        }
        Self { version: 0, step_ns, input_scale: TARGET_RMS, coefficients }
    }

    /// x̂ for the next step.
    #[must_use]
    #[inline]
    pub fn predict(&self, state: &ArRlsState) -> [f64; 2] {
        let [mut x, mut y] = [0.0; 2];
        for ([a, b], phi) in self.coefficients.as_flattened().iter().zip(state.regressor()) {
            x += phi * a;
            y += phi * b;
        }
        [x, y]
    }

    /// The coefficients as REGRESSORS rows of 2.
    #[inline]
    pub(super) fn rows_mut(&mut self) -> &mut [[f64; 2]] {
        self.coefficients.as_flattened_mut()
    }
}

impl ModelParameters for ArRlsWeights {
    const MODEL: &'static str = "AR-RLS";

    fn version(&self) -> u64 {
        self.version
    }

    fn with_version(self, version: u64) -> Self {
        Self { version, ..self }
    }

    fn step_ns(&self) -> u64 {
        self.step_ns
    }

    fn input_scale(&self) -> f64 {
        self.input_scale
    }

    fn validate(&self) -> Result<(), WeightsError> {
        let coefficients = self.coefficients.iter().flatten().flatten().copied();
        WeightsError::all_within(Self::MODEL, Self::MAX_MAGNITUDE, coefficients)
    }

    fn accepts(&self, other: &Self) -> Result<(), WeightsError> {
        other.fits(self.step_ns)
    }
}
