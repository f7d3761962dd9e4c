//! Whether the weights that ticks were offered have come whole.
//!
//! A set travels in pieces, behind the input of the tick that it was offered to. A file that ends in between
//! has ticks that cannot be run again.

use std::collections::VecDeque;
use std::time::Duration;

use foretrace_shm::{PieceKind, Thing, TickInput, input_flags};

/// Longest wait for a set that is on its way: a state that goes before it takes 50 ms.
pub(crate) const PATIENCE: Duration = Duration::from_millis(200);
/// Sets that are remembered: more than are on their way to a loop.
const KEPT: usize = 16;

/// Daemon and version of a set.
type WeightsId = (u64, u64);

/// The newest set that a tick was offered, until it is whole.
#[derive(Debug, Default)]
pub(crate) struct OfferedWeights {
    missing: Option<WeightsId>,
    whole: VecDeque<WeightsId>,
}

impl OfferedWeights {
    /// A tick, and what it was offered.
    pub(crate) fn input(&mut self, input: &TickInput) {
        let set = (input.daemon_id, input.weights_version);
        if input.flags & input_flags::WEIGHTS != 0 {
            self.missing = Some(set).filter(|set| !self.whole.contains(set));
        }
    }

    /// Something that is whole.
    pub(crate) fn thing(&mut self, thing: &Thing) {
        if thing.kind != PieceKind::Weights {
            return;
        }
        let set = (thing.daemon_id, thing.number);
        self.missing = self.missing.filter(|missing| *missing != set);
        self.whole.push_back(set);
        if self.whole.len() > KEPT {
            self.whole.pop_front();
        }
    }

    /// Whether the newest set offered has not come.
    pub(crate) const fn is_due(&self) -> bool {
        self.missing.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_is_due_from_the_tick_that_it_is_offered_to_until_it_is_whole_whichever_comes_first() {
        let input = |daemon_id, weights_version| TickInput {
            daemon_id,
            weights_version,
            flags: input_flags::WEIGHTS,
            ..TickInput::default()
        };
        let set = |kind, daemon_id, number| Thing { kind, number, daemon_id, bytes: Vec::new() };
        let mut offered = OfferedWeights::default();
        offered.input(&TickInput { weights_version: 3, ..TickInput::default() });
        assert!(!offered.is_due(), "nothing was offered");
        offered.input(&input(1, 3));
        for other in
            [set(PieceKind::State, 1, 3), set(PieceKind::Weights, 2, 3), set(PieceKind::Weights, 1, 2)]
        {
            offered.thing(&other);
            assert!(offered.is_due(), "{other:?}");
        }
        offered.thing(&set(PieceKind::Weights, 1, 3));
        assert!(!offered.is_due());
        offered.thing(&set(PieceKind::Weights, 1, 4));
        offered.input(&input(1, 4));
        assert!(!offered.is_due(), "it came before its tick");
        offered.input(&input(1, 5));
        offered.input(&input(1, 4));
        assert!(!offered.is_due(), "only the newest one counts");
    }
}
