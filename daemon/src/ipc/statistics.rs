//! Durations: distributions per stage over all ticks after warm-up, and the rate achieved.

use hdrhistogram::Histogram;

use foretrace_control::units::Stamp;
use foretrace_shm::{Percentiles, STAGES};

use super::record;
use crate::rt::facts::{StageTimes, TickFacts};

/// Longer times count as this \[ns\].
const LONGEST_NS: u64 = 1_000_000_000;
/// Relative width of a bin: 1 %.
const DIGITS: u8 = 2;

/// Distributions of all stages.
#[derive(Debug)]
pub struct Spreads {
    stages: Vec<Histogram<u64>>,
}

impl Spreads {
    #[must_use]
    pub fn new() -> Self {
        // The crate accepts these constant bounds; without histograms there would be no percentiles.
        let one = Histogram::new_with_bounds(1, LONGEST_NS, DIGITS).ok();
        Self { stages: one.into_iter().cycle().take(STAGES).collect() }
    }

    pub fn add(&mut self, times: &StageTimes) {
        for (histogram, (_, ns)) in self.stages.iter_mut().zip(record::stages(times)) {
            histogram.saturating_record(ns.max(1));
        }
    }

    /// The spreads so far, in the order of the stages.
    #[must_use]
    pub fn percentiles(&self) -> [Percentiles; STAGES] {
        let mut stages = self.stages.iter();
        std::array::from_fn(|_| stages.next().map(percentiles).unwrap_or_default())
    }
}

/// The percentiles of a distribution \[ns\]; zero without values.
pub fn percentiles(spread: &Histogram<u64>) -> Percentiles {
    let saturated = |ns: u64| u32::try_from(ns).unwrap_or(u32::MAX);
    // The upper edge of a bin may exceed its largest value.
    let max = spread.max();
    let at = |quantile| saturated(spread.value_at_quantile(quantile).min(max));
    Percentiles { p50_ns: at(0.5), p99_ns: at(0.99), p99_9_ns: at(0.999), max_ns: saturated(max) }
}

impl Default for Spreads {
    fn default() -> Self {
        Self::new()
    }
}

/// Ticks per second over about the last second.
#[derive(Debug, Clone, Copy, Default)]
pub struct RateMeter {
    since: Option<(Stamp, u64)>,
    hz: f64,
}

impl RateMeter {
    /// Takes in a tick; returns the rate \[Hz\], 0 during the first second.
    pub fn measure(&mut self, facts: &TickFacts) -> f64 {
        let (now, ticks) = (facts.wake.started, facts.tally.ticks);
        let (then, before) = *self.since.get_or_insert((now, ticks));
        let seconds = now.seconds_since(then);
        if seconds >= 1.0 {
            self.hz = ticks.saturating_sub(before) as f64 / seconds;
            self.since = Some((now, ticks));
        }
        self.hz
    }
}

/// Root mean square with forgetting, over about `memory` values.
#[derive(Debug, Clone, Copy)]
pub struct RunningRms {
    memory: f64,
    count: f64,
    square: f64,
}

impl RunningRms {
    #[must_use]
    pub const fn new(memory: f64) -> Self {
        Self { memory, count: 0.0, square: 0.0 }
    }

    /// Adds a value; non-finite ones are ignored.
    pub fn add(&mut self, value: f64) {
        if value.is_finite() {
            self.count = (self.count + 1.0).min(self.memory);
            self.square += (value * value - self.square) / self.count;
        }
    }

    /// The value; negative before the first.
    #[must_use]
    pub fn value(&self) -> f64 {
        if self.count > 0.0 { self.square.sqrt() } else { -1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_shm::Stage;

    #[test]
    fn percentiles_of_a_uniform_spread_are_where_they_should_be() {
        let mut spreads = Spreads::new();
        for ns in 1..=100_000_u64 {
            spreads.add(&StageTimes { step: ns, ..StageTimes::default() });
        }
        let step = spreads.percentiles()[Stage::Step as usize];
        for (found, expected) in [(step.p50_ns, 50_000.0), (step.p99_ns, 99_000.0), (step.p99_9_ns, 99_900.0)]
        {
            assert!((f64::from(found) / expected - 1.0).abs() < 0.01, "{found} for {expected}");
        }
        assert!(step.max_ns >= 100_000 && step.max_ns < 101_000);
        assert!(step.p99_9_ns <= step.max_ns);
    }

    #[test]
    fn times_beyond_the_range_are_kept_as_the_longest() {
        let mut spreads = Spreads::new();
        spreads.add(&StageTimes { wakeup: u64::MAX, ..StageTimes::default() });
        assert!(spreads.percentiles()[Stage::Wakeup as usize].max_ns >= 1_000_000_000);
    }

    #[test]
    fn an_empty_spread_is_zero() {
        assert_eq!(Spreads::new().percentiles(), [Percentiles::default(); STAGES]);
    }

    #[test]
    fn the_running_rms_of_a_constant_is_the_constant() {
        let mut rms = RunningRms::new(100.0);
        assert!(rms.value() < 0.0);
        for _ in 0..1000 {
            rms.add(-0.003);
            rms.add(f64::NAN);
        }
        assert!((rms.value() - 0.003).abs() < 1e-12);
    }
}
