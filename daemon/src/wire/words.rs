//! Terms of the law and their numbers on the wire: modes, reasons, causes, predictors.

use foretrace_control::follower::{Mode, Rung};
use foretrace_control::ghost::GhostState;
use foretrace_control::predict::{LONGEST_NAME, PredictorKind};
use foretrace_control::stop::{StopCause, StopDetail, StopReason};
use foretrace_control::trust::TrustReason;
use foretrace_shm as shm;

/// Mode of the loop on the wire.
#[must_use]
pub const fn mode(mode: Mode) -> shm::Mode {
    match mode {
        Mode::Idle => shm::Mode::Idle,
        Mode::Armed => shm::Mode::Armed,
        Mode::Following => shm::Mode::Following,
        Mode::Holding => shm::Mode::Holding,
        Mode::Stopped => shm::Mode::Stopped,
        Mode::Fault => shm::Mode::Fault,
        Mode::Homing => shm::Mode::Homing,
    }
}

/// Why the loop stopped.
#[must_use]
pub const fn fault(reason: StopReason) -> shm::FaultReason {
    match reason {
        StopReason::None => shm::FaultReason::None,
        StopReason::Requested => shm::FaultReason::Requested,
        StopReason::EnableLost => shm::FaultReason::DeadMan,
        StopReason::JointStateLost => shm::FaultReason::JointStateStale,
        StopReason::TimeLost => shm::FaultReason::TimeLost,
        StopReason::ArmSafety => shm::FaultReason::RobotStopped,
        StopReason::TrackingError => shm::FaultReason::TrackingError,
        StopReason::Envelope => shm::FaultReason::Envelope,
        StopReason::Overruns => shm::FaultReason::Overruns,
        StopReason::WayBlocked => shm::FaultReason::WayBlocked,
        StopReason::Contact => shm::FaultReason::Contact,
    }
}

/// The evidence behind a latched stop.
#[must_use]
pub fn stop_detail(detail: &StopDetail) -> shm::StopDetail {
    let cause = match detail.cause {
        StopCause::None => shm::StopCause::None,
        StopCause::JointDeviation => shm::StopCause::JointDeviation,
        StopCause::ToolDeviation => shm::StopCause::ToolDeviation,
        StopCause::WrongDirection => shm::StopCause::WrongDirection,
        StopCause::NoMotion => shm::StopCause::NoMotion,
        StopCause::Runaway => shm::StopCause::Runaway,
        StopCause::Oscillation => shm::StopCause::Oscillation,
        StopCause::SlowArm => shm::StopCause::SlowArm,
        StopCause::Height => shm::StopCause::Height,
        StopCause::Workspace => shm::StopCause::Workspace,
        StopCause::Tilt => shm::StopCause::Tilt,
        StopCause::ToolSpeed => shm::StopCause::ToolSpeed,
        StopCause::LateTicks => shm::StopCause::LateTicks,
        StopCause::Clearance => shm::StopCause::Clearance,
        StopCause::Response => shm::StopCause::Response,
        StopCause::Effort => shm::StopCause::Effort,
    };
    shm::StopDetail {
        cause: cause.into(),
        joint: detail.joint.map_or(-1, i32::from),
        amount: detail.amount,
        limit: detail.limit,
        at_ns: detail.at.0,
    }
}

#[must_use]
pub fn predictor(kind: PredictorKind) -> shm::PredictorName {
    // Every name of the registry fits.
    const { assert!(LONGEST_NAME < shm::PREDICTOR_NAME_BYTES) };
    shm::PredictorName::new(kind.name()).unwrap_or(shm::PredictorName::NONE)
}

/// An arm that is asked to go less than this share of the way to the preview is at its limits.
const GOVERNED: f64 = 0.95;

/// Reason for the trust of a tick with this share of the governor.
#[must_use]
pub fn trust_reason(reason: TrustReason, governor: f64) -> shm::TrustReason {
    match reason {
        TrustReason::Disarmed => shm::TrustReason::Inactive,
        TrustReason::Stale => shm::TrustReason::PenStale,
        TrustReason::PredictorInvalid => shm::TrustReason::PredictorUnhealthy,
        TrustReason::SwitchingPredictor => shm::TrustReason::PredictorSwitched,
        TrustReason::Warmup => shm::TrustReason::WarmUp,
        TrustReason::Manual => shm::TrustReason::Manual,
        TrustReason::Frozen => shm::TrustReason::Frozen,
        TrustReason::SolverUnhealthy => shm::TrustReason::SolverUnhealthy,
        TrustReason::WorseThanHold => shm::TrustReason::WorseThanHold,
        TrustReason::Auto if governor < GOVERNED => shm::TrustReason::ArmLimited,
        TrustReason::Auto => shm::TrustReason::Evidence,
    }
}

/// Which fallback made the command.
#[must_use]
pub const fn rung(rung: Rung) -> shm::Rung {
    match rung {
        Rung::FreshPlan => shm::Rung::FreshPlan,
        Rung::PreviousPlan => shm::Rung::PreviousPlan,
        Rung::Stop => shm::Rung::Stop,
        Rung::Hold => shm::Rung::Hold,
    }
}

/// State of the ghost's comparison.
#[must_use]
pub const fn ghost_state(state: GhostState) -> shm::GhostState {
    match state {
        GhostState::Off => shm::GhostState::Off,
        GhostState::Approaching => shm::GhostState::Approaching,
        GhostState::Settling => shm::GhostState::Settling,
        GhostState::Comparable => shm::GhostState::Comparable,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_predictor_has_its_name_on_the_wire() {
        for kind in PredictorKind::ALL {
            assert_eq!(predictor(kind).as_str(), Some(kind.name()));
        }
    }
}
