//! Who takes part: predictors in the daemon's control law, and the ways of today.

use foretrace_control::predict::PredictorKind;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;

use crate::today::WayKind;

/// A row of the benchmark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Entrant {
    /// Feedback only: trust 0.
    Hold,
    /// A predictor believed fully (trust 1, but for the warm-up that nobody can do without).
    Believed(PredictorKind),
    /// `ours` with automatic trust: the daemon as it is shipped.
    Ours,
    /// No control law of ours: what people use today.
    Today(WayKind),
}

/// What makes the arm move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Driver {
    /// The daemon's control law.
    Law {
        /// Who predicts.
        predictor: PredictorKind,
        /// Who decides the trust.
        trust: TrustRequest,
    },
    /// A way of today.
    Way(WayKind),
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
    pub const ALL: [Self; 13] = [
        Self::Hold,
        Self::Believed(PredictorKind::ConstantVelocity),
        Self::Believed(PredictorKind::Dybm),
        Self::Believed(PredictorKind::DybmEsn),
        Self::Believed(PredictorKind::Lstm),
        Self::Believed(PredictorKind::ArRls),
        Self::Believed(PredictorKind::Ours),
        Self::Ours,
        Self::Today(WayKind::ServojGello),
        Self::Today(WayKind::ServojRos),
        Self::Today(WayKind::Otg),
        Self::Today(WayKind::Kalman),
        Self::Believed(PredictorKind::Oracle),
    ];

    /// Name in tables and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hold => "hold",
            Self::Ours => "ours",
            Self::Today(kind) => kind.name(),
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

    /// What makes the arm move.
    #[must_use]
    pub const fn driver(self) -> Driver {
        let (predictor, trust) = match self {
            Self::Today(kind) => return Driver::Way(kind),
            Self::Hold => (PredictorKind::Hold, TrustRequest::Manual(Trust::NONE)),
            Self::Ours => (PredictorKind::Ours, TrustRequest::Auto),
            Self::Believed(kind) => (kind, TrustRequest::Manual(Trust::FULL)),
        };
        Driver::Law { predictor, trust }
    }
}
