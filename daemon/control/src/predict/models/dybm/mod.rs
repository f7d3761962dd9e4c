//! Linear (Gaussian) dynamic Boltzmann machine: μ = b + Σ_l f_l W_l + Σ_k e_k V_k.
//!
//! Row vectors in R²; f_1 … f_L (L = delay − 1) are the last inputs, newest first; e_k are eligibility
//! traces, e_k ← λ_k e_k + x (or + the value that leaves the FIFO, [`TraceInput::Delayed`]). Parameters
//! ([`DybmWeights`]), memory ([`DybmState`]) and optimiser accumulators ([`DybmLearner`]) are separate, so
//! that weights can be exchanged between two steps without effect on memory. Source: Dasgupta & Osogami 2017,
//! as in IBM's reference implementation, whose numbers the tests reproduce.

mod weights;
mod optimiser;
mod learner;

pub use crate::predict::online::WeightsError;
use crate::state::state;
pub use learner::{DybmLearner, DybmSettings};
pub use optimiser::Optimiser;
pub use weights::{DybmShape, DybmWeights, Parameters, TraceInput};

pub(crate) use learner::{Ascent, difference};
pub(crate) use optimiser::{ParameterGroup, Powers, Pull};

use crate::predict::online::{ModelParameters, is_usable};
use crate::predict::{
    Entry, InitialWeights, ModelSettings, Models, OnlinePredictor, Pace, Predictor, shortened,
};

pub(super) const ENTRY: Entry = Entry::taught::<Dybm>("dynamic Boltzmann machine, linear, learning online");

/// Largest delay; the FIFO holds one input less.
pub const MAX_DELAY: usize = 16;
/// Largest number of inputs in a FIFO.
pub const MAX_FIFO: usize = MAX_DELAY - 1;
/// Largest number of eligibility traces.
pub const MAX_TRACES: usize = 4;

/// Memory of the model.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DybmState {
    /// f_1 … f_L, newest first, normalised; MAX_FIFO x 2, zero past L.
    pub fifo: [[f64; 2]; MAX_FIFO],
    /// e_1 … e_K, normalised; MAX_TRACES x 2, zero past K.
    pub traces: [[f64; 2]; MAX_TRACES],
}

state! { [] DybmState { fifo, traces } }

impl DybmState {
    /// Takes in one displacement.
    #[inline]
    pub fn observe(&mut self, shape: &DybmShape, x: [f64; 2]) {
        let held = shape.fifo_len();
        let fallen_out = self.fifo.get(held.wrapping_sub(1)).copied().unwrap_or(x);
        let entering = match shape.trace_input {
            TraceInput::Newest => x,
            TraceInput::Delayed => fallen_out,
        };
        for (trace, decay) in self.traces.iter_mut().zip(shape.decays()) {
            for (e, p) in trace.iter_mut().zip(entering) {
                *e = decay * *e + p;
            }
        }
        let mut carried = x;
        for slot in self.fifo.iter_mut().take(held) {
            std::mem::swap(slot, &mut carried);
        }
    }

    /// Outer products of every held input with `error`: the gradients of W and V (that of b is `error`
    /// itself).
    #[inline]
    pub(crate) fn outer(&self, shape: &DybmShape, error: [f64; 2]) -> Parameters {
        let [dx, dy] = error;
        let mut gradient = Parameters { bias: error, ..Parameters::ZERO };
        let fifo = gradient.fifo.iter_mut().zip(&self.fifo).take(shape.fifo_len());
        let traces = gradient.traces.iter_mut().zip(&self.traces).take(shape.traces);
        for (matrix, [x, y]) in fifo.chain(traces) {
            *matrix = [[x * dx, x * dy], [y * dx, y * dy]];
        }
        gradient
    }
}

/// The predictor: weights and memory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dybm {
    weights: DybmWeights,
    state: DybmState,
}

state! { [] Dybm { weights, state } }

impl Dybm {
    /// Starts with empty memory.
    ///
    /// # Errors
    ///
    /// See [`DybmWeights::validate`].
    pub fn new(weights: DybmWeights) -> Result<Self, WeightsError> {
        weights.validate()?;
        Ok(Self { weights, state: DybmState::default() })
    }

    /// What it remembers of the pen.
    #[must_use]
    pub fn state(&self) -> &DybmState {
        &self.state
    }
}

impl OnlinePredictor for Dybm {
    const NAME: &'static str = "dybm";
    const PACE: Pace = Pace::Settled;
    type Learner = DybmLearner;

    fn start(models: &Models) -> DybmWeights {
        let ModelSettings { step_ns, dybm: DybmSettings { shape, .. }, initial, .. } = *models.settings();
        match initial {
            InitialWeights::Zero => DybmWeights::zero(step_ns, shape),
            InitialWeights::Persistent(factor) => DybmWeights::persistent(step_ns, shape, factor),
        }
    }

    fn predictor(_models: &Models, weights: &DybmWeights) -> Result<Self, WeightsError> {
        Self::new(*weights)
    }

    fn learner(models: &Models, weights: &DybmWeights) -> Result<DybmLearner, WeightsError> {
        DybmLearner::new(models.settings().dybm, *weights)
    }

    fn weights(&self) -> &DybmWeights {
        &self.weights
    }

    fn set_weights(&mut self, weights: &DybmWeights) -> Result<(), WeightsError> {
        weights.validate()?;
        self.weights.accepts(weights)?;
        self.weights = *weights;
        Ok(())
    }
}

impl Predictor for Dybm {
    fn observe(&mut self, x: [f64; 2]) {
        if is_usable(x) {
            self.state.observe(&self.weights.shape, x);
        } else {
            self.reset();
        }
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        roll_out(&self.weights, self.state, limit, out);
    }

    fn reset(&mut self) {
        self.state = DybmState::default();
    }
}

/// Predicts `out.len()` steps from a *copy* of the memory, each prediction (shortened to `limit`) fed back.
pub fn roll_out(weights: &DybmWeights, mut state: DybmState, limit: f64, out: &mut [[f64; 2]]) {
    for predicted in out {
        *predicted = shortened(weights.predict(&state), limit);
        state.observe(&weights.shape, *predicted);
    }
}
