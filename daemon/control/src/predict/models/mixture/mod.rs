//! `mixture`: up to eight experts, and a mixture of them that learns online, separately for every lead.
//!
//! The experts' features of the pen are made once per step by the [`Trunk`]: the last 8 displacements, a
//! fixed random reservoir (that of DyBM+ESN), and the cells of an LSTM trained offline on other writers with
//! a direct output per lead. Two read-outs are learned online by recursive least squares, directly for the
//! leads of [`NODES`], so that no prediction is fed back and no error compounds:
//!
//! | expert | predicts | learns online |
//! |---|---|---|
//! | constant velocity | the last displacement repeated | nothing |
//! | AR-RLS | its roll-out ([`crate::predict::models::ar_rls`]) | coefficients |
//! | DyBM+ESN | constant velocity + read-out of FIFO and reservoir | read-out, by RLS |
//! | LSTM | its direct outputs | nothing |
//! | corrected LSTM | LSTM + read-out of FIFO, reservoir and cells | read-out, by RLS |
//! | foresight | the way to every node ([`crate::predict::models::foresight`]) | nothing |
//! | corrected foresight | foresight + read-out of its last layer | read-out, by RLS |
//! | both corrected | the mean of the two corrected networks, whose errors differ | nothing |
//!
//! The mixture weighs them per lead by exponential weights with fixed share (Herbster & Warmuth 1998) on
//! realised position errors, which finds the best expert, not the best mean of two: that is why a mean is an
//! expert of its own. Without a network (`mixture-cold` has none) the experts that need it are left out.
//!
//! Contract: one displacement per step, normalised (RMS about 10 while moving); one longer than [`GATE`] is a
//! jump, not motion: memory is cleared, and nothing is learned from it or across it. Parameters, memory and
//! learner are separate.

mod learner;
mod mixer;
mod parameters;
mod readout;
mod trunk;

use crate::state::state;

pub use learner::{MixtureLearner, MixtureSettings};
pub use parameters::MixtureParameters;
pub use trunk::{MixtureMemory, Present, TrainedNetworks, Trunk, is_motion};

use crate::pen::TARGET_RMS;
use crate::predict::models::lstm::FADE;
use crate::predict::online::{ModelParameters, WeightsError};
use crate::predict::{Entry, Models, OnlinePredictor, Pace, PenStep, Predictor, shortened};

pub(super) const ENTRY: Entry = Entry::taught::<Mixture>("learns online which of its experts to believe");

/// Leads that are learned \[steps\]; those between are interpolated, those beyond decay.
pub const NODES: [usize; NODE_COUNT] = [1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 18, 20, 22, 24];
/// How many there are.
pub const NODE_COUNT: usize = 16;
/// The farthest of them, and the number of direct outputs that the LSTM must have.
pub const LEADS: usize = 24;
/// Experts of the mixture.
pub const EXPERTS: usize = 8;
/// Displacements longer than this (normalised, in the plane) are jumps: five ordinary steps.
pub const GATE: f64 = 7.0 * TARGET_RMS;

/// Summed displacements at the nodes (normalised): the future positions relative to the present one.
pub(in crate::predict) type NodePath = [[f64; 2]; NODE_COUNT];

/// The predictor: trunk, memory and parameters.
#[derive(Debug, Clone)]
pub struct Mixture {
    trunk: Trunk,
    memory: MixtureMemory,
    parameters: MixtureParameters,
}

state! { [] Mixture { trunk, memory, parameters } }

impl Mixture {
    /// Starts with empty memory.
    ///
    /// # Errors
    ///
    /// Invalid parameters, or an LSTM with other than [`LEADS`] direct outputs.
    pub fn new(
        trained: impl Into<TrainedNetworks>,
        parameters: MixtureParameters,
    ) -> Result<Self, WeightsError> {
        parameters.validate()?;
        Ok(Self { trunk: Trunk::new(trained.into())?, memory: MixtureMemory::EMPTY, parameters })
    }

    /// What it remembers of the pen.
    #[must_use]
    pub fn memory(&self) -> &MixtureMemory {
        &self.memory
    }
}

impl OnlinePredictor for Mixture {
    const NAME: &'static str = "mixture";
    const PACE: Pace = Pace::Following;
    type Learner = MixtureLearner;

    fn start(models: &Models) -> MixtureParameters {
        MixtureParameters::untrained(models.settings().step_ns, &trained(models))
    }

    fn predictor(models: &Models, weights: &MixtureParameters) -> Result<Self, WeightsError> {
        Self::new(trained(models), *weights)
    }

    fn learner(models: &Models, weights: &MixtureParameters) -> Result<MixtureLearner, WeightsError> {
        MixtureLearner::new(models.settings().mixture, trained(models), *weights)
    }

    fn weights(&self) -> &MixtureParameters {
        &self.parameters
    }

    fn set_weights(&mut self, weights: &MixtureParameters) -> Result<(), WeightsError> {
        weights.validate()?;
        self.parameters.accepts(weights)?;
        self.parameters.take_over(weights);
        Ok(())
    }
}

impl Predictor for Mixture {
    fn observe(&mut self, x: [f64; 2]) {
        self.observe_pen(&PenStep::of(x));
    }

    fn observe_pen(&mut self, step: &PenStep) {
        self.trunk.observe(&mut self.memory, step);
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        preview(&self.parameters, &self.memory, limit, out);
    }

    fn reset(&mut self) {
        self.trunk.reset(&mut self.memory);
    }
}

/// The networks of the mixture.
fn trained(models: &Models) -> TrainedNetworks {
    let networks = models.networks();
    TrainedNetworks { lstm: networks.mixture.clone(), foresight: networks.foresight.clone() }
}

/// Displacement per step of the mixture, none longer than `limit`.
fn preview(parameters: &MixtureParameters, memory: &MixtureMemory, limit: f64, out: &mut [[f64; 2]]) {
    let paths = parameters.experts(memory);
    steps_of(&parameters.mix(&paths), limit, out);
}

/// Displacements per step along `path`: constant between nodes, decaying beyond the last.
fn steps_of(path: &NodePath, limit: f64, out: &mut [[f64; 2]]) {
    let mut out = out.iter_mut();
    let mut before = [0.0; 2];
    let mut reached = 0;
    let mut last = [0.0; 2];
    for (node, at) in NODES.iter().zip(path) {
        let steps = node - reached;
        let share = 1.0 / steps as f64;
        let [[x, y], [x0, y0]] = [*at, before];
        last = shortened([(x - x0) * share, (y - y0) * share], limit);
        for out in out.by_ref().take(steps) {
            *out = last;
        }
        (before, reached) = (*at, *node);
    }
    for out in out {
        last = last.map(|x| x * FADE);
        *out = last;
    }
}
