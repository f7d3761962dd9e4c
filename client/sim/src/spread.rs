//! The distribution of a duration, in fixed memory, quantiles to three digits; and the median of any numbers.

use hdrhistogram::Histogram;
use serde::Serialize;

/// Counts durations in nanoseconds, from 1 ns to 100 s; longer ones count as 100 s.
#[derive(Debug, Clone)]
pub struct DurationHistogram(Histogram<u64>);

/// Quantiles in reports \[µs\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Default)]
pub struct Quantiles {
    pub p50: f64,
    pub p99: f64,
    pub p99_9: f64,
    pub max: f64,
}

/// Durations up to a bound, and above the bound before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Bucket {
    pub up_to_us: u64,
    pub count: u64,
}

impl Default for DurationHistogram {
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1, Self::LONGEST_NS, 3);
        Self(histogram.unwrap_or_else(|_| unreachable!("bounds and digits are constants in range")))
    }
}

impl From<Histogram<u64>> for DurationHistogram {
    fn from(histogram: Histogram<u64>) -> Self {
        Self(histogram)
    }
}

impl DurationHistogram {
    const LONGEST_NS: u64 = 100_000_000_000;

    pub fn add_ns(&mut self, ns: u64) {
        self.0.saturating_record(ns.min(Self::LONGEST_NS));
    }

    #[cfg(test)]
    fn count(&self) -> u64 {
        self.0.len()
    }

    /// Counts in buckets whose bounds double from 1 us; ends with the last that holds something.
    pub fn doublings(&self) -> Vec<Bucket> {
        let mut buckets: Vec<Bucket> = Vec::new();
        for value in self.0.iter_recorded() {
            let bound = value.value_iterated_to().div_ceil(1000).max(1).next_power_of_two();
            while buckets.last().is_none_or(|last| last.up_to_us < bound) {
                let up_to_us = buckets.last().map_or(1, |last| last.up_to_us * 2);
                buckets.push(Bucket { up_to_us, count: 0 });
            }
            if let Some(last) = buckets.last_mut() {
                last.count += value.count_since_last_iteration();
            }
        }
        buckets
    }

    /// All zero when nothing was counted.
    pub fn quantiles(&self) -> Quantiles {
        let us = |ns: u64| ns as f64 / 1e3;
        Quantiles {
            p50: us(self.0.value_at_quantile(0.5)),
            p99: us(self.0.value_at_quantile(0.99)),
            p99_9: us(self.0.value_at_quantile(0.999)),
            max: us(self.0.max()),
        }
    }
}

/// Median (mean of the middle two where there are two); `None` without values or with one that is NaN.
#[must_use]
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    // A NaN may sort to either end.
    if sorted.iter().any(|value| value.is_nan()) {
        return None;
    }
    sorted.sort_by(f64::total_cmp);
    let half = sorted.len() / 2;
    let upper = *sorted.get(half)?;
    Some(if sorted.len() % 2 == 1 { upper } else { sorted.get(half - 1)?.midpoint(upper) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_median_of_an_even_count_lies_between_the_two_in_the_middle_and_one_of_nan_is_none() {
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, 2.0, 3.0]), Some(2.5));
        assert_eq!((median([]), median([1.0, f64::NAN, 2.0])), (None, None));
        // By their sign, these sort to both ends.
        for nan in [f64::NAN, -f64::NAN] {
            assert_eq!((median([nan]), median([1.0, nan, 2.0, 3.0])), (None, None));
        }
        assert_eq!(median([f64::MAX, f64::MAX]), Some(f64::MAX));
    }

    #[test]
    fn quantiles_of_a_thousand_equal_steps() {
        let mut spread = DurationHistogram::default();
        (1..=1000).for_each(|k| spread.add_ns(k * 1000));
        let q = spread.quantiles();
        assert!((q.p50 - 500.0).abs() < 1.0 && (q.p99 - 990.0).abs() < 1.0 && (q.max - 1000.0).abs() < 1.0);
        assert_eq!(spread.count(), 1000);
    }

    #[test]
    fn doublings_hold_every_count_once_and_in_order() {
        let mut spread = DurationHistogram::default();
        [500, 900, 1_500, 7_000, 7_500].into_iter().for_each(|ns| spread.add_ns(ns));
        let counts: Vec<_> =
            spread.doublings().iter().map(|bucket| (bucket.up_to_us, bucket.count)).collect();
        assert_eq!(counts, [(1, 2), (2, 1), (4, 0), (8, 2)]);
        assert!(DurationHistogram::default().doublings().is_empty());
    }

    #[test]
    fn nothing_counted_is_zero_and_the_absurd_is_capped() {
        assert_eq!(DurationHistogram::default().quantiles(), Quantiles::default());
        let mut spread = DurationHistogram::default();
        spread.add_ns(u64::MAX);
        assert!(spread.quantiles().max <= 101e6);
    }
}
