//! `Latency`: duration of one part of the way from pen to arm, as percentiles and as a histogram.

use iceoryx2::prelude::ZeroCopySend;

use super::layout::wire;
use super::status::Percentiles;

/// Bins of a [`Latency`].
pub const LATENCY_BINS: usize = 20;

wire! {
    /// Distribution of a latency since the daemon started, after warm-up.
    "foretrace.LatencyV1"
    pub struct Latency {
        /// Number of measurements.
        pub count: u64,
        /// Percentiles, saturated at 4.29 s.
        pub percentiles: Percentiles,
        /// Counts of measurements below [`Latency::edge_us`] and not below the edge before; the last bin
        /// counts the rest, saturated.
        pub bins: [u32; LATENCY_BINS],
    }
}

impl Latency {
    /// Upper edge of bin `index`: 16 µs doubled from bin to bin; infinite for the last one \[µs\].
    #[must_use]
    pub fn edge_us(index: usize) -> f64 {
        if index + 1 < LATENCY_BINS { 16.0 * 2.0_f64.powi(index as i32) } else { f64::INFINITY }
    }

    /// The bin for a time of `ns`.
    #[must_use]
    pub fn bin(ns: u64) -> usize {
        let below = |index: &usize| (ns as f64) < 1e3 * Self::edge_us(*index);
        (0..LATENCY_BINS).find(below).unwrap_or(LATENCY_BINS - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_follow_each_other_without_a_gap_and_the_last_takes_all() {
        assert_eq!(Latency::bin(0), 0);
        for index in 0..LATENCY_BINS - 1 {
            let edge_ns = (1e3 * Latency::edge_us(index)) as u64;
            assert_eq!((Latency::bin(edge_ns - 1), Latency::bin(edge_ns)), (index, index + 1));
        }
        assert_eq!(Latency::bin(u64::MAX), LATENCY_BINS - 1);
    }

    #[test]
    fn edges_double_from_sixteen_microseconds_and_the_last_is_open() {
        assert_eq!([0, 1, 2, 10].map(Latency::edge_us), [16.0, 32.0, 64.0, 16_384.0]);
        assert_eq!(Latency::edge_us(LATENCY_BINS - 2), 16.0 * 262_144.0);
        assert_eq!(Latency::edge_us(LATENCY_BINS - 1), f64::INFINITY);
    }
}
