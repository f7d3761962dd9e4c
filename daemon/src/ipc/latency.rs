//! End-to-end latencies over all ticks since warm-up: pen to command, and command to motion.
//!
//! Contract: fed tick by tick on the ipc thread; no allocation per tick. Medians of the parts are in
//! [`super::chain`].

use std::collections::VecDeque;

use hdrhistogram::Histogram;

use foretrace_control::units::Stamp;
use foretrace_shm::{LATENCY_BINS, Latency, Percentiles};

use super::statistics::percentiles;
use crate::rt::facts::TickFacts;

/// Longer times count as this \[ns\].
const LONGEST_NS: u64 = 60_000_000_000;
/// Largest standard deviation of the lag for a latency of the motion \[s\].
const KNOWN_S: f64 = 3e-3;

/// Both latencies, over all ticks since warm-up.
#[derive(Debug)]
pub struct Latencies {
    pen_to_command: Meter,
    command_to_motion: Meter,
    /// From a grid step sent to another process to its preview received, recent.
    preview: Recent,
    pen: Option<(Stamp, u64)>,
}

impl Latencies {
    #[must_use]
    pub fn new() -> Self {
        Self {
            pen_to_command: Meter::new(),
            command_to_motion: Meter::new(),
            preview: Recent::default(),
            pen: None,
        }
    }

    /// Takes in a tick.
    ///
    /// Pen to command: from the device stamp of a pen sample to the first command handed over after it was
    /// received. Command to motion: from there to the command's stamp, plus the measured lag of the arm.
    pub fn tick(&mut self, facts: &TickFacts) {
        self.preview.add(facts.finished, facts.previews.latency_ns);
        let output = &facts.output;
        let pen = output.pen_stamp.map(|stamp| (stamp, output.pen_origin.sequence));
        let fresh = pen != self.pen;
        self.pen = pen;
        let Some(command) = output.command.filter(|_| !facts.not_sent) else { return };
        if let Some((stamp, _)) = pen.filter(|_| fresh) {
            self.pen_to_command.add(facts.published.since(stamp));
        }
        if let Some(lag) = output.lag.filter(|lag| lag.std_s <= KNOWN_S) {
            self.command_to_motion.add(command.stamp.since(facts.published) + (lag.lag_s * 1e9) as i64);
        }
    }

    /// From the pen's device stamp to the command.
    #[must_use]
    pub fn pen_to_command(&self) -> Latency {
        self.pen_to_command.latency()
    }

    /// From a grid step sent to another process to its preview received.
    #[must_use]
    pub fn preview(&self) -> Percentiles {
        self.preview.percentiles()
    }

    /// From the command to its motion.
    #[must_use]
    pub fn command_to_motion(&self) -> Latency {
        self.command_to_motion.latency()
    }
}

impl Default for Latencies {
    fn default() -> Self {
        Self::new()
    }
}

/// The values of the last two seconds.
#[derive(Debug, Default)]
struct Recent {
    /// When, and the value \[ns\].
    values: VecDeque<(Stamp, u64)>,
}

/// How long a value counts \[ns\].
const RECENT_NS: i64 = 2_000_000_000;
/// Most of them: two seconds of the shortest steps, 4 ms.
const RECENT: usize = 500;

impl Recent {
    fn add(&mut self, now: Stamp, ns: Option<u64>) {
        self.values.extend(ns.map(|ns| (now, ns)));
        let old = |(at, _): &(Stamp, u64)| now.since(*at) > RECENT_NS;
        while self.values.len() > RECENT || self.values.front().is_some_and(old) {
            self.values.pop_front();
        }
    }

