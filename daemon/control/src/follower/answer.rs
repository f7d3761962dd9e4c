//! What an operator's request does to the loop, and why it may be refused.

use super::Follower;
use super::io::{Refusal, Request};
use crate::stop::StopReason;
use crate::trust::TrustRequest;
use crate::units::{Stamp, Trust};

impl<const N: usize, const J: usize> Follower<N, J> {
    /// Carries `request` out, or says why not.
    pub(super) fn answer(&mut self, now: Stamp, request: Request) -> Result<(), Refusal> {
        match request {
            Request::Arm => {
                let joints = self.watch.may_arm(now, self.mover.at_rest())?;
                if self.monitor.unsettled(self.settings.safety.arm_max_speed) {
                    return Err(Refusal::NotFollowing);
                }
                self.mover.seed(now, &joints.q)?;
                self.monitor.begin(now);
                self.contact.begin();
                self.watch.arm(now);
                self.learner_doubt_ns = 0;
            }
            Request::MoveHome => {
                let joints =
                    self.watch.may_arm(now, self.mover.at_rest()).map_err(|refusal| match refusal {
                        Refusal::AlreadyArmed => Refusal::DisarmFirst,
                        other => other,
                    })?;
                if self.monitor.unsettled(self.settings.safety.arm_max_speed) {
                    return Err(Refusal::NotFollowing);
                }
                self.mover.seed_home(now, &joints.q)?;
                self.monitor.begin(now);
                self.contact.begin();
                self.watch.move_home(now);
            }
            Request::Disarm => {
                self.watch.disarm(now);
                self.monitor.acknowledge();
            }
            Request::Stop => self.watch.latch(now, StopReason::Requested),
            Request::SetTrust(alpha) => {
                if !(0.0..=1.0).contains(&alpha) {
                    return Err(Refusal::BadValue);
                }
                self.trust_request = TrustRequest::Manual(Trust::new(alpha));
            }
            Request::FreezeTrust => self.trust_request = TrustRequest::Frozen(self.trust.alpha()),
            Request::TrustAuto => self.trust_request = TrustRequest::Auto,
            Request::SwitchPredictor(kind) => {
                if !self.previewer.offers(kind) {
                    return Err(Refusal::PredictorUnavailable);
                }
                self.pending_predictor = Some(kind);
            }
        }
        Ok(())
    }
}
