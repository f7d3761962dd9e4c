//! When a pen or an arm has rested long enough to be measured.
//!
//! Contract: pure, time is an argument. What moves begins again.

use std::collections::VecDeque;

/// Collects samples of `N` numbers until they rest.
#[derive(Debug, Clone)]
pub struct Still<const N: usize> {
    /// Largest distance of a number from the oldest of the rest [m, rad].
    tolerance: f64,
    /// How long it has to rest \[ns\].
    rest_ns: u64,
    samples: VecDeque<(u64, [f64; N])>,
}

/// Most samples that are kept: 2 s at 1000 Hz.
const KEPT: usize = 2000;
/// Fewest samples that make a rest.
const LEAST: usize = 10;

impl<const N: usize> Still<N> {
    pub const fn new(tolerance: f64, rest_ns: u64) -> Self {
        Self { tolerance, rest_ns, samples: VecDeque::new() }
    }

    pub fn moved(&mut self) {
        self.samples.clear();
    }

    /// A sample at `stamp_ns`; the median of the rest once that has lasted.
    pub fn take(&mut self, stamp_ns: u64, sample: [f64; N]) -> Option<[f64; N]> {
        // The newest is where the rest is judged from, so that a slow drift ends it too.
        let near = |old: &[f64; N]| old.iter().zip(&sample).all(|(a, b)| (a - b).abs() <= self.tolerance);
        if !self.samples.iter().all(|(_, old)| near(old)) {
            self.samples.clear();
        }
        if self.samples.len() == KEPT {
            self.samples.pop_front();
        }
        self.samples.push_back((stamp_ns, sample));
        let since = self.samples.front().map_or(stamp_ns, |(stamp, _)| *stamp);
        let rests = stamp_ns.saturating_sub(since) >= self.rest_ns && self.samples.len() >= LEAST;
        rests.then(|| self.median())
    }

    fn median(&self) -> [f64; N] {
        std::array::from_fn(|index| {
            let mut values: Vec<f64> = self.samples.iter().map(|(_, sample)| sample[index]).collect();
            values.sort_unstable_by(f64::total_cmp);
            values[values.len() / 2]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn a_rest_is_told_by_its_median_and_a_move_begins_anew() {
        let mut still = Still::new(1e-3, 500 * MS);
        let mut reported = Vec::new();
        for index in 0..300_u64 {
            // Rests, moves on at 1 s by 5 mm, rests again; with a shake of 0.2 mm.
            let x = if index < 200 { 0.1 } else { 0.105 } + 1e-4 * f64::from(u32::from(index % 2 == 0));
            if let Some([x]) = still.take(index * 5 * MS, [x]) {
                reported.push((index, x));
            }
        }
        assert_eq!(reported.first().map(|(index, _)| *index), Some(100));
        assert!((reported[0].1 - 0.1).abs() < 2e-4);
        // Between the move and half a second later nothing is reported.
        assert!(!reported.iter().any(|(index, _)| (200..300).contains(index)));
    }

    #[test]
    fn a_slow_drift_and_a_few_samples_are_no_rest() {
        let mut drift = Still::new(1e-3, 500 * MS);
        assert!((0..1000).all(|i| drift.take(i * 5 * MS, [2e-5 * i as f64]).is_none()));
        let mut few = Still::new(1e-3, 500 * MS);
        assert!((0..5).all(|i| few.take(i * 200 * MS, [0.1]).is_none()));
    }
}
