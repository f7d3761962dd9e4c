//! What the arm has strength for: how far trust has to come down because the arm is at its limits.
//!
//! An arm at its limits in nearly every tick does not follow what is foreseen, it runs behind it: it comes
//! late, goes too far, and may be worse than one led by feedback alone. Where it is hardly better
//! (`outcome`), what is asked for is taken back until the arm is at its limits as often as it should be, and
//! no more. Where it is much better, limits do no harm.

use super::TrustParameters;

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
    pub(super) fn see(
        &mut self,
        overtaxed: Option<bool>,
        reaction_ns: u64,
        dt_ns: u64,
        parameters: &TrustParameters,
    ) {
        let Some(overtaxed) = overtaxed else { return };
        let TrustParameters { headroom_fall, headroom_rise_s, headroom_least, headroom_same, .. } =
            *parameters;
        let dt_s = dt_ns as f64 * 1e-9;
        let fall_s = (headroom_fall * reaction_ns as f64 * 1e-9).max(headroom_rise_s);
        let change = if overtaxed { -dt_s / fall_s } else { dt_s / headroom_rise_s };
        self.log_share = (self.log_share + change).clamp(headroom_least.ln(), 0.0);
        let share = self.log_share.exp();
        if share >= 1.0 || share * headroom_same <= self.share || share >= headroom_same * self.share {
            self.share = share;
        }
    }

    /// Of the trust that the evidence justifies, at least [`TrustParameters::headroom_least`].
    pub(super) const fn share(&self) -> f64 {
        self.share
    }
}
