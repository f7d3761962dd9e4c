//! `ArRlsLearner`: one step of recursive least squares per displacement, both axes with one covariance.
//!
//! d = x − φᵀθ, clipped to ±Huber bound per axis; k = Pφ/(λ + φᵀPφ); θ ← θ + k dᵀ. Started from constant
//! velocity with a large P it is useful from the first steps on.

use crate::pen::TARGET_RMS;
use crate::predict::models::ar_rls::{ArRlsState, ArRlsWeights, REGRESSORS, is_motion, roll_out};
use crate::predict::models::covariance::Covariance;
use crate::predict::models::dybm::difference;
use crate::predict::online::{ModelParameters, OnlineModel, WeightsError};

/// How it learns; lengths in units of the inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArRlsSettings {
    /// λ, 0.9 to 1: a memory of 1/(1 − λ) steps.
    pub forgetting: f64,
    /// A displacement longer than this is a jump, not motion \[in the plane\].
    pub gate: f64,
    /// Largest innovation that is learned from fully \[per axis\].
    pub huber: f64,
    /// P₀ = this·I \[1/units²\], and the bound on P's mean diagonal up to which it forgets.
    pub covariance: f64,
}

impl Default for ArRlsSettings {
    fn default() -> Self {
        Self::for_rms(TARGET_RMS)
    }
}

impl ArRlsSettings {
    const MODEL: &'static str = ArRlsWeights::MODEL;

    /// The preset for displacements of that RMS per component: gate 4 RMS, Huber 0.6 RMS, λ 0.999.
    #[must_use]
    pub fn for_rms(rms: f64) -> Self {
        Self { forgetting: 0.999, gate: 4.0 * rms, huber: 0.6 * rms, covariance: 1.0 / (rms * rms) }
    }

    /// Checks every bound.
    ///
    /// # Errors
    ///
    /// The first bound that is broken.
    pub fn validate(&self) -> Result<(), WeightsError> {
        let within = |name, got, min, max| WeightsError::bounded(Self::MODEL, name, got, min, max);
        Self::judge_gate(self.gate)
            .and(within("forgetting", self.forgetting, 0.9, 1.0))
            .and(within("huber", self.huber, 1e-9 * self.gate, 1e3 * self.gate))
            .and(within("covariance", self.covariance, 1e-12, 1e12))
    }

    /// A gate that lets motion through.
    pub(super) fn judge_gate(gate: f64) -> Result<(), WeightsError> {
        WeightsError::bounded(Self::MODEL, "gate", gate, 1e-6, 1e6)
    }
}

/// What happened so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ArRlsCounters {
    /// Displacements that were learned from.
    pub learned: u64,
    /// Innovations that were clipped.
    pub clipped: u64,
    /// Jumps, NaN included: the memory was cleared.
    pub gated: u64,
    /// Resets of a P that was no covariance any more.
    pub restarted: u64,
}

/// Parameters that learn, with their own memory and covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArRlsLearner {
    settings: ArRlsSettings,
    weights: ArRlsWeights,
    state: ArRlsState,
    covariance: Covariance<REGRESSORS>,
    counters: ArRlsCounters,
}

/// Share of the gate below which the whole regressor carries no excitation: nothing is learned, and P does
/// not forget. A share, because the model knows no unit of length; unrelated to rest of the pen
/// ([`crate::pen::REST`]).
const LEAST_EXCITATION: f64 = 1e-3;

impl ArRlsLearner {
    /// Starts from `weights` with empty memory and P₀.
    ///
    /// # Errors
    ///
    /// Invalid settings or weights.
    pub fn new(settings: ArRlsSettings, weights: ArRlsWeights) -> Result<Self, WeightsError> {
        settings.validate()?;
        weights.validate()?;
        Ok(Self {
            settings,
            weights,
            state: ArRlsState::default(),
            covariance: Covariance::new(settings.covariance, 1.0),
            counters: ArRlsCounters::default(),
        })
    }

    /// The settings in force.
    #[must_use]
    pub fn settings(&self) -> &ArRlsSettings {
        &self.settings
    }

