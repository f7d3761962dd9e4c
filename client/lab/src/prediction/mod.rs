//! Prediction tables: recorded characters as displacement sequences, the models, and their scores.
//!
//! Contract: everything is in the set's raw units per sample, exactly as the reference tables were made.
//! Models reset their state before each sequence and carry parameters over. Networks are trained in
//! [`crate::train`]. Absent: the closed loop.

mod sequence;
mod set;
mod model;
mod scaled;
mod network;
mod external;
mod double_exponential;
mod holdover;
mod of_the_loop;
mod registry;
mod score;
mod run;
mod retrain;
mod by_label;
mod symbols;
pub mod table;
pub mod lead_time;

pub use crate::process::EXTERNAL;
pub use by_label::{
    Correlation, LabelRow, MIN_SEQUENCES, by_label, correlations, curviness_of, gains, glyph_height,
};
pub use model::{Contestant, OnScoredSet, Online, Plain, constant_velocity, zero};
pub use registry::{
    Built, CONSTANT_VELOCITY, LSTM_FILE, LSTM_REFERENCE, Model, RegistryError, Setting, names, order,
};
pub use retrain::{RetrainError, Retrained, TRAINABLE, retrain, retrain_epochs};
pub use run::{ByLead, Lead, Row, Run, Scored, preview_all, run, runs, score, train, work};
pub use scaled::{RunningScale, Scaled};
pub use score::{HORIZON, LEADS, Mean, Tally, share_below};
pub use sequence::{CharacterSequence, PADDING_STEPS, sequences};
pub use set::Set;
pub use symbols::SymbolAnalysis;

#[cfg(test)]
mod tests;
