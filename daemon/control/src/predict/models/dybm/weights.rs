//! `DybmWeights`: parameters and what they were made for, a plain copy that can cross threads.

use crate::pen::TARGET_RMS;
use crate::predict::models::dybm::{DybmState, MAX_DELAY, MAX_FIFO, MAX_TRACES};
use crate::predict::online::{ModelParameters, WeightsError};
use crate::state::{choices, state};

/// What enters the eligibility traces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TraceInput {
    /// The newest input (the reference's `wo_delay`, its default).
    #[default]
    Newest,
    /// The input that leaves the FIFO (the reference's `w_delay`).
    Delayed,
}

choices! { TraceInput { Newest, Delayed } }

/// Size and time constants of a DyBM.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DybmShape {
    /// 2 … MAX_DELAY; the FIFO holds `delay` − 1 inputs.
    pub delay: usize,
    /// K, 1 … MAX_TRACES.
    pub traces: usize,
    /// λ_1 … λ_K in [0, 1); the rest is unused.
    pub decay_rates: [f64; MAX_TRACES],
    /// What enters the traces.
    pub trace_input: TraceInput,
}

state! { [] DybmShape { delay, traces, decay_rates, trace_input } }

impl DybmShape {
    /// A shape with the given delay and decay rates (at most [`MAX_TRACES`] are taken; `validate` judges the
    /// rest).
    #[must_use]
    pub fn new(delay: usize, decay_rates: &[f64], trace_input: TraceInput) -> Self {
        let mut rates = [0.0; MAX_TRACES];
        for (rate, given) in rates.iter_mut().zip(decay_rates) {
            *rate = *given;
        }
        Self { delay, traces: decay_rates.len(), decay_rates: rates, trace_input }
    }

    /// L, inputs in the FIFO.
    #[must_use]
    pub fn fifo_len(&self) -> usize {
        self.delay.saturating_sub(1).min(MAX_FIFO)
    }

    /// λ_1 … λ_K.
    pub fn decays(&self) -> impl Iterator<Item = f64> + '_ {
        self.decay_rates.iter().copied().take(self.traces)
    }

    /// Checks sizes and rates.
    ///
    /// # Errors
    ///
    /// The first bound that is broken.
    pub fn validate(&self) -> Result<(), WeightsError> {
        if !(2..=MAX_DELAY).contains(&self.delay) {
            return Err(WeightsError::Delay { got: self.delay, max: MAX_DELAY });
        }
        if !(1..=MAX_TRACES).contains(&self.traces) {
            return Err(WeightsError::Traces { got: self.traces, max: MAX_TRACES });
        }
        match self.decays().find(|rate| !(0.0 <= *rate && *rate < 1.0)) {
            Some(got) => Err(WeightsError::Decay { got }),
            None => Ok(()),
        }
    }
}

/// b, W and V, or a quantity per parameter (gradients, accumulators).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    /// b, 2.
    pub bias: [f64; 2],
    /// W_1 … W_L, in x out each; MAX_FIFO x 2 x 2, zero past L.
    pub fifo: [[[f64; 2]; 2]; MAX_FIFO],
    /// V_1 … V_K, in x out each; MAX_TRACES x 2 x 2, zero past K.
    pub traces: [[[f64; 2]; 2]; MAX_TRACES],
}

state! { [] Parameters { bias, fifo, traces } }

impl Parameters {
    /// Every parameter is zero.
    pub const ZERO: Self =
        Self { bias: [0.0; 2], fifo: [[[0.0; 2]; 2]; MAX_FIFO], traces: [[[0.0; 2]; 2]; MAX_TRACES] };

    /// Every number, in the order b, W, V.
    pub fn iter(&self) -> impl Iterator<Item = f64> + '_ {
        let matrices = self.fifo.iter().chain(&self.traces).flatten().flatten();
        self.bias.iter().chain(matrices).copied()
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self::ZERO
    }
}

/// Parameters with their shape and the loop that they fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DybmWeights {
    /// Counts every change of the live weights, promotions and rollbacks alike.
    pub version: u64,
    /// Δ they were learned at \[ns\].
    pub step_ns: u64,
    /// RMS per component of the normalised displacements they were learned on.
    pub input_scale: f64,
    /// Size and time constants.
    pub shape: DybmShape,
    /// b, W, V of the model.
    pub parameters: Parameters,
}

state! { [] DybmWeights { version, step_ns, input_scale, shape, parameters } }

impl DybmWeights {
    /// Largest magnitude of a parameter: 100 times that of constant velocity.
    pub const MAX_MAGNITUDE: f64 = 100.0;

    /// The paper's start: every parameter zero, which predicts like Hold until it has learned.
    #[must_use]
    pub fn zero(step_ns: u64, shape: DybmShape) -> Self {
        Self { version: 0, step_ns, input_scale: TARGET_RMS, shape, parameters: Parameters::ZERO }
    }

    /// A useful start: W_1 = `persistence`·I, i.e. the last displacement, decaying by that factor per step.
    ///
    /// What is learned on top is then the *change* of velocity; the model stays a linear DyBM.
    #[must_use]
    pub fn persistent(step_ns: u64, shape: DybmShape, persistence: f64) -> Self {
        let mut weights = Self::zero(step_ns, shape);
        if let Some(newest) = weights.parameters.fifo.first_mut() {
            *newest = [[persistence, 0.0], [0.0, persistence]];
        }
        weights
    }

    /// μ for the next step, normalised.
    #[must_use]
    #[inline]
    pub fn predict(&self, state: &DybmState) -> [f64; 2] {
        let fifo = self.parameters.fifo.iter().zip(&state.fifo).take(self.shape.fifo_len());
        let traces = self.parameters.traces.iter().zip(&state.traces).take(self.shape.traces);
        let mut mean = self.parameters.bias;
        for (matrix, input) in fifo.chain(traces) {
            for (row, f) in matrix.iter().zip(input) {
                for (mean, w) in mean.iter_mut().zip(row) {
                    *mean += f * w;
                }
            }
        }
        mean
    }
}

impl ModelParameters for DybmWeights {
    const MODEL: &'static str = "DyBM";

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
        self.shape.validate()?;
        WeightsError::all_within(Self::MODEL, Self::MAX_MAGNITUDE, self.parameters.iter())
    }

    fn accepts(&self, other: &Self) -> Result<(), WeightsError> {
        other.fits(self.step_ns)?;
        if other.shape != self.shape {
            let (got_delay, loop_delay) = (other.shape.delay, self.shape.delay);
            return Err(WeightsError::Shape { got_delay, loop_delay });
        }
        Ok(())
    }
}
