//! The methods of the benchmark: predictors in the daemon's control law, and the baselines.

use foretrace_control::predict::PredictorKind;

use crate::baselines::BaselineKind;
use crate::experiments::LawEntrant;
use crate::process::{EXTERNAL, command_of};

/// A row of the benchmark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rival {
    /// The daemon's control law.
    Law(LawEntrant),
    /// A baseline instead of the law.
    Baseline(BaselineKind),
    /// The same, with commands inside the limits of an arm that has some.
    Legal(BaselineKind),
    /// The daemon with the predictor of another program, of this name, and automatic trust.
    External(&'static str),
}

/// An unknown name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no predictor is called {name:?}; there are {} and {EXTERNAL}COMMAND{}", known.join(" "), PredictorKind::renamed(name))]
pub struct UnknownRival {
    pub name: String,
    pub known: Vec<&'static str>,
}

impl Rival {
    pub const HOLD: Self = Self::Law(LawEntrant::Hold);
    /// The daemon as it is shipped.
    pub const AS_SHIPPED: Self = Self::Law(LawEntrant::Mixture);

    /// The methods by default, in the order of the table: the law, the baselines, and the oracle.
    pub fn all() -> impl Iterator<Item = Self> {
        let oracle = |law: &LawEntrant| law.predictor() == PredictorKind::ORACLE;
        let law = LawEntrant::all();
        let knowing = law.clone().filter(oracle).map(Self::Law);
        law.filter(move |law| !oracle(law))
            .map(Self::Law)
            .chain(BaselineKind::ALL.map(Self::Baseline))
            .chain(knowing)
    }

    /// Name in tables and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Law(LawEntrant::Hold) => "hold",
            Self::Law(LawEntrant::Mixture) => "mixture",
            Self::Baseline(kind) => kind.name(),
            Self::Legal(BaselineKind::ServojGello) => "servoj-gello-legal",
            Self::Legal(BaselineKind::ServojRos) => "servoj-ros-legal",
            Self::Legal(BaselineKind::Otg) => "otg-legal",
            Self::Legal(BaselineKind::Kalman) => "kalman-legal",
            Self::Law(LawEntrant::Believed(PredictorKind::HOLD)) => "hold-trust1",
            Self::Law(LawEntrant::Believed(PredictorKind::MIXTURE)) => "mixture-trust1",
            Self::Law(LawEntrant::Believed(other)) => other.name(),
            Self::External(name) => name,
        }
    }

    /// The method called `name`.
    ///
    /// # Errors
    /// An unknown name.
    pub fn named(name: &str) -> Result<Self, UnknownRival> {
        if command_of(name).is_some() {
            // One for each row of a table: too few to free them.
            return Ok(Self::External(name.to_owned().leak()));
        }
        let known = || Self::all().chain(BaselineKind::ALL.map(Self::Legal));
        known()
            .find(|rival| rival.name() == name)
            .ok_or_else(|| UnknownRival { name: name.to_owned(), known: known().map(Self::name).collect() })
    }
}
