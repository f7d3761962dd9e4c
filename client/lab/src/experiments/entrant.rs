//! Who takes part in closed loop with the daemon's own control law.

use foretrace_control::predict::PredictorKind;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;

/// Who predicts, and who decides the trust in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawEntrant {
    /// Feedback only: trust 0.
    Hold,
    /// A predictor with trust 1.
    Believed(PredictorKind),
    /// `mixture` with automatic trust: the daemon as it is shipped.
    Mixture,
}

impl LawEntrant {
    /// All, in the order of figures and tables.
    pub const ALL: [Self; 9] = [
        Self::Hold,
        Self::Believed(PredictorKind::CONSTANT_VELOCITY),
        Self::Believed(PredictorKind::DYBM),
        Self::Believed(PredictorKind::DYBM_ESN),
        Self::Believed(PredictorKind::LSTM),
        Self::Believed(PredictorKind::AR_RLS),
        Self::Believed(PredictorKind::MIXTURE),
        Self::Mixture,
        Self::Believed(PredictorKind::ORACLE),
    ];

    /// Who predicts.
    #[must_use]
    pub const fn predictor(self) -> PredictorKind {
        match self {
            Self::Hold => PredictorKind::HOLD,
            Self::Believed(kind) => kind,
            Self::Mixture => PredictorKind::MIXTURE,
        }
    }

    /// Who decides the trust in it.
    #[must_use]
    pub const fn trust(self) -> TrustRequest {
        match self {
            Self::Hold => TrustRequest::Manual(Trust::NONE),
            Self::Believed(_) => TrustRequest::Manual(Trust::FULL),
            Self::Mixture => TrustRequest::Auto,
        }
    }
}
