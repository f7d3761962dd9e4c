//! `OnlineModel`: the interface of every model that learns online, used by the learner, the lab and replay.
//!
//! Contract: parameters (θ), memory of the pen, and the learner's accumulators are separate. Parameters are
//! plain copies that may cross threads; memory is cleared when the pen is interrupted; accumulators never
//! leave the learner. `learn` is one function for training offline and online. No allocation, no clock.

use std::fmt::Debug;

use thiserror::Error;

use crate::pen::TARGET_RMS;
use crate::predict::PenStep;

/// A displacement with a component beyond this \[per axis\] is no motion in any unit: its square would swamp
/// or overflow a learner's sums.
pub const LARGEST_DISPLACEMENT: f64 = 1e6;

/// Whether `x` can be remembered and learned from; NaN cannot.
#[inline]
pub(crate) fn is_usable(x: [f64; 2]) -> bool {
    x.iter().all(|x| x.abs() <= LARGEST_DISPLACEMENT)
}

/// Parameters of a model with what they were made for; they reach the loop complete or not at all.
pub trait ModelParameters: Copy + PartialEq + Debug + Send + Sync + 'static {
    /// Name of the model in messages.
    const MODEL: &'static str;

    /// Counts every change of the live parameters.
    fn version(&self) -> u64;

    /// The same parameters under another version.
    #[must_use]
    fn with_version(self, version: u64) -> Self;

    /// Δ they were learned at \[ns\].
    fn step_ns(&self) -> u64;

    /// RMS per component of the displacements they were learned on.
    fn input_scale(&self) -> f64;

    /// Checks that every number is usable.
    ///
    /// # Errors
    ///
    /// The first bound that is broken; NaN and infinity break all of them.
    fn validate(&self) -> Result<(), WeightsError>;

    /// Checks that `other` may replace these in a running loop; its numbers are not checked (see `validate`).
    ///
    /// # Errors
    ///
    /// Another grid step, input scale or shape.
    fn accepts(&self, other: &Self) -> Result<(), WeightsError>;

    /// Checks that these were made for a loop with grid step `loop_ns` \[ns\].
    ///
    /// # Errors
    ///
    /// Another grid step or input scale.
    fn fits(&self, loop_ns: u64) -> Result<(), WeightsError> {
        let (model, got_ns, got) = (Self::MODEL, self.step_ns(), self.input_scale());
        if got_ns != loop_ns {
            return Err(WeightsError::Step { model, got_ns, loop_ns });
        }
        let matches = (got - TARGET_RMS).abs() <= 1e-9 * TARGET_RMS;
        if !matches {
            return Err(WeightsError::InputScale { model, got, wanted: TARGET_RMS });
        }
        Ok(())
    }
}

/// A model of the pen that learns one step at a time.
///
/// Whatever is not motion (NaN, beyond [`LARGEST_DISPLACEMENT`], or beyond a model's own gate) clears the
/// memory and is not learned from, so that no input corrupts parameters or accumulators.
pub trait OnlineModel {
    /// θ; whole sets of it are exchanged between threads.
    type Parameters: ModelParameters;
    /// Its memory of the pen, and nothing else.
    type Memory: Copy + PartialEq + Debug;

    /// Learns from one real displacement, then remembers it; returns the prediction made before seeing it.
    fn learn(&mut self, x: [f64; 2]) -> [f64; 2];

    /// Remembers a displacement without learning from it.
    fn observe(&mut self, x: [f64; 2]);

    /// As `learn`, with what the pen knows besides. For models that look at contact.
    fn learn_pen(&mut self, step: &PenStep) -> [f64; 2] {
        self.learn(step.x)
    }

    /// As `observe`, with what the pen knows besides.
    fn observe_pen(&mut self, step: &PenStep) {
        self.observe(step.x);
    }

    /// Forgets the history; parameters and accumulators stay.
    fn reset_state(&mut self);

    /// The parameters as they are now.
    fn parameters(&self) -> &Self::Parameters;

    /// What is remembered of the pen now.
    fn memory(&self) -> &Self::Memory;

    /// Replaces the parameters; accumulators and memory stay, so that learning continues at its present rate.
    ///
    /// # Errors
    ///
    /// Parameters that are invalid or do not fit; the old ones stay.
    fn continue_from(&mut self, parameters: &Self::Parameters) -> Result<(), WeightsError>;

    /// Replaces the parameters and forgets the accumulators; memory stays.
    ///
    /// # Errors
    ///
    /// As `continue_from`; nothing changes then.
    fn restart_from(&mut self, parameters: &Self::Parameters) -> Result<(), WeightsError>;

