//! Where a pen rests whose samples have stopped: many devices send nothing while the pen stands.

use super::PenReading;
use crate::state::state;
use crate::units::Stamp;

/// Longest sampling interval of a device \[ns\]; longer ones are pauses.
const LONGEST_INTERVAL_NS: u64 = 40_000_000;
/// Shortest time after which a device counts as silent \[ns\].
const LEAST_PATIENCE_NS: u64 = 20_000_000;

/// The newest sample and the usual sampling interval.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PenSilence {
    newest: Option<(Stamp, [f64; 2])>,
    interval_ns: u64,
}

state! { [] PenSilence { newest, interval_ns } }

impl PenSilence {
    /// No samples yet; a device that is assumed to sample once in `interval_ns` \[ns\].
    pub(crate) const fn new(interval_ns: u64) -> Self {
        Self { newest: None, interval_ns }
    }

    /// Takes in the newest sample; it may be repeated.
    pub(crate) fn observe(&mut self, newest: &PenReading) {
        let elapsed_ns = self.newest.map_or(0, |(before, _)| newest.stamp.0.saturating_sub(before.0));
        if (1..=LONGEST_INTERVAL_NS).contains(&elapsed_ns) {
            self.interval_ns = self.interval_ns - self.interval_ns / 8 + elapsed_ns / 8;
        }
        self.newest = Some((newest.stamp, newest.position));
    }

    /// Where the pen is assumed to have come to rest \[m\], if the device has been silent for longer than
    /// usual.
    pub(crate) fn resting_at(&self, now: Stamp) -> Option<[f64; 2]> {
        let patience_ns = (self.interval_ns * 5 / 2).max(LEAST_PATIENCE_NS);
        let (_, position) = self.newest.filter(|(newest, _)| now.0.saturating_sub(newest.0) > patience_ns)?;
        Some(position)
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
                silence.observe(&PenReading::new(Stamp(stamp), [0.0007, -0.0001], true));
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
}
