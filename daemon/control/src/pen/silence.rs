//! How long a pen has been silent, and where it rests then: many devices send nothing while the pen stands.
//!
//! Silence counts from the arrival of the newest sample, not from its stamp: behind a network every sample is
//! old when it arrives, and the pen is not at rest.

use super::PenReading;
use crate::state::state;
use crate::units::Stamp;

/// Longest sampling interval of a device \[ns\]; longer ones are pauses.
const LONGEST_INTERVAL_NS: u64 = 40_000_000;
/// Shortest time after which a device counts as silent \[ns\].
const LEAST_PATIENCE_NS: u64 = 20_000_000;

/// The newest sample.
#[derive(Debug, Clone, Copy)]
struct Newest {
    stamp: Stamp,
    /// Earliest instant at which it can have arrived: after the tick before, and after it was measured.
    arrived: Stamp,
    /// \[m\]
    position: [f64; 2],
}

state! { whole [] Newest { stamp, arrived, position } }

/// The newest sample and the usual sampling interval.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PenSilence {
    newest: Option<Newest>,
    interval_ns: u64,
    /// Time of the last tick.
    looked: Stamp,
}

state! { [] PenSilence { newest, interval_ns, looked } }

impl PenSilence {
    /// No samples yet; a device that is assumed to sample once in `interval_ns` \[ns\].
    pub(crate) const fn new(interval_ns: u64) -> Self {
        Self { newest: None, interval_ns, looked: Stamp(0) }
    }

    /// Takes in the newest sample that has arrived by `now`, if there is any; it may be repeated.
    pub(crate) fn observe(&mut self, now: Stamp, newest: Option<&PenReading>) {
        let looked = std::mem::replace(&mut self.looked, now);
        let Some(newest) = newest else { return };
        let before = self.newest;
        let elapsed_ns = before.map_or(0, |before| newest.stamp.0.saturating_sub(before.stamp.0));
        if (1..=LONGEST_INTERVAL_NS).contains(&elapsed_ns) {
            self.interval_ns = self.interval_ns - self.interval_ns / 8 + elapsed_ns / 8;
        }
        let repeated = before.filter(|before| before.stamp == newest.stamp);
        let arrived = repeated.map_or(newest.stamp.max(looked), |before| before.arrived);
        self.newest = Some(Newest { stamp: newest.stamp, arrived, position: newest.position });
    }

    /// Time since the newest sample arrived \[ns\].
    pub(crate) fn silent_ns(&self, now: Stamp) -> Option<u64> {
        self.newest.map(|newest| now.0.saturating_sub(newest.arrived.0))
    }

    /// Age that the newest sample had when it arrived \[ns\]; 0 if it may have been measured since the tick
    /// before.
    pub(crate) fn late_ns(&self) -> Option<u64> {
        self.newest.map(|newest| newest.arrived.0.saturating_sub(newest.stamp.0))
    }

    /// Where the pen is assumed to have come to rest \[m\], if the device has been silent for longer than
    /// usual.
    pub(crate) fn resting_at(&self, now: Stamp) -> Option<[f64; 2]> {
        let patience_ns = (self.interval_ns * 5 / 2).max(LEAST_PATIENCE_NS);
        let newest =
            self.newest.filter(|_| self.silent_ns(now).is_some_and(|silent| silent > patience_ns))?;
        Some(newest.position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pen_whose_samples_stay_away_has_stopped_at_the_last_one() {
        for interval_ns in [5_000_000, 16_000_000] {
            let mut silence = PenSilence::new(10_000_000);
            let mut stamp = 1_000_000_000 - 40 * interval_ns;
            for _ in 0..41 {
                let reading = PenReading::new(Stamp(stamp), [0.0007, -0.0001], true);
                silence.observe(Stamp(stamp + 1), Some(&reading));
                stamp += interval_ns;
            }
            let newest = stamp - interval_ns;
            let patience = (interval_ns * 5 / 2).max(20_000_000);
            for after in [0, patience - 500_000] {
                assert_eq!(silence.resting_at(Stamp(newest + after)), None, "{interval_ns} ns");
            }
            let silent = silence.resting_at(Stamp(newest + patience + 500_000));
            assert_eq!(silent, Some([0.0007, -0.0001]), "{interval_ns} ns");
        }
        assert_eq!(PenSilence::new(10_000_000).resting_at(Stamp(u64::MAX)), None, "no sample yet");
    }

    #[test]
    fn silence_counts_from_arrival_and_the_age_then_is_told_apart() {
        const LATE_NS: u64 = 60_000_000;
        let mut silence = PenSilence::new(5_000_000);
        let mut now = 1_000_000_000;
        // Before the first tick nothing is known of arrivals.
        silence.observe(Stamp(now), None);
        for tick in 0..500_u64 {
            now += 2_000_000;
            // A sample of 200 Hz arrives in every fifth half of a tick, 60 ms old.
            let stamp = (now - LATE_NS) / 5_000_000 * 5_000_000;
            silence.observe(Stamp(now), Some(&PenReading::new(Stamp(stamp), [0.0, 0.0], true)));
            assert_eq!(silence.resting_at(Stamp(now)), None, "tick {tick}");
        }
        let late = silence.late_ns().unwrap();
        assert!((LATE_NS - 7_000_000..LATE_NS).contains(&late), "{late}");
        assert!(silence.silent_ns(Stamp(now)).unwrap() <= 7_000_000);
        for _ in 0..12 {
            now += 2_000_000;
            silence.observe(Stamp(now), Some(&PenReading::new(Stamp(now), [0.0, 0.0], true)));
        }
        assert_eq!((silence.late_ns(), silence.silent_ns(Stamp(now))), (Some(0), Some(0)));
        let fresh = PenSilence::new(5_000_000);
        assert_eq!((fresh.late_ns(), fresh.silent_ns(Stamp(now))), (None, None));
    }
}
