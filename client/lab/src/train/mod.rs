//! Training of the LSTM family in fused code of our own: back-propagation through time, Adam, no framework.
//!
//! Contract: the same seed, data and options give the same weights bit for bit, on any number of threads.
//! Sequences are raw displacements ([`Strokes`]); networks see them divided by a scale. Absent: the online
//! learners (they train inside the tables), and the running network (`foretrace_control::predict`).

mod real;
pub mod corpus;
mod resample;
mod augment;
mod parameters;
mod loss;
mod group;
mod engine;
mod adam;
mod recipe;
mod fit;
pub mod checkpoint;
mod checkpoint_file;
mod course;
mod curve;
mod model;
mod lstm;
pub mod foresight;
pub mod bench;

pub use adam::{Adam, AdamSettings, Schedule, limit_norm};
pub use augment::{Augment, AugmentError};
pub use corpus::{CorpusError, Strokes, Units};
pub use course::{TrainingOptions, TrainingProgress, TrainingReport, TrainingWatch};
pub use curve::curve;
pub use engine::{Engine, Scores, Setup};
pub use fit::{Epoch, Fit, FitError, TrainPlan, TrainState};
pub use loss::{Objective, Padding, Penalty};
pub use lstm::LstmTraining;
pub use model::{citation, model};
pub use parameters::{LstmNetwork, LstmShape, TensorSlot};
pub use real::{LANES, Real};
pub use recipe::Recipe;
