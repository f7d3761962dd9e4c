//! `DybmEsnLearner`: one online gradient step per input for the DyBM's parameters and the read-out A.

use std::sync::Arc;

use crate::predict::models::dybm::{
    Ascent, DybmSettings, DybmWeights, Optimiser, ParameterGroup, Parameters, Powers, Pull, difference,
};
use crate::predict::models::esn::{DybmEsnState, DybmEsnWeights, Reservoir, UNITS, judge};
use crate::predict::online::{ModelParameters, OnlineModel, WeightsError, is_usable};

/// The error on which the read-out learns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ReadoutRule {
    /// x − s A, its own error: the reference's rule.
    OwnError,
    /// x − μ, the error of the sum: g_A = s ⊗ d is then the gradient of the DyBM's likelihood.
    #[default]
    SharedResidual,
}

/// Learning rules of both parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DybmEsnSettings {
    /// Rule of the DyBM, on d = x − μ.
    pub dybm: DybmSettings,
    /// Rule of the read-out.
    pub readout: Optimiser,
    /// Error of the read-out.
    pub rule: ReadoutRule,
}

impl DybmEsnSettings {
    /// Checks every bound.
    ///
    /// # Errors
    ///
    /// The first bound that is broken.
    pub fn validate(&self) -> Result<(), WeightsError> {
        self.dybm.validate()?;
        self.readout.validate()
    }
}

type Readout = [[f64; 2]; UNITS];
const ZERO: Readout = [[0.0; 2]; UNITS];

/// Parameters that learn, with their own memory and accumulators.
#[derive(Debug, Clone, PartialEq)]
pub struct DybmEsnLearner {
    settings: DybmEsnSettings,
    reservoir: Arc<Reservoir>,
    weights: DybmEsnWeights,
    state: DybmEsnState,
    ascent: Ascent,
    second: Readout,
    first: Readout,
    powers: Powers,
}

impl DybmEsnLearner {
    /// Starts from `weights` with empty memory and accumulators.
    ///
    /// # Errors
    ///
    /// Invalid settings or weights, or weights of another shape or reservoir.
    pub fn new(
        settings: DybmEsnSettings,
        weights: DybmEsnWeights,
        reservoir: Arc<Reservoir>,
    ) -> Result<Self, WeightsError> {
        settings.validate()?;
        settings.dybm.judge(&weights.dybm)?;
        weights.validate()?;
        judge(&weights, &reservoir)?;
        Ok(Self {
            settings,
            reservoir,
            weights,
            state: DybmEsnState::default(),
            ascent: Ascent::new(settings.dybm),
            second: ZERO,
            first: ZERO,
            powers: Powers::START,
        })
    }

    /// A DyBM of zeros beside an untrained read-out: the paper's start.
    ///
    /// # Errors
    ///
    /// As `new`.
    pub fn untrained(
        settings: DybmEsnSettings,
        dybm: DybmWeights,
        reservoir: Arc<Reservoir>,
    ) -> Result<Self, WeightsError> {
        let weights = DybmEsnWeights::new(dybm, reservoir.digest());
        Self::new(settings, weights, reservoir)
    }

    /// The learning rules in force.
    #[must_use]
    pub fn settings(&self) -> &DybmEsnSettings {
        &self.settings
    }

    /// The reservoir, shared with the predictor.
    #[must_use]
    pub fn reservoir(&self) -> &Arc<Reservoir> {
        &self.reservoir
    }

    /// G of the DyBM's parameters.
    #[must_use]
    pub fn second_moments(&self) -> &Parameters {
        self.ascent.second_moments()
    }

    /// G of the read-out, UNITS x 2.
    #[must_use]
    pub fn readout_second_moments(&self) -> &[[f64; 2]; UNITS] {
        &self.second
    }

    fn exchange(&mut self, weights: &DybmEsnWeights) -> Result<(), WeightsError> {
        weights.validate()?;
        self.weights.accepts(weights)?;
        self.weights = *weights;
        Ok(())
    }

    fn learn_readout(&mut self, error: [f64; 2]) {
        let [dx, dy] = error;
        let gradient = self.state.reservoir.map(|s| [s * dx, s * dy]);
        self.powers.count(&self.settings.readout);
        let group = ParameterGroup {
            theta: self.weights.readout.as_flattened_mut(),
            second: self.second.as_flattened_mut(),
            first: self.first.as_flattened_mut(),
            gradient: gradient.as_flattened(),
        };
        self.settings.readout.ascend(&self.powers, Pull::NONE, group);
    }
}

impl OnlineModel for DybmEsnLearner {
    type Parameters = DybmEsnWeights;
    type Memory = DybmEsnState;

    fn learn(&mut self, x: [f64; 2]) -> [f64; 2] {
        let own = self.weights.contribution(&self.state);
        let ([mx, my], [dx, dy]) = (self.weights.dybm.predict(&self.state.dybm), own);
        let predicted = [mx + dx, my + dy];
        if is_usable(x) {
            let shared = difference(x, predicted);
            self.ascent.step(&mut self.weights.dybm, &self.state.dybm, shared);
            self.learn_readout(match self.settings.rule {
                ReadoutRule::OwnError => difference(x, own),
                ReadoutRule::SharedResidual => shared,
            });
        }
        self.observe(x);
        predicted
    }

    fn observe(&mut self, x: [f64; 2]) {
        if is_usable(x) {
            self.state.observe(&self.weights, &self.reservoir, x);
        } else {
            self.reset_state();
        }
    }

    fn reset_state(&mut self) {
        self.state = DybmEsnState::default();
    }

    fn parameters(&self) -> &DybmEsnWeights {
        &self.weights
    }

    fn memory(&self) -> &DybmEsnState {
        &self.state
    }

    fn continue_from(&mut self, parameters: &DybmEsnWeights) -> Result<(), WeightsError> {
        self.exchange(parameters)
    }

    fn restart_from(&mut self, parameters: &DybmEsnWeights) -> Result<(), WeightsError> {
        self.exchange(parameters)?;
        self.ascent = Ascent::new(self.settings.dybm);
        (self.second, self.first, self.powers) = (ZERO, ZERO, Powers::START);
        Ok(())
    }

    fn preview_from(
        &self,
        parameters: &DybmEsnWeights,
        memory: &DybmEsnState,
        limit: f64,
        out: &mut [[f64; 2]],
    ) {
        let (dybm, readout) = ((&parameters.dybm, &memory.dybm), (&parameters.readout, &memory.reservoir));
        self.reservoir.double.roll_out(dybm, readout, limit, out);
    }
}
