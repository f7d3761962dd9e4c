//! `Contestant`: a predictor in the tables' terms, in the set's raw units per sample.
//!
//! Contract: `start_sequence` forgets the history and keeps parameters; `observe` takes one real displacement
//! (and learns from it, in a model that learns online); `preview` takes `&self`, so a roll-out changes
//! nothing. A model sees neither labels nor anything ahead of the step it predicts.

use foretrace_control::predict::{ConstantVelocity, Hold, OnlineModel, Predictor};

use crate::process::ProcessError;

/// A predictor that takes part in a table.
pub trait Contestant: Send {
    /// Forgets the history; parameters carry over.
    fn start_sequence(&mut self);

    /// Takes in one displacement \[raw units per sample\] and learns from it, if the model learns and is not
    /// frozen.
    fn observe(&mut self, v: [f64; 2]);

    /// As `observe`, for a displacement that leads from the end of one stroke to the start of the next; to
    /// most models it is one like any other.
    fn new_stroke(&mut self, v: [f64; 2]) {
        self.observe(v);
    }

    /// Predicts the next `out.len()` displacements \[raw units per sample\].
    fn preview(&self, out: &mut [[f64; 2]]);

    /// Training is over; a model that does not learn on the scored set stops learning.
    fn end_training(&mut self) {}

    /// What training chose, for the reader.
    fn trained_note(&self) -> Option<String> {
        None
    }

    /// Asked at the end of a sequence: why a model in another program could not predict all of it.
    fn failure(&self) -> Option<ProcessError> {
        None
    }
}

/// A predictor of the control law that reads raw units as they come.
#[derive(Debug, Clone)]
pub struct Plain<P>(pub P);

impl<P: Predictor + Send> Contestant for Plain<P> {
    fn start_sequence(&mut self) {
        self.0.reset();
    }

    fn observe(&mut self, v: [f64; 2]) {
        self.0.observe(v);
    }

    fn preview(&self, out: &mut [[f64; 2]]) {
        self.0.preview(out);
    }
}

/// The pen stays where it is.
#[must_use]
pub fn zero() -> Plain<Hold> {
    Plain(Hold)
}

/// The pen repeats its last displacement: the paper's baseline.
#[must_use]
pub fn constant_velocity() -> Plain<ConstantVelocity> {
    Plain(ConstantVelocity::default())
}

/// Whether a model goes on learning while it is scored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OnScoredSet {
    /// Parameters as the training passes left them.
    Frozen,
    /// Every observed step is learned from.
    Learns,
}

/// A model that learns one displacement at a time.
#[derive(Debug, Clone)]
pub struct Online<M> {
    learner: M,
    on_scored: OnScoredSet,
    learning: bool,
}

impl<M: OnlineModel> Online<M> {
    /// Learns until training ends, then as `on_scored` says.
    pub fn new(learner: M, on_scored: OnScoredSet) -> Self {
        Self { learner, on_scored, learning: true }
    }
}

impl<M: OnlineModel + Send> Contestant for Online<M> {
    fn start_sequence(&mut self) {
        self.learner.reset_state();
    }

    fn observe(&mut self, v: [f64; 2]) {
        if self.learning {
            self.learner.learn(v);
        } else {
            self.learner.observe(v);
        }
    }

    fn preview(&self, out: &mut [[f64; 2]]) {
        self.learner.preview(out);
    }

    fn end_training(&mut self) {
        self.learning = self.on_scored == OnScoredSet::Learns;
    }
}
