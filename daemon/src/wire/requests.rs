//! Requests of operators, and the wire's names of refusals.

use foretrace_control::follower::{Refusal, Request};
use foretrace_control::predict::PredictorKind;
use foretrace_shm::{ControlOp, ControlRequest, ControlStatus};

/// Where a validated request goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RequestRoute {
    Query,
    /// Read the settings again.
    Reload,
    /// A request for the loop.
    Loop(Request),
    /// A predictor that is not in the registry.
    UnknownPredictor,
    /// Known, but not built into this daemon.
    Unsupported,
}

/// Where a validated request goes, and as what.
#[must_use]
pub fn route(request: &ControlRequest) -> RequestRoute {
    let Ok(op) = ControlOp::try_from(request.op) else { return RequestRoute::Unsupported };
    RequestRoute::Loop(match op {
        ControlOp::Query => return RequestRoute::Query,
        ControlOp::Reload => return RequestRoute::Reload,
        ControlOp::Arm => Request::Arm,
        ControlOp::MoveHome => Request::MoveHome,
        ControlOp::Disarm => Request::Disarm,
        ControlOp::Stop => Request::Stop,
        ControlOp::SetTrust => Request::SetTrust(request.value),
        ControlOp::TrustAuto => Request::TrustAuto,
        ControlOp::FreezeTrust => Request::FreezeTrust,
        ControlOp::SwitchPredictor => match request.predictor.as_str().and_then(PredictorKind::from_name) {
            Some(kind) => Request::SwitchPredictor(kind),
            None => return RequestRoute::UnknownPredictor,
        },
    })
}

/// Answer to a request for a predictor that is not in the registry; fits into an answer.
#[must_use]
pub fn unknown_predictor(request: &ControlRequest) -> String {
    let name = request.predictor;
    let hint = name.as_str().map_or_else(String::new, PredictorKind::renamed);
    format!(
        "no predictor is called {name}{hint}; there are {}",
        PredictorKind::LIVE.map(PredictorKind::name).join(", ")
    )
}

/// The wire's name of a refusal, and its explanation with the remedy.
#[must_use]
pub const fn refusal(refusal: Refusal) -> (ControlStatus, &'static str) {
    match refusal {
        Refusal::NoJointState => (
            ControlStatus::NoJointState,
            "no joint state has arrived: start the arm (or `foretrace arm sim`)",
        ),
        Refusal::JointStateStale => (
            ControlStatus::JointStateStale,
            "the arm's newest joint state is too old: is the arm still running?",
        ),
        Refusal::MotionNotAllowed => (
            ControlStatus::RobotNotReady,
            "the arm's safety system does not allow motion: clear it at the arm first",
        ),
        Refusal::ArmMoves => (ControlStatus::RobotNotReady, "the arm moves: wait until it stands still"),
        Refusal::OutsideJointLimits => {
            (ControlStatus::OutsideLimits, "a joint stands outside its limits: move it back by hand")
        }
        Refusal::ToolOutsideWorkspace => (
            ControlStatus::Jump,
            "the tool stands outside the workspace: `foretrace move home`, or move it near the writing plane \
             by hand",
        ),
        Refusal::ToolNotAligned => (
            ControlStatus::Jump,
            "the tool does not point at the writing plane: `foretrace move home`, or turn it by hand",
        ),
        Refusal::EnableMissing => (
            ControlStatus::NotEnabled,
            "the dead-man switch is required and not held: `foretrace enable`, or hold to run in the console",
        ),
        Refusal::StillStopping => (ControlStatus::WrongMode, "the arm is still being stopped: ask again"),
        Refusal::StopCame => (
            ControlStatus::StopCame,
            "a stop came after this request was sent: ask again if that is still wanted",
        ),
        Refusal::NotFollowing => (
            ControlStatus::NotFollowing,
            "the arm is not where it was commanded to be, or moves by itself: find out why, then disarm and arm \
             again",
        ),
        Refusal::AlreadyArmed => (ControlStatus::WrongMode, "the loop is armed already"),
        Refusal::DisarmFirst => {
            (ControlStatus::WrongMode, "the loop is armed: `foretrace request disarm` first")
        }
        Refusal::MovesHome => {
            (ControlStatus::WrongMode, "the arm is moving home: wait until it is there, or stop it")
        }
        Refusal::WayBlocked(_) => {
            (ControlStatus::WayBlocked, "the straight way home is blocked: move the arm by hand")
        }
        Refusal::BadValue => (ControlStatus::Invalid, "the value is not a number in its legal range"),
        Refusal::PredictorUnavailable => {
            (ControlStatus::PredictorUnavailable, "the predictor is not available in this daemon")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_shm::{MESSAGE_BYTES, PredictorName};

    fn switch_to(name: &str) -> ControlRequest {
        let predictor = PredictorName::new(name).unwrap();
        ControlRequest { predictor, ..ControlRequest::new(1, 2, ControlOp::SwitchPredictor) }
    }

    #[test]
    fn every_predictor_can_be_asked_for_by_name() {
        for kind in PredictorKind::ALL {
            assert_eq!(route(&switch_to(kind.name())), RequestRoute::Loop(Request::SwitchPredictor(kind)));
        }
    }

    #[test]
    fn a_name_that_nobody_has_is_refused_with_those_that_there_are() {
        for name in ["holdd", "ours", "a-predictor-of-27-bytes-000"] {
            assert_eq!(route(&switch_to(name)), RequestRoute::UnknownPredictor);
            let text = unknown_predictor(&switch_to(name));
            assert!(text.contains(name) && text.contains("mixture"), "{text}");
            assert!(text.len() <= MESSAGE_BYTES, "{}: {text}", text.len());
        }
        assert!(unknown_predictor(&switch_to("ours")).contains("is called mixture"));
    }
}
