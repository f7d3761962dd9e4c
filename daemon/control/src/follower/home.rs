//! What the loop does at the events of the way home.

use super::io::Refusal;
use super::motion::HomeNews;
use super::request::WayBlocked;
use super::watch::ModeWatch;
use crate::clearance::Obstructed;
use crate::stop::{StopCause, StopDetail, StopReason};
use crate::units::Stamp;

impl<const J: usize> ModeWatch<J> {
    /// Gives back an arm that is at home or cannot be moved there, and stops one that is held up. Returns
    /// whether the way is clear, in the tick in which that is decided, and whether the arm is given back.
    pub(super) fn record_home(&mut self, now: Stamp, news: &HomeNews) -> (Option<Result<(), Refusal>>, bool) {
        match news {
            HomeNews::None => (None, false),
            HomeNews::Clear => (Some(Ok(())), false),
            HomeNews::Arrived => {
                self.leave();
                (None, true)
            }
            HomeNews::Blocked(by) => {
                self.leave();
                (Some(Err(Refusal::WayBlocked(whole(by)))), true)
            }
            HomeNews::HeldUp(by) => {
                let (cause, amount, limit) = (StopCause::Clearance, by.distance_m, self.margin_m);
                let detail = StopDetail { cause, joint: None, amount, limit, ..StopDetail::default() };
                self.latch_with(now, StopReason::WayBlocked, detail);
                (None, false)
            }
        }
    }
}

/// Whole numbers for the wire. Casts saturate; NaN becomes 0.
fn whole(by: &Obstructed) -> WayBlocked {
    WayBlocked { pair: by.pair, percent: (100.0 * by.share) as u8, distance_um: (1e6 * by.distance_m) as i32 }
}
