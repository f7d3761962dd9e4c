//! The distribution of a duration: fixed memory, quantiles to three digits.

use hdrhistogram::Histogram;
use serde::Serialize;

/// Counts durations in nanoseconds, from 1 ns to 100 s; longer ones count as 100 s.
#[derive(Debug, Clone)]
pub(crate) struct Spread(Histogram<u64>);

/// The quantiles people ask for [µs].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Default)]
pub(crate) struct Quantiles {
    pub(crate) p50: f64,
    pub(crate) p99: f64,
    pub(crate) p99_9: f64,
    pub(crate) max: f64,
}

impl Spread {
    const LONGEST_NS: u64 = 100_000_000_000;

    pub(crate) fn new() -> Self {
        let histogram = Histogram::new_with_bounds(1, Self::LONGEST_NS, 3);
        Self(histogram.unwrap_or_else(|_| unreachable!("bounds and digits are constants in range")))
    }

    pub(crate) fn add_ns(&mut self, ns: u64) {
        self.0.saturating_record(ns.min(Self::LONGEST_NS));
    }

    #[cfg(test)]
    fn count(&self) -> u64 {
        self.0.len()
    }

    /// All zero when nothing was counted.
    pub(crate) fn quantiles(&self) -> Quantiles {
        let us = |ns: u64| ns as f64 / 1e3;
        Quantiles {
            p50: us(self.0.value_at_quantile(0.5)),
            p99: us(self.0.value_at_quantile(0.99)),
            p99_9: us(self.0.value_at_quantile(0.999)),
            max: us(self.0.max()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_thousand_equal_steps() {
        let mut spread = Spread::new();
        (1..=1000).for_each(|k| spread.add_ns(k * 1000));
        let q = spread.quantiles();
        assert!((q.p50 - 500.0).abs() < 1.0 && (q.p99 - 990.0).abs() < 1.0 && (q.max - 1000.0).abs() < 1.0);
        assert_eq!(spread.count(), 1000);
    }

    #[test]
    fn nothing_counted_is_zero_and_the_absurd_is_capped() {
        assert_eq!(Spread::new().quantiles(), Quantiles::default());
        let mut spread = Spread::new();
        spread.add_ns(u64::MAX);
        assert!(spread.quantiles().max <= 101e6);
    }
}
