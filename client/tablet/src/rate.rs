//! At which rate a device really reports, and how evenly.
//!
//! Contract: pure, memory of fixed size. Only intervals between readings in motion count; a pause is none.

/// Intervals that are remembered.
const KEPT: usize = 256;
/// What is longer is a pause \[ns\].
const PAUSE_NS: u64 = 100_000_000;

#[derive(Debug, Clone)]
pub struct Rate {
    last_ns: Option<u64>,
    intervals: [u32; KEPT],
    count: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredRate {
    /// Readings per second, from the median interval.
    pub hz: f64,
    /// 95 % of the intervals are this close to the median \[ms\].
    pub jitter_ms: f64,
}

impl Default for Rate {
    fn default() -> Self {
        Self { last_ns: None, intervals: [0; KEPT], count: 0 }
    }
}

impl Rate {
    /// A reading of `stamp_ns`.
    pub fn take(&mut self, stamp_ns: u64) {
        if let Some(last) = self.last_ns {
            let interval = stamp_ns.saturating_sub(last);
            if (1..PAUSE_NS).contains(&interval) {
                if let Some(slot) = self.intervals.get_mut(self.count % KEPT) {
                    *slot = u32::try_from(interval).unwrap_or(u32::MAX);
                }
                self.count += 1;
            }
        }
        self.last_ns = Some(stamp_ns);
    }

    /// The rate; none before there are 20 intervals.
    #[must_use]
    pub fn measured(&self) -> Option<MeasuredRate> {
        let kept = self.count.min(KEPT);
        if kept < 20 {
            return None;
        }
        let mut sorted = self.intervals;
        let sorted = sorted.get_mut(..kept)?;
        sorted.sort_unstable();
        let median = *sorted.get(kept / 2)?;
        for interval in sorted.iter_mut() {
            *interval = interval.abs_diff(median);
        }
        sorted.sort_unstable();
        let off = *sorted.get(kept * 95 / 100)?;
        Some(MeasuredRate { hz: 1e9 / f64::from(median.max(1)), jitter_ms: f64::from(off) * 1e-6 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_pen_has_its_rate_and_no_jitter_and_pauses_do_not_count() {
        let mut rate = Rate::default();
        for stroke in 0..10_u64 {
            for index in 0..30_u64 {
                rate.take(stroke * 3_000_000_000 + index * 5_000_000);
            }
        }
        let measured = rate.measured().unwrap();
        assert!((measured.hz - 200.0).abs() < 1e-9 && measured.jitter_ms == 0.0, "{measured:?}");
    }

    #[test]
    fn jitter_is_what_nineteen_of_twenty_intervals_keep_within() {
        let mut rate = Rate::default();
        assert_eq!(rate.measured(), None);
        let mut stamp = 0;
        for index in 0..400_u64 {
            stamp += if index % 4 == 0 { 6_000_000 } else { 5_000_000 };
            rate.take(stamp);
        }
        let measured = rate.measured().unwrap();
        assert!(
            (measured.hz - 200.0).abs() < 1e-9 && (measured.jitter_ms - 1.0).abs() < 1e-9,
            "{measured:?}"
        );
    }

    #[test]
    fn stamps_that_run_backwards_or_stand_count_for_nothing() {
        let mut rate = Rate::default();
        for stamp in [9, 9, 8, u64::MAX, 0, 7].into_iter().cycle().take(1000) {
            rate.take(stamp);
        }
        assert!(rate.measured().is_none_or(|measured| measured.hz.is_finite()));
    }
}
