//! Headroom: how far trust must come down because the arm is saturated.
//!
//! An arm that is saturated in nearly every tick cannot follow the preview: it lags, overshoots, and may be
//! worse than under feedback alone. Where it is hardly better (`outcome`), trust is reduced until the arm is
//! saturated no more often than it should be. Where it is much better, saturation does no harm.

use super::TrustParameters;
use crate::state::state;

/// The factor on trust.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TrustHeadroom {
    /// Natural logarithm of the share justified now, at most 0.
    log_share: f64,
    /// The share last given.
    share: f64,
}

state! { [] TrustHeadroom { log_share, share } }

impl TrustHeadroom {
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

    /// Factor on the trust that the record justifies, at least [`TrustParameters::headroom_least`].
    pub(super) const fn share(&self) -> f64 {
        self.share
    }
}
