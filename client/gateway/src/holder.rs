//! Whether the client that holds the only place keeps it when another asks.
//!
//! Contract: pure (time is an argument), memory of fixed size. A pen sends many samples per second, also
//! while it hovers or rests; samples farther apart than the gap that the loop bridges (`pen.max_gap_ms`, 100
//! ms as shipped) are no stroke, and do not keep the place.

use std::time::{Duration, Instant};

/// Fewest samples that must have passed in the time that counts: 5 s at one per 100 ms.
pub(crate) const LEAST: usize = 50;

/// Why a client gives way.
pub(crate) const SILENT: &str = "silent, and another client came";
/// Why a client gives way.
pub(crate) const SPARSE: &str =
    "fewer than 50 good samples in 5 s, too few for a pen, and another client came";

/// When the client came, and when its newest samples passed.
#[derive(Debug)]
pub(crate) struct SlotHolder {
    since: Instant,
    last: Instant,
    /// The newest [`LEAST`], as a ring.
    passed: [Option<Instant>; LEAST],
    next: usize,
}

impl SlotHolder {
    /// A client that came `now`.
    pub(crate) fn new(now: Instant) -> Self {
        Self { since: now, last: now, passed: [None; LEAST], next: 0 }
    }

    /// A sample passed `now`.
    pub(crate) fn pass(&mut self, now: Instant) {
        self.last = now;
        if let Some(oldest) = self.passed.get_mut(self.next) {
            *oldest = Some(now);
        }
        self.next = (self.next + 1) % LEAST;
    }

    /// Why it gives way to another that asks `now`; none where it keeps its place. `silence`: the time that
    /// counts.
    pub(crate) fn gives_way(&self, now: Instant, silence: Duration) -> Option<&'static str> {
        let within = |then: Instant| now.saturating_duration_since(then) <= silence;
        if !within(self.last) {
            return Some(SILENT);
        }
        // The oldest of the ring is the one that is overwritten next.
        let oldest = self.passed.get(self.next).copied().flatten();
        let enough = within(self.since) || oldest.is_some_and(within);
        (!enough).then_some(SPARSE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SILENCE: Duration = Duration::from_secs(5);

    fn after(gap_ms: u64, samples: u64) -> Option<&'static str> {
        let begin = Instant::now();
        let mut holder = SlotHolder::new(begin);
        for index in 1..=samples {
            holder.pass(begin + Duration::from_millis(gap_ms * index));
        }
        holder.gives_way(begin + Duration::from_millis(gap_ms * samples + 1), SILENCE)
    }

    #[test]
    fn one_good_sample_per_four_seconds_keeps_no_place() {
        assert_eq!(after(4000, 30), Some(SPARSE));
        assert_eq!(after(110, 200), Some(SPARSE));
    }

    #[test]
    fn a_pen_keeps_its_place_as_does_whoever_has_just_come() {
        for gap_ms in [1, 5, 8, 20, 90] {
            assert_eq!(after(gap_ms, 2000), None, "{gap_ms}");
        }
        assert_eq!(after(2000, 2), None);
        assert_eq!(after(1, 0), None);
    }

    #[test]
    fn a_pen_that_was_away_for_a_moment_keeps_its_place_and_one_that_is_silent_does_not() {
        let begin = Instant::now();
        let mut holder = SlotHolder::new(begin);
        for index in 0..2000 {
            holder.pass(begin + Duration::from_millis(5 * index));
        }
        let end = begin + Duration::from_secs(10);
        assert_eq!(holder.gives_way(end + Duration::from_secs(4), SILENCE), None);
        assert_eq!(holder.gives_way(end + Duration::from_millis(5100), SILENCE), Some(SILENT));
    }
}
