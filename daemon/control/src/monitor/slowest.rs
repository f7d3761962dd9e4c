//! The slowest arm that is possible: a critically damped filter with the whole lag as its group delay.
//!
//! Contract: an arm with the same lag, of which a part is pure delay, smooths its commands less, and moves at
//! least as far. Pure, bounded work.

use super::path::{BLOCK_NS, RangeHistory};
use crate::units::Stamp;

/// Least lag of the filter \[s\].
const LEAST_LAG_S: f64 = 0.016;

/// The filter over a time in which its target stands.
#[derive(Debug, Clone, Copy)]
pub(super) struct Filter {
    /// Rate \[1/s\].
    w: f64,
    elapsed_s: f64,
    decay: f64,
}

impl Filter {
    /// With lag `lag_s`, over `elapsed_s` \[s\].
    pub(super) fn new(lag_s: f64, elapsed_s: f64) -> Self {
        let w = 2.0 / lag_s.max(LEAST_LAG_S);
        Self { w, elapsed_s, decay: (-w * elapsed_s).exp() }
    }

    /// Moves position and speed towards `target`: e(t) = (e₀ + (ė₀ + w e₀) t) exp(−w t).
    pub(super) fn step(&self, position: &mut f64, speed: &mut f64, target: f64) {
        let e = *position - target;
        let slope = *speed + self.w * e;
        *position = target + (e + slope * self.elapsed_s) * self.decay;
        *speed = (*speed - self.w * slope * self.elapsed_s) * self.decay;
    }
}

/// How far number `index` of what follows `commands` with lag `lag_s` \[s\] has moved from `begin` on.
pub(super) fn moved<const K: usize>(
    commands: &RangeHistory<K>,
    index: usize,
    lag_s: f64,
    begin: Stamp,
) -> f64 {
    let filter = Filter::new(lag_s, BLOCK_NS as f64 * 1e-9);
    let mut state = None;
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (from, point) in commands.ends() {
        let Some(target) = point.get(index) else { continue };
        let (position, speed) = state.get_or_insert((*target, 0.0));
        filter.step(position, speed, *target);
        if from >= begin {
            (low, high) = (low.min(*position), high.max(*position));
        }
    }
    (high - low).max(0.0)
}
