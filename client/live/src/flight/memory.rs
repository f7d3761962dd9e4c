//! The last seconds of a daemon, and what a replay of them begins with.
//!
//! Contract: bounded by the time that is kept, also when no state comes any more.

use std::collections::VecDeque;
use std::io::Write;
use std::path::Path;

use foretrace_shm::{PieceKind, Thing, TickInput, TickRecord};

use crate::recorder::{OfferedWeights, put_input, put_thing, put_tick, unix_minus_monotonic};
use crate::trace;
use foretrace_record::RecordError;
use foretrace_record::write::Output;

/// Sets of weights that are kept: more than the loop is offered in the longest time kept.
const SETS: usize = 4096;
/// Times the time kept that inputs are kept at most, for want of a newer state.
const BEHIND: u64 = 4;

#[derive(Debug, Default)]
pub(super) struct FlightMemory {
    law: Option<Thing>,
    settings: Option<Thing>,
    states: VecDeque<Thing>,
    sets: VecDeque<Thing>,
    /// Previews of another process, by tick.
    previews: VecDeque<Thing>,
    inputs: VecDeque<Box<TickInput>>,
    pub(super) ticks: VecDeque<Box<TickRecord>>,
    offered: OfferedWeights,
}

impl FlightMemory {
    /// Whether the newest tick cannot be run again yet: its weights are on their way.
    pub(super) const fn lacks_weights(&self) -> bool {
        self.offered.is_due()
    }

    pub(super) fn input(&mut self, input: Box<TickInput>) {
        self.offered.input(&input);
        self.inputs.push_back(input);
    }

    pub(super) fn thing(&mut self, thing: Thing) {
        self.offered.thing(&thing);
        match thing.kind {
            PieceKind::Law => self.law = Some(thing),
            PieceKind::Settings => self.settings = Some(thing),
            PieceKind::State => self.states.push_back(thing),
            PieceKind::Preview => self.previews.push_back(thing),
            PieceKind::Weights => {
                // Whoever begins to listen again gets the newest ones again.
                let known = self
                    .sets
                    .iter()
                    .any(|set| (set.daemon_id, set.number) == (thing.daemon_id, thing.number));
                if !known {
                    self.sets.push_back(thing);
                }
                if self.sets.len() > SETS {
                    self.sets.pop_front();
                }
            }
        }
    }

    /// Forgets what is older than `keep_ns`, but not what a replay needs to begin with.
    pub(super) fn forget(&mut self, keep_ns: u64) {
        let Some(newest) = self.inputs.back() else { return };
        let oldest_ns = newest.now_ns.saturating_sub(keep_ns);
        let daemon = newest.daemon_id;
        let oldest = self.inputs.iter().find(|input| input.now_ns >= oldest_ns && input.daemon_id == daemon);
        let Some(oldest) = oldest.map(|input| input.tick) else { return };
        // The newest state from which all of that can be run again.
        let start = self.states.iter().rposition(|state| state.number < oldest && state.daemon_id == daemon);
        let from = start.and_then(|start| {
            self.states.drain(..start);
            self.states.front().map(|state| state.number)
        });
        let needed = from.map_or(oldest, |from| from.min(oldest));
        // A state that no newer one follows must not keep all that came since.
        let bound_ns = newest.now_ns.saturating_sub(keep_ns.saturating_mul(BEHIND));
        let old =
            |input: &TickInput| input.daemon_id != daemon || input.tick < needed || input.now_ns < bound_ns;
        while self.inputs.front().is_some_and(|input| old(input)) {
            self.inputs.pop_front();
        }
        let first = self.inputs.front().map_or(0, |input| input.tick);
        let kept = |preview: &Thing| preview.daemon_id == daemon && preview.number >= first;
        while self.previews.front().is_some_and(|preview| !kept(preview)) {
            self.previews.pop_front();
        }
        self.states.retain(|state| state.daemon_id == daemon && state.number.saturating_add(1) >= first);
        while self.ticks.front().is_some_and(|record| record.release_ns < oldest_ns) {
            self.ticks.pop_front();
        }
        // A set that no kept tick was offered, nor the next ones will be.
        let first =
            self.inputs.iter().find_map(|input| (input.weights_used > 0).then_some(input.weights_used));
        while self
            .sets
            .front()
            .is_some_and(|set| set.daemon_id != daemon || first.is_some_and(|v| set.number < v))
        {
            self.sets.pop_front();
        }
    }

