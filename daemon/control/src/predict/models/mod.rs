//! The predictors, one folder or file each, and what they are made of.

pub mod activation;
pub mod ar_rls;
pub mod dybm;
pub mod esn;
pub mod lstm;
pub mod mixture;
mod constant_velocity;
mod covariance;
mod hold;
mod oracle;
mod set;

pub use ar_rls::{ArRls, ArRlsLearner, ArRlsSettings, ArRlsWeights};
pub use constant_velocity::ConstantVelocity;
pub use dybm::{Dybm, DybmLearner, DybmSettings, DybmState, DybmWeights, Optimiser};
pub use esn::{DybmEsn, DybmEsnLearner, DybmEsnSettings, DybmEsnWeights};
pub use hold::Hold;
pub use lstm::{Lstm, LstmError, LstmWeights};
pub use mixture::{Mixture, MixtureLearner, MixtureParameters, MixtureSettings};
pub use oracle::Oracle;
pub use set::{InitialWeights, ModelSettings, Models, ModelsError, Networks};
