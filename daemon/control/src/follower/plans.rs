//! How planning went lately, over the ticks that were to follow the pen.
//!
//! Contract: total; the only memory is one share.

use super::Rung;
use crate::estimate::LawParameters;
use crate::state::state;

/// What the recent ticks came to.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlanRecord {
    /// Share that had to stop, in \[0, 1\]: no plan, or no joints for it.
    pub(super) stopped: f64,
    /// Its memory, one tick or more \[ticks\].
    memory: f64,
}

state! { [] PlanRecord { stopped } fixed { memory } }

impl PlanRecord {
    /// At `period_ns` per tick.
    pub(super) fn new(period_ns: u64, law: &LawParameters) -> Self {
        Self { stopped: 0.0, memory: (law.unplanned_s / (period_ns as f64 * 1e-9)).max(1.0) }
    }

    /// Counts a tick that was to follow the pen and ended on `rung`.
    pub(super) fn add(&mut self, rung: Rung) {
        let stopped = f64::from(u8::from(matches!(rung, Rung::Stop | Rung::Hold)));
        self.stopped += (stopped - self.stopped) / self.memory;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A twentieth of a second without plans weighs the same at every rate of the loop.
    #[test]
    fn the_memory_is_time_and_not_ticks() {
        let after = |period_ns: u64| {
            let mut plans = PlanRecord::new(period_ns, &LawParameters::SHIPPED);
            (0..50_000_000 / period_ns).for_each(|_| plans.add(Rung::Stop));
            plans.stopped
        };
        let (slow, fast) = (after(5_000_000), after(1_000_000));
        assert!((slow - fast).abs() < 0.01 && (0.3..0.5).contains(&slow), "{slow} {fast}");
    }
}
