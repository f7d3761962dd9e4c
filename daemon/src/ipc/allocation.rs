//! Separates allocations explained by a connecting or disconnecting peer from unexplained ones.
//!
//! Contract: allocations inside the law are never excused. Those of receiving and sending are excused only if
//! the set of connected peers changed at that time, within the interval between two looks at it and the time
//! the loop takes to notice. Totals come from cumulative counts, so that lost records lose nothing.

use std::collections::VecDeque;

use foretrace_control::units::Stamp;

use crate::rt::facts::TickFacts;

/// The loop connects in the first tick after a change, which a stall of the machine may delay by this much
/// \[ns\].
const NOTICE_NS: u64 = 250_000_000;
/// Allocations without an explanation after this time stay unexplained \[ns\].
const PATIENCE_NS: u64 = 1_000_000_000;

/// The verdicts on allocations after warm-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AllocationTotals {
    /// Without a connection that explains them.
    pub unexplained: u64,
    /// While a peer came or went.
    pub connection: u64,
    /// Ticks in which that happened.
    pub connection_ticks: u64,
}

/// An interval in which the set of peers changed.
#[derive(Debug, Clone, Copy)]
struct PeerChange {
    from: Stamp,
    to: Stamp,
}

#[derive(Debug)]
pub struct AllocationJudge {
    warm_after_ticks: u64,
    /// Cumulative counts already judged: at the ports, in the law.
    seen: Option<(u64, u64)>,
    /// Allocations at the ports that await an explanation: when, how many.
    waiting: VecDeque<(Stamp, u64)>,
    changes: VecDeque<PeerChange>,
    last_look: Option<(Stamp, u128)>,
    totals: AllocationTotals,
}

impl AllocationJudge {
    /// Ticks up to `warm_after_ticks` do not count.
    #[must_use]
    pub const fn new(warm_after_ticks: u64) -> Self {
        Self {
            warm_after_ticks,
            seen: None,
            waiting: VecDeque::new(),
            changes: VecDeque::new(),
            last_look: None,
            totals: AllocationTotals { unexplained: 0, connection: 0, connection_ticks: 0 },
        }
    }

    /// Takes in one tick.
    pub fn tick(&mut self, facts: &TickFacts) {
        let now = (facts.tally.port_allocations, facts.tally.law_allocations);
        let warm = facts.tick > self.warm_after_ticks;
        let (ports, law) = match self.seen.replace(now) {
            Some((ports, law)) if warm => (now.0.saturating_sub(ports), now.1.saturating_sub(law)),
            _ => return,
        };
        self.totals.unexplained += law;
        if ports > 0 {
            self.waiting.push_back((facts.finished, ports));
        }
    }

    /// Takes in the peers connected at `now`, and judges pending allocations.
    pub fn look(&mut self, now: Stamp, fingerprint: u128) {
        if let Some((before, seen)) = self.last_look
            && seen != fingerprint
        {
            self.changes.push_back(PeerChange { from: before, to: now.plus_ns(NOTICE_NS) });
        }
        self.last_look = Some((now, fingerprint));
        let changes = &self.changes;
        let totals = &mut self.totals;
        self.waiting.retain(|&(when, count)| {
            let explained = changes.iter().any(|change| when >= change.from && when <= change.to);
            if explained {
                totals.connection += count;
                totals.connection_ticks += 1;
            } else if now.since(when) > PATIENCE_NS as i64 {
                totals.unexplained += count;
            } else {
                return true;
            }
            false
        });
        while self.changes.front().is_some_and(|change| now.since(change.to) > 2 * PATIENCE_NS as i64) {
            self.changes.pop_front();
        }
    }

    /// The verdicts so far.
    #[must_use]
    pub const fn totals(&self) -> AllocationTotals {
        self.totals
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ipc::tests::facts;

    const MS: u64 = 1_000_000;

    /// One tick per 2 ms, with cumulative counts at the ports and in the law.
    fn tick(tick: u64, ports: u64, law: u64) -> TickFacts {
        let mut facts = facts(tick);
        facts.finished = Stamp(tick * 2 * MS);
        facts.tally.port_allocations = ports;
        facts.tally.law_allocations = law;
        facts
    }

    #[test]
    fn warm_up_is_forgiven() {
        let mut judge = AllocationJudge::new(10);
        for k in 1..=10 {
            judge.tick(&tick(k, 5 * k, 7 * k));
        }
        judge.look(Stamp(10_000 * MS), 1);
        assert_eq!(judge.totals(), AllocationTotals::default());
    }

    #[test]
    fn allocations_of_the_law_are_never_excused() {
        let mut judge = AllocationJudge::new(0);
        judge.look(Stamp(0), 1);
        judge.tick(&tick(1, 0, 0));
        judge.tick(&tick(2, 0, 3));
        judge.look(Stamp(5 * MS), 2);
        assert_eq!(judge.totals().unexplained, 3);
    }

    #[test]
    fn port_allocations_at_the_time_of_a_change_belong_to_it_whichever_is_seen_first() {
        for look_first in [true, false] {
            let mut judge = AllocationJudge::new(0);
            judge.look(Stamp(0), 1);
            judge.tick(&tick(1, 0, 0));
            if look_first {
                judge.look(Stamp(6 * MS), 2);
            }
            judge.tick(&tick(2, 39, 0));
            judge.look(Stamp(8 * MS), 2);
            assert_eq!(
                judge.totals(),
                AllocationTotals { unexplained: 0, connection: 39, connection_ticks: 1 }
            );
        }
    }

    #[test]
    fn port_allocations_without_a_change_are_unexplained_in_the_end() {
        let mut judge = AllocationJudge::new(0);
        judge.look(Stamp(0), 1);
        judge.tick(&tick(1, 0, 0));
        judge.tick(&tick(500, 2, 0));
        judge.look(Stamp(1001 * MS), 1);
        assert_eq!(judge.totals().unexplained, 0);
        // A change long after does not excuse it.
        judge.look(Stamp(1900 * MS), 1);
        judge.look(Stamp(1990 * MS), 9);
        judge.look(Stamp(2002 * MS), 9);
        assert_eq!(judge.totals(), AllocationTotals { unexplained: 2, connection: 0, connection_ticks: 0 });
    }

    #[test]
    fn a_lost_record_loses_no_allocation() {
        let mut judge = AllocationJudge::new(0);
        judge.tick(&tick(1, 0, 0));
        judge.tick(&tick(9, 0, 4));
        assert_eq!(judge.totals().unexplained, 4);
    }
}
