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

/// Daemon, and version of a set or tick of a preview.
type OfferedId = (u64, u64);

/// The newest set, and the newest preview of another process, that a tick was offered, until they are whole.
#[derive(Debug, Default)]
pub(crate) struct OfferedWeights {
    weights: Awaited,
    preview: Awaited,
}

#[derive(Debug, Default)]
struct Awaited {
    missing: Option<OfferedId>,
    whole: VecDeque<OfferedId>,
}

impl Awaited {
    fn offered(&mut self, id: OfferedId) {
        self.missing = Some(id).filter(|id| !self.whole.contains(id));
    }

    fn came(&mut self, id: OfferedId) {
        self.missing = self.missing.filter(|missing| *missing != id);
        self.whole.push_back(id);
        if self.whole.len() > KEPT {
            self.whole.pop_front();
        }
    }
}

impl OfferedWeights {
    /// A tick, and what it was offered.
    pub(crate) fn input(&mut self, input: &TickInput) {
        if input.flags & input_flags::WEIGHTS != 0 {
            self.weights.offered((input.daemon_id, input.weights_version));
        }
        if input.flags & input_flags::PREVIEW != 0 {
            self.preview.offered((input.daemon_id, input.tick));
        }
    }

    /// Something that is whole.
    pub(crate) fn thing(&mut self, thing: &Thing) {
        let id = (thing.daemon_id, thing.number);
        match thing.kind {
            PieceKind::Weights => self.weights.came(id),
            PieceKind::Preview => self.preview.came(id),
            PieceKind::Settings | PieceKind::State | PieceKind::Law => {}
        }
    }

    /// Whether the newest set or preview offered has not come.
    pub(crate) const fn is_due(&self) -> bool {
        self.weights.missing.is_some() || self.preview.missing.is_some()
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