    fn percentiles(&self) -> Percentiles {
        let mut sorted: Vec<u64> = self.values.iter().map(|(_, ns)| *ns).collect();
        sorted.sort_unstable();
        let at = |quantile: f64| {
            let last = sorted.len().saturating_sub(1) as f64;
            let index = (quantile * last).ceil() as usize;
            u32::try_from(sorted.get(index).copied().unwrap_or(0)).unwrap_or(u32::MAX)
        };
        Percentiles { p50_ns: at(0.5), p99_ns: at(0.99), p99_9_ns: at(0.999), max_ns: at(1.0) }
    }
}

#[derive(Debug)]
struct Meter {
    spread: Option<Histogram<u64>>,
    bins: [u32; LATENCY_BINS],
}

impl Meter {
    fn new() -> Self {
        // The crate accepts these constant bounds; without a histogram there would be no percentiles.
        Self { spread: Histogram::new_with_bounds(1, LONGEST_NS, 2).ok(), bins: [0; LATENCY_BINS] }
    }

    fn add(&mut self, ns: i64) {
        let ns = u64::try_from(ns).unwrap_or(0);
        if let Some(spread) = &mut self.spread {
            spread.saturating_record(ns.max(1));
        }
        if let Some(bin) = self.bins.get_mut(Latency::bin(ns)) {
            *bin = bin.saturating_add(1);
        }
    }

    fn latency(&self) -> Latency {
        let Some(spread) = self.spread.as_ref().filter(|spread| !spread.is_empty()) else {
            return Latency::default();
        };
        Latency { count: spread.len(), percentiles: percentiles(spread), bins: self.bins }
    }
}

#[cfg(test)]
mod tests {
    use foretrace_control::arm::lag::LagEstimate;

    use super::*;
    use crate::ipc::tests::commanding;

    const MS: u64 = 1_000_000;

    #[test]
    fn each_pen_sample_counts_once_and_the_tail_is_seen() {
        let mut latencies = Latencies::new();
        for tick in 1..=1000_u64 {
            let mut facts = commanding(tick);
            // One sample in five ticks; one in a hundred of them is 50 ms old, the others 2 ms.
            let sample = tick / 5;
            let age = if sample.is_multiple_of(100) { 50 } else { 2 };
            facts.published = facts.wake.release.plus_ns(100_000_000);
            facts.output.pen_origin.sequence = sample;
            let first = tick.is_multiple_of(5) || tick == 1;
            facts.output.pen_stamp = Some(if first {
                Stamp(facts.published.0 - age * MS)
            } else {
                latencies.pen.expect("a sample before").0
            });
            facts.output.lag = Some(LagEstimate { lag_s: 0.04, std_s: 1e-4, shift_s: 0.04 });
            facts.output.command.as_mut().unwrap().stamp = facts.published.plus_ns(MS);
            latencies.tick(&facts);
        }
        let pen = latencies.pen_to_command();
        assert_eq!(pen.count, 201);
        let ms = |ns: u32| f64::from(ns) * 1e-6;
        assert!(
            (ms(pen.percentiles.p50_ns) - 2.0).abs() < 0.05
                && (ms(pen.percentiles.max_ns) - 50.0).abs() < 1.0
        );
        assert_eq!(pen.bins.iter().sum::<u32>(), 201);
        assert_eq!(pen.bins[Latency::bin(50 * MS)], 3);
        let motion = latencies.command_to_motion();
        assert!((ms(motion.percentiles.p50_ns) - 41.0).abs() < 0.5 && motion.count == 1000, "{motion:?}");
    }

    #[test]
    fn nothing_is_claimed_of_an_arm_that_is_not_known_or_a_command_that_did_not_leave() {
        let mut latencies = Latencies::new();
        let mut facts = commanding(1);
        facts.output.pen_stamp = Some(Stamp(1));
        facts.not_sent = true;
        latencies.tick(&facts);
        facts.not_sent = false;
        facts.output.lag = Some(LagEstimate { lag_s: 0.04, std_s: 0.02, shift_s: 0.04 });
        latencies.tick(&facts);
        assert_eq!((latencies.pen_to_command().count, latencies.command_to_motion().count), (0, 0));
    }
}
