//! `OnlinePredictor`: the interface of a predictor that learns online to panel, learner and the set of
//! weights.
//!
//! Contract: a model states here how it starts, predicts and learns, all from [`Models`] and its own
//! parameters. Code for all models that learn uses the list
//! [`for_each_taught`](super::models::for_each_taught).

use std::fmt::Debug;

use super::online::{ModelParameters, OnlineModel, WeightsError};
use super::{Models, OnlineWeights, PenStep, Predictor};
use crate::state::State;

/// How a model's live weights follow its candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// Promoted when clearly better; a rollback returns to the weights before, and evidence begins again.
    Settled,
    /// Follows the candidate every few steps unless recent evidence is against it; a rollback returns to an
    /// anchor, which is renewed when the live weights have been no worse for long enough.
    Following,
}

/// A predictor whose parameters are learned elsewhere.
pub trait OnlinePredictor: Predictor + Clone + Debug + Send + Sync + Sized + 'static {
    /// Its name in the registry.
    const NAME: &'static str;
    /// How its live weights follow the candidate.
    const PACE: Pace;
    /// What learns its parameters online.
    type Learner: OnlineModel + Clone + Debug + Send + Sync + 'static;

    /// The parameters before anything was learned.
    fn start(models: &Models) -> ParametersOf<Self>;

    /// The predictor with empty memory.
    ///
    /// # Errors
    ///
    /// Parameters that are invalid or do not fit.
    fn predictor(models: &Models, parameters: &ParametersOf<Self>) -> Result<Self, WeightsError>;

    /// The learner with empty memory.
    ///
    /// # Errors
    ///
    /// Settings outside their bounds; parameters that are invalid or do not fit.
    fn learner(models: &Models, parameters: &ParametersOf<Self>) -> Result<Self::Learner, WeightsError>;

    /// The parameters that are in use.
    fn weights(&self) -> &ParametersOf<Self>;

    /// Exchanges the parameters and keeps the memory.
    ///
    /// # Errors
    ///
    /// Parameters that are invalid or do not fit (see [`ModelParameters::accepts`]); the old ones stay.
    fn set_weights(&mut self, parameters: &ParametersOf<Self>) -> Result<(), WeightsError>;

    /// Checks `parameters` as `set_weights` does; the version in use is not checked again.
    ///
    /// # Errors
    ///
    /// As `set_weights`.
    fn judge(&self, parameters: &ParametersOf<Self>) -> Result<(), WeightsError> {
        if parameters.version() == self.weights().version() {
            return Ok(());
        }
        parameters.validate()?;
        self.weights().accepts(parameters)
    }

    /// Exchanges the parameters, unless they are the version in use.
    ///
    /// # Errors
    ///
    /// As `set_weights`.
    fn take_over(&mut self, parameters: &ParametersOf<Self>) -> Result<(), WeightsError> {
        if parameters.version() == self.weights().version() {
            return Ok(());
        }
        self.set_weights(parameters)
    }
}

/// θ of a predictor.
pub type ParametersOf<P> = <<P as OnlinePredictor>::Learner as OnlineModel>::Parameters;

/// A predictor whose parameters are part of the learner's set; implemented by the list of those that learn.
pub trait ListedPredictor: OnlinePredictor + State {
    /// Its part of the set.
    fn part(weights: &OnlineWeights) -> &ParametersOf<Self>;

    /// The same, to be changed.
    fn part_mut(weights: &mut OnlineWeights) -> &mut ParametersOf<Self>;
}

/// A learner used as a predictor: it learns from every observation, without promotion.
#[derive(Debug, Clone)]
pub struct Learning<M>(pub M);

impl<M: OnlineModel> Predictor for Learning<M> {
    fn observe(&mut self, x: [f64; 2]) {
        self.0.learn(x);
    }

    fn observe_pen(&mut self, step: &PenStep) {
        self.0.learn_pen(step);
    }

    fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
        // Without outputs there is nothing to compute.
        if !out.is_empty() {
            self.0.preview_from(self.0.parameters(), self.0.memory(), limit, out);
        }
    }

    fn reset(&mut self) {
        self.0.reset_state();
    }
}
