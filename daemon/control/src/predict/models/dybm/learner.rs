//! `DybmLearner`: one online gradient step per input (gradient *ascent* of the Gaussian log-likelihood).
//!
//! With d = x − μ: g_b = d, g_W\[l\] = f_l ⊗ d, g_V\[k\] = e_k ⊗ d, all with the parameters from before the
//! step; L2 is subtracted from the gradient (twice for W and b, once for V, as in the reference), L1 shrinks
//! after the step.

use crate::predict::models::dybm::optimiser::{Optimiser, ParameterGroup, Powers, Pull};
use crate::predict::models::dybm::{DybmShape, DybmState, DybmWeights, Parameters, roll_out};
use crate::predict::online::{ModelParameters, OnlineModel, WeightsError, is_usable};

/// Shape and learning rule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DybmSettings {
    /// Size and time constants.
    pub shape: DybmShape,
    /// How parameters follow their gradients.
    pub optimiser: Optimiser,
    /// Strength of the soft threshold after each step, in units of the step size.
    pub l1: f64,
    /// Strength of the pull to zero in each gradient.
    pub l2: f64,
}

impl DybmSettings {
    /// Checks every bound.
    ///
    /// # Errors
    ///
    /// The first bound that is broken.
    pub fn validate(&self) -> Result<(), WeightsError> {
        self.shape.validate()?;
        self.optimiser.validate()?;
        for (name, got) in [("l1", self.l1), ("l2", self.l2)] {
            WeightsError::bounded(DybmWeights::MODEL, name, got, 0.0, 1.0)?;
        }
        Ok(())
    }

    /// Checks that `weights` are usable and of this shape.
    ///
    /// # Errors
    ///
    /// The first bound that is broken.
    pub(crate) fn judge(&self, weights: &DybmWeights) -> Result<(), WeightsError> {
        weights.validate()?;
        if weights.shape != self.shape {
            let (got_delay, loop_delay) = (weights.shape.delay, self.shape.delay);
            return Err(WeightsError::Shape { got_delay, loop_delay });
        }
        Ok(())
    }
}

/// The learning rule with its accumulators; parameters and memory belong to the caller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ascent {
    settings: DybmSettings,
    second: Parameters,
    first: Parameters,
    powers: Powers,
}

impl Ascent {
    pub(crate) const fn new(settings: DybmSettings) -> Self {
        Self { settings, second: Parameters::ZERO, first: Parameters::ZERO, powers: Powers::START }
    }

    pub(crate) fn second_moments(&self) -> &Parameters {
        &self.second
    }

    /// One gradient step of `weights` for the error d = x − μ, for any μ.
    #[inline]
    pub(crate) fn step(&mut self, weights: &mut DybmWeights, state: &DybmState, error: [f64; 2]) {
        let DybmSettings { shape, optimiser, l1, l2 } = self.settings;
        self.powers.count(&optimiser);
        let gradient = state.outer(&shape, error);
        let (twice, once) = (Pull { l1, l2: 2.0 * l2 }, Pull { l1, l2 });
        let (theta, second, first) = (&mut weights.parameters, &mut self.second, &mut self.first);
        let bias = ParameterGroup {
            theta: &mut theta.bias,
            second: &mut second.bias,
            first: &mut first.bias,
            gradient: &error,
        };
        optimiser.ascend(&self.powers, twice, bias);
        let held = shape.fifo_len();
        let fifo = ParameterGroup {
            theta: flat(&mut theta.fifo, held),
            second: flat(&mut second.fifo, held),
            first: flat(&mut first.fifo, held),
            gradient: gradient.fifo.as_flattened().as_flattened(),
        };
        optimiser.ascend(&self.powers, twice, fifo);
        let traces = ParameterGroup {
            theta: flat(&mut theta.traces, shape.traces),
            second: flat(&mut second.traces, shape.traces),
            first: flat(&mut first.traces, shape.traces),
            gradient: gradient.traces.as_flattened().as_flattened(),
        };
        optimiser.ascend(&self.powers, once, traces);
    }
}

/// Weights that learn, with their own memory and accumulators.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DybmLearner {
    ascent: Ascent,
    weights: DybmWeights,
    state: DybmState,
}

impl DybmLearner {
    /// Starts from `weights` with empty memory and accumulators.
    ///
    /// # Errors
    ///
    /// Invalid settings or weights, or weights of another shape.
    pub fn new(settings: DybmSettings, weights: DybmWeights) -> Result<Self, WeightsError> {
        settings.validate()?;
        settings.judge(&weights)?;
        Ok(Self { ascent: Ascent::new(settings), weights, state: DybmState::default() })
    }

    /// The weights as they are now.
    #[must_use]
    pub fn weights(&self) -> &DybmWeights {
        &self.weights
    }

    /// What is remembered of the pen now.
    #[must_use]
    pub fn state(&self) -> &DybmState {
        &self.state
    }

    /// Shape and learning rule.
    #[must_use]
    pub fn settings(&self) -> &DybmSettings {
        &self.ascent.settings
    }

    /// G, the running (sum of) squared gradients.
    #[must_use]
    pub fn second_moments(&self) -> &Parameters {
        &self.ascent.second
    }

    /// M, Adam's running mean of gradients; zero for the others.
    #[must_use]
    pub fn first_moments(&self) -> &Parameters {
        &self.ascent.first
    }

    fn exchange(&mut self, weights: &DybmWeights) -> Result<(), WeightsError> {
        weights.validate()?;
        self.weights.accepts(weights)?;
        self.weights = *weights;
        Ok(())
    }
}

impl OnlineModel for DybmLearner {
    type Parameters = DybmWeights;
    type Memory = DybmState;

    #[inline]
    fn learn(&mut self, x: [f64; 2]) -> [f64; 2] {
        let predicted = self.weights.predict(&self.state);
        if is_usable(x) {
            self.ascent.step(&mut self.weights, &self.state, difference(x, predicted));
        }
        self.observe(x);
        predicted
    }

    #[inline]
    fn observe(&mut self, x: [f64; 2]) {
        if is_usable(x) {
            self.state.observe(&self.ascent.settings.shape, x);
        } else {
            self.reset_state();
        }
    }

    fn reset_state(&mut self) {
        self.state = DybmState::default();
    }

    fn parameters(&self) -> &DybmWeights {
        &self.weights
    }

    fn memory(&self) -> &DybmState {
        &self.state
    }

    fn continue_from(&mut self, parameters: &DybmWeights) -> Result<(), WeightsError> {
        self.exchange(parameters)
    }

    fn restart_from(&mut self, parameters: &DybmWeights) -> Result<(), WeightsError> {
        self.exchange(parameters)?;
        self.ascent = Ascent::new(self.ascent.settings);
        Ok(())
    }

    fn preview_from(&self, parameters: &DybmWeights, memory: &DybmState, limit: f64, out: &mut [[f64; 2]]) {
        roll_out(parameters, *memory, limit, out);
    }
}

/// The first `count` matrices as plain numbers.
#[inline]
fn flat(matrices: &mut [[[f64; 2]; 2]], count: usize) -> &mut [f64] {
    matrices.get_mut(..count).unwrap_or_default().as_flattened_mut().as_flattened_mut()
}

/// x − μ, what the prediction missed.
#[inline]
pub(crate) fn difference(x: [f64; 2], mean: [f64; 2]) -> [f64; 2] {
    let ([x, y], [mean_x, mean_y]) = (x, mean);
    [x - mean_x, y - mean_y]
}
