//! The predictors, one folder or file each, and the registry: the only list of them
//! (`docs/extend/predictor.md`).

pub mod activation;
pub mod ar_rls;
pub mod dybm;
pub mod esn;
pub mod foresight;
pub mod lstm;
pub mod mixture;
mod constant_velocity;
mod covariance;
#[cfg(any(test, feature = "examples"))]
#[path = "../../../examples/predictors/damped_velocity.rs"]
mod damped_velocity;
pub(super) mod hold;
#[cfg(any(test, feature = "examples"))]
#[path = "../../../examples/predictors/learned_damping.rs"]
pub mod learned_damping;
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

use super::registry::Entry;

/// Every predictor, in the order of tables and of [`PredictorKind::ALL`](super::PredictorKind::ALL). The
/// order is internal to the process.
pub const REGISTRY: &[Entry] = &[
    hold::ENTRY,
    constant_velocity::ENTRY,
    dybm::ENTRY,
    oracle::ENTRY,
    lstm::ENTRY,
    esn::ENTRY,
    ar_rls::ENTRY,
    mixture::ENTRY,
    crate::predict::external::ENTRY,
    #[cfg(any(test, feature = "examples"))]
    damped_velocity::ENTRY,
    #[cfg(any(test, feature = "examples"))]
    learned_damping::ENTRY,
];

/// Passes the list of predictors that learn online, each with the name of its part in
/// [`OnlineWeights`](super::OnlineWeights), to the macro `$then`.
macro_rules! for_each_taught {
    ($then:ident) => {
        $then! {
            /// Weights of the linear DyBM.
            dybm: dybm::{Dybm, DybmWeights},
            /// DyBM with a reservoir.
            dybm_esn: esn::{DybmEsn, DybmEsnWeights},
            /// Those of AR-RLS, an expert too.
            ar_rls: ar_rls::{ArRls, ArRlsWeights},
            /// The mixture and its experts.
            mixture: mixture::{Mixture, MixtureParameters},
            /// Weights of the example that learns.
            #[cfg(any(test, feature = "examples"))]
            learned_damping: learned_damping::{LearnedDamping, Damping},
        }
    };
}
pub(crate) use for_each_taught;
