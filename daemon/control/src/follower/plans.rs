//! How planning went of late, of the ticks that wanted to follow.
//!
//! Contract: total, no memory but two shares.

use super::{Health, Rung};

/// Ticks over which the share of those that had to stop forgets.
const STOPPED_TICKS: f64 = 50.0;
/// The same of those whose plan failed: longer than from one lift of the pen to the next, which costs steps
/// of the solver.
const FAILED_TICKS: f64 = 500.0;

/// Shares of the recent ticks, in \[0, 1\].
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Plans {
    /// Had to stop: no plan, or no joints for it.
    pub(super) stopped: f64,
    /// Asked for a plan that failed. Those that were told to leave it out do not count.
    pub(super) failed: f64,
}

impl Plans {
    /// A tick that wanted to follow came to `rung`, with `health`.
    pub(super) fn see(&mut self, rung: Rung, health: Health) {
        let one_if = |is: bool| f64::from(u8::from(is));
        self.stopped += (one_if(matches!(rung, Rung::Stop | Rung::Hold)) - self.stopped) / STOPPED_TICKS;
        self.failed += (one_if(health.has(Health::MPC_FAILED)) - self.failed) / FAILED_TICKS;
    }
}
