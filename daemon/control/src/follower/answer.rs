//! What an operator's request does to the loop, and why it may be refused.

use super::io::{Refusal, Request};
use super::monitor::ArmMonitor;
use super::motion::Mover;
use super::predict::Prediction;
use super::trust::TrustStage;
use super::watch::ModeWatch;
use crate::stop::StopReason;
use crate::trust::TrustRequest;
use crate::units::{Stamp, Trust};

/// Carries `request` out, or says why not.
pub(super) fn answer<const N: usize, const J: usize>(
    now: Stamp,
    request: Request,
    watch: &mut ModeWatch<J>,
    monitor: &mut ArmMonitor<J>,
    prediction: &mut Prediction,
    trust: &mut TrustStage,
    mover: &mut Mover<N, J>,
) -> Result<(), Refusal> {
    match request {
        Request::Arm | Request::MoveHome => {
            let home = request == Request::MoveHome;
            let joints = watch.may_arm(now, mover.at_rest()).map_err(|refusal| match refusal {
                Refusal::AlreadyArmed if home => Refusal::DisarmFirst,
                other => other,
            })?;
            if monitor.unsettled() {
                return Err(Refusal::NotFollowing);
            }
            if home {
                mover.seed_home(now, &joints.q)?;
                watch.move_home(now);
            } else {
                mover.seed(now, &joints.q)?;
                watch.arm(now);
                trust.begin();
            }
            monitor.begin(now);
        }
        Request::Disarm => {
            watch.disarm(now);
            monitor.acknowledge();
        }
        Request::Stop => watch.latch(now, StopReason::Requested),
        Request::SetTrust(alpha) if !(0.0..=1.0).contains(&alpha) => return Err(Refusal::BadValue),
        Request::SetTrust(alpha) => trust.request(TrustRequest::Manual(Trust::new(alpha))),
        Request::FreezeTrust => trust.request(TrustRequest::Frozen(trust.alpha())),
        Request::TrustAuto => trust.request(TrustRequest::Auto),
        Request::SwitchPredictor(kind) => return prediction.request(kind),
    }
    Ok(())
}
