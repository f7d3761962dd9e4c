//! Training of the LSTM family in fused code of our own: back-propagation through time, Adam, no framework.
//!
//! Contract: the same seed, data and options give the same weights bit for bit, on any number of threads. Sequences are
//! raw displacements ([`Strokes`]); networks see them divided by a scale. Absent: the online learners (they train
//! inside the tables), and the running network (`foretrace_control::predict`).

mod real;
mod corpus;
mod parameters;
mod loss;
mod group;
mod engine;
mod adam;

pub use adam::{Adam, AdamSettings, Schedule, limit_norm};
pub use corpus::Strokes;
pub use engine::{Engine, Scores, Setup};
pub use loss::{Objective, Padding, Penalty};
pub use parameters::{Network, Shape, Tensor};
pub use real::{LANES, Real};
