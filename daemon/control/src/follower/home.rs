//! What the loop does at the events of the way home.

use super::Follower;
use super::io::Refusal;
use super::motion::HomeNews;
use super::request::WayBlocked;
use crate::clearance::Obstructed;
use crate::stop::{StopCause, StopDetail, StopReason};
use crate::units::Stamp;

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Lets go of an arm that is at home or cannot be moved there, and stops one that is held up. Returns
    /// whether the way is clear, in the tick in which that is decided.
    pub(super) fn record_outcome_of_home(
        &mut self,
        now: Stamp,
        news: &HomeNews,
    ) -> Option<Result<(), Refusal>> {
        match news {
            HomeNews::None => None,
            HomeNews::Clear => Some(Ok(())),
            HomeNews::Arrived => {
                self.leave();
                None
            }
            HomeNews::Blocked(by) => {
                self.leave();
                Some(Err(Refusal::WayBlocked(whole(by))))
            }
            HomeNews::HeldUp(by) => {
                let limit = self.settings.clearance.as_ref().map_or(0.0, |clearance| clearance.margin_m);
                let (cause, amount) = (StopCause::Clearance, by.distance_m);
                let detail = StopDetail { cause, joint: None, amount, limit, ..StopDetail::default() };
                self.watch.latch_with(now, StopReason::WayBlocked, detail);
                None
            }
        }
    }

    fn leave(&mut self) {
        self.watch.leave();
        self.mover.let_go();
    }
}

/// Whole numbers for the wire. Casts saturate; NaN becomes 0.
fn whole(by: &Obstructed) -> WayBlocked {
    WayBlocked { pair: by.pair, percent: (100.0 * by.share) as u8, distance_um: (1e6 * by.distance_m) as i32 }
}
