//! What the arm has strength for: how far trust has to come down because the arm is at its limits.
//!
//! An arm at its limits in nearly every tick does not follow what is foreseen, it runs behind it: it comes late, goes too far, and may
//! be worse than one led by feedback alone. Where it is hardly better (`outcome`), what is asked for is taken back until the arm is at
//! its limits as often as it should be, and no more. Where it is much better, limits do no harm.

/// Share of the ticks of motion in which an arm that is well used is overtaxed: at a limit and hardly better than feedback. Train
/// writers of unipen-tos, unipen-ced and pendigits behind a UR5: from 0.6 to 0.8 errors are level within 5 %; slower servos want
/// more, and what falls behind feedback grows with the share.
const WELL_USED: f64 = 0.8;
/// Trust falls by a factor e while the arm is at its limits for this time divided by 1 − [`WELL_USED`] [s]. A digit of a fast hand
/// takes 0.4 s; from 0.1 to 0.3 s errors are level.
const TIME_S: f64 = 0.15;
/// Least share, from which an arm that is overtaxed no more is back within half a second.
const LEAST: f64 = 0.1;
/// Shares within this factor count as the same: with each change of the trust a plan factors its costs anew.
const SAME: f64 = 1.1;

/// See the module's description.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Headroom {
    /// Natural logarithm of the share that is justified now, at most 0.
    log_share: f64,
    /// What was given last.
    share: f64,
}

impl Headroom {
    pub(super) const fn new() -> Self {
        Self { log_share: 0.0, share: 1.0 }
    }

    /// `overtaxed`: see [`super::TrustInputs`].
    pub(super) fn see(&mut self, overtaxed: Option<bool>, dt_ns: u64) {
        let Some(overtaxed) = overtaxed else { return };
        let off = WELL_USED - f64::from(u8::from(overtaxed));
        self.log_share = (self.log_share + off * dt_ns as f64 * 1e-9 / TIME_S).clamp(LEAST.ln(), 0.0);
        let share = self.log_share.exp();
        if share >= 1.0 || share * SAME <= self.share || share >= SAME * self.share {
            self.share = share;
        }
    }

    /// Of the trust that the evidence justifies, in [[`LEAST`], 1].
    pub(super) const fn share(&self) -> f64 {
        self.share
    }
}
