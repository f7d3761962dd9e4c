//! What the arm has strength for: how far trust has to come down because the arm is at its limits.
//!
//! An arm at its limits in nearly every tick does not follow what is foreseen, it runs behind it: it comes late, goes too far, and may
//! be worse than one led by feedback alone. Where it is hardly better (`outcome`), what is asked for is taken back until the arm is at
//! its limits as often as it should be, and no more. Where it is much better, limits do no harm.

/// Trust falls by a factor e while the arm is overtaxed for this many times of what a change of trust takes to show: dead time and
/// feedback's lag. 0.42 s behind a UR5, 0.83 s behind 100 ms. Behind a UR5 0.42 instead of 0.75 s leave train writers of unipen-ced
/// 4 % less error and 8 instead of 15 % of their sequences worse than feedback, pendigits 3 % less, unipen-tos 1 % more.
const FALL: f64 = 7.0;
/// It rises by a factor e in this time of motion without [s]. A digit of a fast hand takes 0.4 s.
const RISE_S: f64 = 0.19;
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

    /// `overtaxed`, `reaction_ns`: see [`super::TrustInputs`].
    pub(super) fn see(&mut self, overtaxed: Option<bool>, reaction_ns: u64, dt_ns: u64) {
        let Some(overtaxed) = overtaxed else { return };
        let dt_s = dt_ns as f64 * 1e-9;
        let fall_s = (FALL * reaction_ns as f64 * 1e-9).max(RISE_S);
        let change = if overtaxed { -dt_s / fall_s } else { dt_s / RISE_S };
        self.log_share = (self.log_share + change).clamp(LEAST.ln(), 0.0);
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
