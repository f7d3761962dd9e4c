//! How planning went lately, over the ticks that were to follow the pen.
//!
//! Contract: total; the only memory are two shares.

use super::{Health, Rung};
use crate::state::state;
use crate::trust::TrustParameters;

/// Shares of the recent ticks, in \[0, 1\].
#[derive(Debug, Clone, Copy)]
pub(super) struct PlanRecord {
    /// Share that had to stop: no plan, or no joints for it.
    pub(super) stopped: f64,
    /// Share whose plan failed. Ticks that had to shed the solve do not count.
    pub(super) failed: f64,
    /// Memories of the two, one tick or more \[ticks\].
    memories: [f64; 2],
}

state! { [] PlanRecord { stopped, failed } fixed { memories } }

impl PlanRecord {
    /// At `period_ns` per tick.
    pub(super) fn new(period_ns: u64, parameters: &TrustParameters) -> Self {
        let ticks = |seconds: f64| (seconds / (period_ns as f64 * 1e-9)).max(1.0);
        let memories = [ticks(parameters.unplanned_s), ticks(parameters.failed_s)];
        Self { stopped: 0.0, failed: 0.0, memories }
    }

    /// Counts a tick that was to follow the pen and ended on `rung` with `health`.
    pub(super) fn add(&mut self, rung: Rung, health: Health) {
        let one_if = |is: bool| f64::from(u8::from(is));
        let [stopped, failed] = self.memories;
        self.stopped += (one_if(matches!(rung, Rung::Stop | Rung::Hold)) - self.stopped) / stopped;
        self.failed += (one_if(health.has(Health::MPC_FAILED)) - self.failed) / failed;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half a second without plans weighs the same at every rate of the loop.
    #[test]
    fn the_memory_is_time_and_not_ticks() {
        let after = |period_ns: u64| {
            let mut plans = PlanRecord::new(period_ns, &TrustParameters::SHIPPED);
            let mut health = Health::default();
            health.set(Health::MPC_FAILED);
            (0..500_000_000 / period_ns).for_each(|_| plans.add(Rung::Stop, health));
            [plans.stopped, plans.failed]
        };
        let (slow, fast) = (after(8_000_000), after(1_000_000));
        for (slow, fast) in slow.into_iter().zip(fast) {
            assert!((slow - fast).abs() < 0.01 && (0.3..1.0).contains(&slow), "{slow} {fast}");
        }
    }
}
