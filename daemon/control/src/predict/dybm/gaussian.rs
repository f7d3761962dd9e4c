//! `GaussianDybm`: the linear DyBM with a learned standard deviation σ per axis.
//!
//! Natural gradient: b, W and V learn exactly as in the linear DyBM (no division by σ²), g_σ = d²/(2σ) − σ/2, no L1 or
//! L2 on σ. Predictions do not depend on σ; it says how wrong they usually are.

use super::super::online::{ModelParameters, OnlineModel, WeightsError, is_usable};
use super::{
    Ascent, DybmSettings, DybmState, DybmWeights, Group, Parameters, Powers, Pull, difference, roll_out,
};

/// Parameters of a Gaussian DyBM.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussianDybmWeights {
    /// b, W, V, with version, step and shape of the whole.
    pub dybm: DybmWeights,
    /// σ, 2, in units of the inputs.
    pub deviation: [f64; 2],
}

impl GaussianDybmWeights {
    /// Smallest σ: g_σ has a pole at 0, and a first step of AdaGrad may aim beyond it.
    pub const MIN_DEVIATION: f64 = 1e-3;
    /// Largest σ.
    pub const MAX_DEVIATION: f64 = 1e6;

    /// The reference's start: σ = 1 beside `dybm`.
    #[must_use]
    pub const fn new(dybm: DybmWeights) -> Self {
        Self { dybm, deviation: [1.0; 2] }
    }
}

impl ModelParameters for GaussianDybmWeights {
    const MODEL: &'static str = "Gaussian DyBM";

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
        for sigma in self.deviation {
            let (least, most) = (Self::MIN_DEVIATION, Self::MAX_DEVIATION);
            WeightsError::bounded(Self::MODEL, "standard deviation", sigma, least, most)?;
        }
        Ok(())
    }

    fn accepts(&self, other: &Self) -> Result<(), WeightsError> {
        self.dybm.accepts(&other.dybm)
    }
}

/// Parameters that learn, with their own memory and accumulators.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussianDybmLearner {
    weights: GaussianDybmWeights,
    state: DybmState,
    ascent: Ascent,
    second: [f64; 2],
    first: [f64; 2],
    powers: Powers,
}

impl GaussianDybmLearner {
    /// Starts from `weights` with empty memory and accumulators.
    ///
    /// *Errors*: invalid settings or weights, or weights of another shape.
    pub fn new(settings: DybmSettings, weights: GaussianDybmWeights) -> Result<Self, WeightsError> {
        settings.validate()?;
        settings.judge(&weights.dybm)?;
        weights.validate()?;
        Ok(Self {
            weights,
            state: DybmState::default(),
            ascent: Ascent::new(settings),
            second: [0.0; 2],
            first: [0.0; 2],
            powers: Powers::START,
        })
    }

    /// G of b, W and V.
    #[must_use]
    pub fn second_moments(&self) -> &Parameters {
        self.ascent.second_moments()
    }

    /// G of σ.
    #[must_use]
    pub fn deviation_second_moments(&self) -> [f64; 2] {
        self.second
    }

    /// One step for b, W, V and σ; `error` = x − μ.
    pub(crate) fn step(&mut self, error: [f64; 2]) {
        let Self { weights, second, first, powers, .. } = self;
        let mut gradient = [0.0; 2];
        for ((g, d), sigma) in gradient.iter_mut().zip(error).zip(weights.deviation) {
            *g = 0.5 * d * d / sigma - 0.5 * sigma;
        }
        self.ascent.step(&mut weights.dybm, &self.state, error);
        let optimiser = self.ascent.settings().optimiser;
        powers.count(&optimiser);
        let group = Group { theta: &mut weights.deviation, second, first, gradient: &gradient };
        optimiser.ascend(powers, Pull::NONE, group);
        for sigma in &mut weights.deviation {
            // `max` also takes NaN to the floor.
            *sigma = sigma.max(GaussianDybmWeights::MIN_DEVIATION);
        }
    }

    /// b, for the variant that lets a network write into it.
    pub(crate) fn bias_mut(&mut self) -> &mut [f64; 2] {
        &mut self.weights.dybm.parameters.bias
    }

    fn exchange(&mut self, weights: &GaussianDybmWeights) -> Result<(), WeightsError> {
        weights.validate()?;
        self.weights.accepts(weights)?;
        self.weights = *weights;
        Ok(())
    }
}

impl OnlineModel for GaussianDybmLearner {
    type Parameters = GaussianDybmWeights;
    type Memory = DybmState;

    fn learn(&mut self, x: [f64; 2]) -> [f64; 2] {
        let predicted = self.weights.dybm.predict(&self.state);
        if is_usable(x) {
            self.step(difference(x, predicted));
        }
        self.observe(x);
        predicted
    }

    fn observe(&mut self, x: [f64; 2]) {
        if is_usable(x) {
            self.state.observe(&self.weights.dybm.shape, x);
        } else {
            self.reset_state();
        }
    }

    fn reset_state(&mut self) {
        self.state = DybmState::default();
    }

    fn parameters(&self) -> &GaussianDybmWeights {
        &self.weights
    }

    fn memory(&self) -> &DybmState {
        &self.state
    }

    fn continue_from(&mut self, parameters: &GaussianDybmWeights) -> Result<(), WeightsError> {
        self.exchange(parameters)
    }

    fn restart_from(&mut self, parameters: &GaussianDybmWeights) -> Result<(), WeightsError> {
        self.exchange(parameters)?;
        self.ascent = Ascent::new(*self.ascent.settings());
        (self.second, self.first, self.powers) = ([0.0; 2], [0.0; 2], Powers::START);
        Ok(())
    }

    fn preview_from(
        &self,
        parameters: &GaussianDybmWeights,
        memory: &DybmState,
        limit: f64,
        out: &mut [[f64; 2]],
    ) {
        roll_out(&parameters.dybm, *memory, limit, out);
    }
}