    /// Predicts `out.len()` steps with any `parameters` from a *copy* of `memory`, each prediction (no longer
    /// than `limit`) fed back.
    fn preview_from(
        &self,
        parameters: &Self::Parameters,
        memory: &Self::Memory,
        limit: f64,
        out: &mut [[f64; 2]],
    );

    /// Predicts `out.len()` steps from the present parameters and memory.
    fn preview(&self, out: &mut [[f64; 2]]) {
        self.preview_from(self.parameters(), self.memory(), f64::INFINITY, out);
    }
}

/// Parameters or settings that must not reach the loop.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum WeightsError {
    /// Delay outside its bounds.
    #[error("DyBM delay is {got} steps, legal are 2 to {max}")]
    Delay {
        /// The refused value, as it was given.
        got: usize,
        /// Longest delay that is legal \[steps\].
        max: usize,
    },
    /// Number of traces outside its bounds.
    #[error("DyBM has {got} decay rates, legal are 1 to {max}")]
    Traces {
        /// The refused value, as it was given.
        got: usize,
        /// Largest number that is legal.
        max: usize,
    },
    /// A trace would never forget, or is NaN.
    #[error("DyBM decay rate is {got}, legal are 0 to below 1")]
    Decay {
        /// The refused value, as it was given.
        got: f64,
    },
    /// A parameter is NaN, infinite or too large.
    #[error("{model} parameter is {got}, legal are finite values within ±{limit}")]
    Magnitude {
        /// Name of the model, as in the message.
        model: &'static str,
        /// The number that is refused.
        got: f64,
        /// Largest magnitude that is legal, itself included.
        limit: f64,
    },
    /// A number of the learning rule is not usable.
    #[error("{model} setting {name} is {got}, legal are {min} to {max}")]
    Setting {
        /// Name of the model, as in the message.
        model: &'static str,
        /// Name of the number, as in the message.
        name: &'static str,
        /// The refused value, as it was given.
        got: f64,
        /// Smallest value that is legal, itself included.
        min: f64,
        /// Largest value that is legal, itself included.
        max: f64,
    },
    /// Learned at another grid step.
    #[error(
        "{model} weights are for a step of {got_ns} ns, the loop runs at {loop_ns} ns: retrain, or change \
         the step"
    )]
    Step {
        /// Name of the model, as in the message.
        model: &'static str,
        /// Of the weights \[ns\].
        got_ns: u64,
        /// Of the loop \[ns\].
        loop_ns: u64,
    },
    /// Learned on displacements with another normalisation.
    #[error("{model} weights are for inputs of RMS {got}, the loop feeds RMS {wanted}: retrain")]
    InputScale {
        /// Name of the model, as in the message.
        model: &'static str,
        /// What the weights were made for.
        got: f64,
        /// What the loop has.
        wanted: f64,
    },
    /// Another delay or other decay rates: the memory would not fit.
    #[error(
        "DyBM weights have another shape than the loop's (delay {got_delay}, loop {loop_delay}, or decay \
         rates)"
    )]
    Shape {
        /// Delay of the weights.
        got_delay: usize,
        /// Delay of the loop.
        loop_delay: usize,
    },
    /// The read-out was learned on another reservoir.
    #[error(
        "DyBM+ESN weights belong to reservoir {got:#018x}, the loop has {wanted:#018x}: use the same seed, \
         leak and radius"
    )]
    Reservoir {
        /// Digest of the weights' reservoir.
        got: u64,
        /// Digest of the loop's.
        wanted: u64,
    },
    /// A reservoir without usable dynamics.
    #[error("reservoir's recurrent matrix has spectral radius {got}: choose another seed")]
    Radius {
        /// The radius, as it was computed.
        got: f64,
    },
}

impl WeightsError {
    /// `got` lies within `min` … `max`.
    ///
    /// # Errors
    ///
    /// [`WeightsError::Setting`] otherwise, and for NaN.
    pub(crate) fn bounded(
        model: &'static str,
        name: &'static str,
        got: f64,
        min: f64,
        max: f64,
    ) -> Result<(), Self> {
        if min <= got && got <= max { Ok(()) } else { Err(Self::Setting { model, name, got, min, max }) }
    }

    /// Every number lies within ±`limit`.
    ///
    /// # Errors
    ///
    /// [`WeightsError::Magnitude`] with the first that does not, NaN included.
    pub(crate) fn all_within(
        model: &'static str,
        limit: f64,
        mut numbers: impl Iterator<Item = f64>,
    ) -> Result<(), Self> {
        match numbers.find(|number| !(number.abs() <= limit)) {
            Some(got) => Err(Self::Magnitude { model, got, limit }),
            None => Ok(()),
        }
    }
}
