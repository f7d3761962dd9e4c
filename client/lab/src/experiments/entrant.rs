//! The predictors in closed loop with the daemon's own control law.

use foretrace_control::predict::{Needs, PredictorKind};
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;

/// The paper's baseline, its predictor without and with a reservoir.
const PAPERS: [PredictorKind; 3] =
    [PredictorKind::CONSTANT_VELOCITY, PredictorKind::DYBM, PredictorKind::DYBM_ESN];

/// A predictor, and how its trust is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawEntrant {
    /// Feedback only: trust 0.
    Hold,
    /// A predictor with trust 1.
    Believed(PredictorKind),
    /// `mixture` with automatic trust: the daemon as shipped.
    Mixture,
}

impl LawEntrant {
    /// All that this process runs, in the order of figures and tables: feedback only, the paper's baseline
    /// and its own, the others in the registry's order, the daemon as shipped, and last the oracle.
    pub fn all() -> impl Iterator<Item = Self> + Clone {
        let others = PredictorKind::BUILT_IN.into_iter();
        let others = others.filter(|kind| *kind != PredictorKind::HOLD && !PAPERS.contains(kind));
        let knowing = PredictorKind::ALL.into_iter().filter(|kind| kind.needs() == Needs::Recording);
        let believed = PAPERS.into_iter().chain(others).map(Self::Believed);
        std::iter::once(Self::Hold).chain(believed).chain([Self::Mixture]).chain(knowing.map(Self::Believed))
    }

    #[must_use]
    pub const fn predictor(self) -> PredictorKind {
        match self {
            Self::Hold => PredictorKind::HOLD,
            Self::Believed(kind) => kind,
            Self::Mixture => PredictorKind::MIXTURE,
        }
    }

    /// How its trust is set.
    #[must_use]
    pub const fn trust(self) -> TrustRequest {
        match self {
            Self::Hold => TrustRequest::Manual(Trust::NONE),
            Self::Believed(_) => TrustRequest::Manual(Trust::FULL),
            Self::Mixture => TrustRequest::Auto,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_predictor_takes_part_once_in_the_order_of_the_tables() {
        let names = |entrant: LawEntrant| (entrant.predictor().name(), entrant.trust() == TrustRequest::Auto);
        let all: Vec<_> = LawEntrant::all().map(names).collect();
        let known = [
            ("hold", false),
            ("constant-velocity", false),
            ("dybm", false),
            ("dybm-esn", false),
            ("lstm", false),
            ("ar-rls", false),
            ("mixture", false),
        ];
        assert_eq!(all[..known.len()], known);
        assert_eq!(all[all.len() - 2..], [("mixture", true), ("oracle", false)]);
        // What runs in another process has no place in the registry's own tables.
        let own = PredictorKind::ALL.into_iter().filter(|kind| kind.needs() != Needs::Process);
        assert_eq!(all.len(), own.clone().count() + 1);
        for kind in own {
            assert!(all.contains(&(kind.name(), false)), "{kind:?} takes no part");
        }
    }
}
