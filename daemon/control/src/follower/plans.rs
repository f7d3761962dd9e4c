//! How planning went of late, of the ticks that wanted to follow.
//!
//! Contract: total, no memory but two shares.

use super::Rung;

/// Ticks over which the share of those that had to stop forgets.
const STOPPED_TICKS: f64 = 50.0;
/// The same of those without a plan of their own: longer than from one lift of the pen to the next, which costs steps of the solver.
const OUTDATED_TICKS: f64 = 500.0;

/// Shares of the recent ticks, in [0, 1].
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Plans {
    /// Had to stop: no plan, or no joints for it.
    pub(super) stopped: f64,
    /// Had no plan of their own: they stopped, or followed the previous one.
    pub(super) outdated: f64,
}

impl Plans {
    /// A tick that wanted to follow came to `rung`.
    pub(super) fn see(&mut self, rung: Rung) {
        let one_if = |is: bool| f64::from(u8::from(is));
        self.stopped += (one_if(matches!(rung, Rung::Stop | Rung::Hold)) - self.stopped) / STOPPED_TICKS;
        self.outdated += (one_if(rung != Rung::FreshPlan) - self.outdated) / OUTDATED_TICKS;
    }
}
