//! `Member`: the panel's interface to a predictor of any type: it observes, previews, and takes new weights
//! if it learns.

use std::fmt::Debug;

use super::online::WeightsError;
use super::taught::ListedPredictor;
use super::{OnlineWeights, PenStep, Predictor};
use crate::state::{Reader, State, StateError, Writer};

/// A predictor of any type, for any thread.
pub trait AnyPredictor: Predictor + Debug + Send + Sync {}

impl<P: Predictor + Debug + Send + Sync> AnyPredictor for P {}

/// A predictor in a panel.
pub(super) trait Member: AnyPredictor + State {
    /// A copy with its memory.
    fn copied(&self) -> Box<dyn Member>;

    /// Checks `weights` as `take_over` does.
    ///
    /// # Errors
    ///
    /// Weights that are invalid or do not fit.
    fn judge(&self, _weights: &OnlineWeights) -> Result<(), WeightsError> {
        Ok(())
    }

    /// Takes over its part of `weights`, unless already in use; memory stays.
    ///
    /// # Errors
    ///
    /// Weights that are invalid or do not fit; the old ones stay.
    fn take_over(&mut self, _weights: &OnlineWeights) -> Result<(), WeightsError> {
        Ok(())
    }

    /// Writes the parameters in use into its part of `weights`.
    fn write_weights(&self, _weights: &mut OnlineWeights) {}
}

impl Clone for Box<dyn Member> {
    fn clone(&self) -> Self {
        self.as_ref().copied()
    }
}

/// A predictor that does not learn online.
#[derive(Debug, Clone)]
pub(super) struct OfflineMember<P>(pub(super) P);

/// A predictor that does.
#[derive(Debug, Clone)]
pub(super) struct OnlineMember<P>(pub(super) P);

macro_rules! predicts_as_its_own {
    ($wrapper:ident) => {
        impl<P: State> State for $wrapper<P> {
            fn save(&self, to: &mut Writer<'_>) {
                self.0.save(to);
            }

            fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
                self.0.load(from)
            }
        }

        impl<P: Predictor> Predictor for $wrapper<P> {
            fn observe(&mut self, x: [f64; 2]) {
                self.0.observe(x);
            }

            fn observe_pen(&mut self, step: &PenStep) {
                self.0.observe_pen(step);
            }

            fn preview_within(&self, limit: f64, out: &mut [[f64; 2]]) {
                self.0.preview_within(limit, out);
            }

            fn reset(&mut self) {
                self.0.reset();
            }

            fn set_cursor(&mut self, index: u64, scale_m: f64) {
                self.0.set_cursor(index, scale_m);
            }
        }
    };
}

predicts_as_its_own!(OfflineMember);
predicts_as_its_own!(OnlineMember);

impl<P: Predictor + State + Clone + Debug + Send + Sync + 'static> Member for OfflineMember<P> {
    fn copied(&self) -> Box<dyn Member> {
        Box::new(self.clone())
    }
}

impl<P: ListedPredictor> Member for OnlineMember<P> {
    fn copied(&self) -> Box<dyn Member> {
        Box::new(self.clone())
    }

    fn judge(&self, weights: &OnlineWeights) -> Result<(), WeightsError> {
        self.0.judge(P::part(weights))
    }

    fn take_over(&mut self, weights: &OnlineWeights) -> Result<(), WeightsError> {
        self.0.take_over(P::part(weights))
    }

    fn write_weights(&self, weights: &mut OnlineWeights) {
        *P::part_mut(weights) = *self.0.weights();
    }
}
