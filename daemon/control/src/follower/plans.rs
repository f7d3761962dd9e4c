//! How planning went lately, over the ticks that were to follow the pen.
//!
//! Contract: total; the only memory are two shares.

use super::{Health, Rung};

/// Memory of the share of ticks that had to stop \[ticks\].
const STOPPED_TICKS: f64 = 50.0;
/// Memory of the share of ticks whose plan failed \[ticks\]: longer than from one lift of the pen to the
/// next, which costs solver steps.
const FAILED_TICKS: f64 = 500.0;

/// Shares of the recent ticks, in \[0, 1\].
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Plans {
    /// Share that had to stop: no plan, or no joints for it.
    pub(super) stopped: f64,
    /// Share whose plan failed. Ticks that were told to shed the solve do not count.
    pub(super) failed: f64,
}

impl Plans {
    /// Counts a tick that was to follow the pen and ended on `rung` with `health`.
    pub(super) fn see(&mut self, rung: Rung, health: Health) {
        let one_if = |is: bool| f64::from(u8::from(is));
        self.stopped += (one_if(matches!(rung, Rung::Stop | Rung::Hold)) - self.stopped) / STOPPED_TICKS;
        self.failed += (one_if(health.has(Health::MPC_FAILED)) - self.failed) / FAILED_TICKS;
    }
}
