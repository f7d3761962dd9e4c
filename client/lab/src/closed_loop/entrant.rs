//! Who takes part: predictors in the daemon's control law.

use foretrace_control::predict::PredictorKind;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;

/// A row of the benchmark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Entrant {
    /// Feedback only: trust 0.
    Hold,
    /// A predictor believed fully (trust 1, but for the warm-up that nobody can do without).
    Believed(PredictorKind),
    /// `ours` with automatic trust: the daemon as it is shipped.
    Ours,
}

/// A name that nobody has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no predictor is called {name:?}; there are {}", known.join(" "))]
pub struct UnknownEntrant {
    /// As given.
    pub name: String,
    /// Every name.
    pub known: Vec<&'static str>,
}

impl Entrant {
    /// All, in the order of the table.
    pub const ALL: [Self; 9] = [
        Self::Hold,
        Self::Believed(PredictorKind::ConstantVelocity),
        Self::Believed(PredictorKind::Dybm),
        Self::Believed(PredictorKind::DybmEsn),
        Self::Believed(PredictorKind::Lstm),
        Self::Believed(PredictorKind::ArRls),
        Self::Believed(PredictorKind::Ours),
        Self::Ours,
        Self::Believed(PredictorKind::Oracle),
    ];

    /// Name in tables and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hold => "hold",
            Self::Ours => "ours",
            Self::Believed(PredictorKind::Hold) => "hold-trust1",
            Self::Believed(PredictorKind::ConstantVelocity) => "constant-velocity",
            Self::Believed(PredictorKind::Dybm) => "dybm-online",
            Self::Believed(PredictorKind::DybmEsn) => "dybm-esn-online",
            Self::Believed(PredictorKind::Lstm) => "lstm10",
            Self::Believed(PredictorKind::ArRls) => "ar-rls",
            Self::Believed(PredictorKind::Ours) => "ours-trust1",
            Self::Believed(PredictorKind::Oracle) => "oracle",
        }
    }

    /// The entrant called `name`.
    ///
    /// # Errors
    /// A name that nobody has.
    pub fn named(name: &str) -> Result<Self, UnknownEntrant> {
        Self::ALL.into_iter().find(|entrant| entrant.name() == name).ok_or_else(|| UnknownEntrant {
            name: name.to_owned(),
            known: Self::ALL.iter().map(|entrant| entrant.name()).collect(),
        })
    }

    /// Who predicts.
    #[must_use]
    pub const fn predictor(self) -> PredictorKind {
        match self {
            Self::Hold => PredictorKind::Hold,
            Self::Ours => PredictorKind::Ours,
            Self::Believed(kind) => kind,
        }
    }

    /// Who decides the trust.
    #[must_use]
    pub const fn trust(self) -> TrustRequest {
        match self {
            Self::Hold => TrustRequest::Manual(Trust::NONE),
            Self::Ours => TrustRequest::Auto,
            Self::Believed(_) => TrustRequest::Manual(Trust::FULL),
        }
    }
}