    /// What happened so far.
    #[must_use]
    pub fn counters(&self) -> ArRlsCounters {
        self.counters
    }

    /// Trace of P: uncertainty of the coefficients.
    #[must_use]
    pub fn uncertainty(&self) -> f64 {
        self.covariance.trace()
    }

    fn update(&mut self, innovation: [f64; 2]) {
        let phi = self.state.regressor();
        let least = LEAST_EXCITATION * self.settings.gate;
        if phi.iter().map(|p| p * p).sum::<f64>() <= least * least {
            return;
        }
        let Some(gain) = self.covariance.update(phi, self.settings.forgetting) else {
            self.counters.restarted += 1;
            return;
        };
        let bound = self.settings.huber;
        let clipped = innovation.map(|d| d.clamp(-bound, bound));
        self.counters.learned += 1;
        self.counters.clipped += u64::from(clipped != innovation);
        for (row, k) in self.weights.rows_mut().iter_mut().zip(gain) {
            for (theta, d) in row.iter_mut().zip(clipped) {
                *theta += k * d;
            }
        }
    }

    fn exchange(&mut self, weights: &ArRlsWeights) -> Result<(), WeightsError> {
        weights.validate()?;
        self.weights.accepts(weights)?;
        self.weights = *weights;
        Ok(())
    }
}

impl OnlineModel for ArRlsLearner {
    type Parameters = ArRlsWeights;
    type Memory = ArRlsState;

    fn learn(&mut self, x: [f64; 2]) -> [f64; 2] {
        let predicted = self.weights.predict(&self.state);
        if is_motion(x, self.settings.gate) {
            self.update(difference(x, predicted));
        }
        self.observe(x);
        predicted
    }

    fn observe(&mut self, x: [f64; 2]) {
        if is_motion(x, self.settings.gate) {
            self.state.observe(x);
        } else {
            self.counters.gated += 1;
            self.reset_state();
        }
    }

    fn reset_state(&mut self) {
        self.state = ArRlsState::default();
    }

    fn parameters(&self) -> &ArRlsWeights {
        &self.weights
    }

    fn memory(&self) -> &ArRlsState {
        &self.state
    }

    fn continue_from(&mut self, parameters: &ArRlsWeights) -> Result<(), WeightsError> {
        self.exchange(parameters)
    }

    fn restart_from(&mut self, parameters: &ArRlsWeights) -> Result<(), WeightsError> {
        self.exchange(parameters)?;
        self.covariance = Covariance::new(self.settings.covariance, 1.0);
        Ok(())
    }

    fn preview_from(&self, parameters: &ArRlsWeights, memory: &ArRlsState, limit: f64, out: &mut [[f64; 2]]) {
        roll_out(parameters, *memory, limit, out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_without_a_covariance_are_counted_and_teach_nothing() {
        let settings = ArRlsSettings::default();
        let start = ArRlsWeights::constant_velocity(10_000_000);
        let mut learner = ArRlsLearner::new(settings, start).unwrap();
        learner.learn([3.0, -2.0]);
        for count in 1..4 {
            learner.covariance = Covariance::new(f64::NAN, 1.0);
            learner.learn([5.0, 1.0]);
            let counters = learner.counters();
            assert_eq!((counters.restarted, counters.learned), (count, 0));
            assert_eq!(learner.weights, start);
        }
    }

    #[test]
    fn lessons_are_counted_and_those_that_were_clipped() {
        let settings = ArRlsSettings::default();
        let start = ArRlsWeights::constant_velocity(10_000_000);
        let mut learner = ArRlsLearner::new(settings, start).unwrap();
        let wild = [10.0, 2.0 * settings.huber];
        // Before the first displacement there is nothing to learn from.
        for (x, learned, clipped) in
            [([10.0, 0.0], 0, 0), ([10.0, 0.0], 1, 0), ([10.0, 0.1], 2, 0), (wild, 3, 1)]
        {
            learner.learn(x);
            let counters = learner.counters();
            assert_eq!((counters.learned, counters.clipped), (learned, clipped), "{x:?}");
        }
    }
}