    pub(super) fn write(&self, output: &mut Output) -> Result<(), RecordError> {
        let clock = unix_minus_monotonic();
        let at = |ns: u64| ns.wrapping_add(clock);
        let begin = at(self.inputs.front().map_or(0, |input| input.header.stamp_ns));
        for thing in
            self.law.iter().chain(&self.settings).chain(&self.states).chain(&self.sets).chain(&self.previews)
        {
            put_thing(output, begin, thing)?;
        }
        // In order of time, as they came.
        let mut ticks = self.ticks.iter().peekable();
        for input in &self.inputs {
            while let Some(record) = ticks.next_if(|record| record.tick <= input.tick) {
                put_tick(output, at(record.header.stamp_ns), record)?;
            }
            put_input(output, at(input.header.stamp_ns), input)?;
        }
        ticks.try_for_each(|record| put_tick(output, at(record.header.stamp_ns), record))
    }

    /// Writes the same as a Perfetto trace of the daemon with the process number `pid` to `out`, which is
    /// `path`.
    pub(super) fn write_trace(&self, pid: u64, out: &mut impl Write, path: &Path) -> Result<(), RecordError> {
        let from = self.ticks.front().map_or(0, |record| record.tick);
        let inputs = self.inputs.iter().map(|input| &**input).filter(|input| input.tick >= from);
        trace::write(pid, self.ticks.iter().map(|tick| &**tick), inputs, out, path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input(tick: u64) -> Box<TickInput> {
        Box::new(TickInput { tick, now_ns: tick * 1_000_000, daemon_id: 1, ..Default::default() })
    }

    fn state(number: u64) -> Thing {
        Thing { kind: PieceKind::State, number, daemon_id: 1, bytes: Vec::new() }
    }

    #[test]
    fn what_is_kept_begins_at_the_newest_state_that_is_old_enough() {
        let mut memory = FlightMemory::default();
        for tick in 1..=1000 {
            if tick % 100 == 50 {
                memory.thing(state(tick - 1));
            }
            memory.inputs.push_back(input(tick));
            memory.ticks.push_back(Box::new(TickRecord {
                tick,
                release_ns: tick * 1_000_000,
                ..Default::default()
            }));
            memory.forget(300_000_000);
        }
        // 300 ms before tick 1000 is tick 700; the state before that is of tick 649.
        assert_eq!(memory.states.front().unwrap().number, 649);
        assert_eq!(memory.inputs.front().unwrap().tick, 649);
        assert_eq!(memory.ticks.front().unwrap().tick, 700);
        // Another daemon: nothing of the last one is of use.
        memory.inputs.push_back(Box::new(TickInput { daemon_id: 2, ..*input(1001) }));
        memory.forget(300_000_000);
        assert_eq!(memory.inputs.len(), 1);
    }

    #[test]
    fn a_tick_lacks_the_weights_that_it_was_offered_until_they_are_whole() {
        let mut memory = FlightMemory::default();
        memory.input(input(1));
        assert!(!memory.lacks_weights());
        memory.input(Box::new(TickInput {
            flags: foretrace_shm::input_flags::WEIGHTS,
            weights_version: 4,
            ..*input(2)
        }));
        memory.input(input(3));
        assert!(memory.lacks_weights());
        memory.thing(Thing { kind: PieceKind::Weights, ..state(4) });
        assert!(!memory.lacks_weights());
    }

    #[test]
    fn memory_is_bounded_when_no_further_state_comes() {
        let mut memory = FlightMemory::default();
        memory.thing(state(1));
        for tick in 1..=5000 {
            memory.inputs.push_back(input(tick));
            memory.forget(300_000_000);
        }
        assert!(memory.inputs.len() <= 1201, "{} inputs of 1 ms for 300 ms", memory.inputs.len());
        assert!(memory.states.is_empty(), "nothing can be run from it");
        memory.thing(state(5000));
        memory.inputs.push_back(input(5001));
        memory.forget(300_000_000);
        assert_eq!(memory.states.len(), 1);
    }
}
