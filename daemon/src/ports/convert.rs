//! Between the wire and the domain: the only place of the daemon that knows both vocabularies.
//!
//! Contract: pure, total, no allocation on the paths that the real-time thread takes (pen, joints, dead-man, command).
//! Messages arrive validated; numbers that the wire has no place for are left out here and nowhere else.

mod record;
pub mod refused;

pub use record::{IpcTally, chain, counters, extent, ghost_figures, newest_tick, stages, tick_record};

use foretrace_control::follower::{EnableReading, JointReading, Mode, Refusal, Request, Rung, StopReason};
use foretrace_control::follower::{StopCause, StopDetail};
use foretrace_control::pen::{PenOrigin, PenReading};
use foretrace_control::predict::PredictorKind;
use foretrace_control::trust::TrustReason;
use foretrace_control::units::Stamp;
use foretrace_shm as shm;
use foretrace_shm::{ControlOp, ControlRequest, ControlStatus};

use super::{Echo, JOINTS, Outgoing, REJECT_REASONS};
use crate::rt::os::Right;

const _: () = assert!(JOINTS == shm::JOINTS);
const _: () = assert!(REJECT_REASONS == shm::REJECT_REASONS);

/// A pen sample in metres of the device's plane, taken in at `now`.
#[must_use]
pub fn pen_reading(sample: &shm::PenSample, now: Stamp) -> PenReading {
    PenReading {
        stamp: Stamp(sample.device_stamp_ns),
        position: [sample.x_m, sample.y_m],
        contact: sample.contact(),
        origin: PenOrigin {
            sequence: sample.header.sequence,
            sent: Stamp(sample.header.stamp_ns),
            received: now,
        },
    }
}

/// A measured arm. Arms that report no modes are taken to be ready.
#[must_use]
pub fn joint_reading(state: &shm::JointState) -> JointReading<JOINTS> {
    let safe = shm::SafetyMode::try_from(state.safety_mode).is_ok_and(shm::SafetyMode::permits_motion);
    let runs = matches!(
        shm::RobotMode::try_from(state.robot_mode),
        Ok(shm::RobotMode::Running | shm::RobotMode::NoController)
    );
    JointReading {
        stamp: Stamp(state.header.stamp_ns),
        q: state.q,
        qd: state.qd,
        motion_allowed: safe && runs,
    }
}

/// What a joint state says about the command that the arm obeys; `None` where the arm echoes nothing.
#[must_use]
pub fn echo(state: &shm::JointState) -> Option<Echo> {
    let known = |ns: u64| (ns != 0).then_some(Stamp(ns));
    (state.command_tick != 0).then_some(Echo {
        tick: state.command_tick,
        accepted: known(state.command_accepted_ns),
        pen_sequence: state.pen_sequence,
        pen_stamp: known(state.pen_stamp_ns),
    })
}

/// A dead-man message.
#[must_use]
pub fn enable_reading(enable: &shm::Enable) -> EnableReading {
    EnableReading { stamp: Stamp(enable.header.stamp_ns), stop: enable.stop != 0 }
}

/// A command; its header is filled in when it is published under `outgoing.command.stamp`.
#[must_use]
pub fn joint_command(outgoing: &Outgoing, now: Stamp) -> shm::JointCommand {
    let command = &outgoing.command;
    let stopping =
        matches!(outgoing.mode, Mode::Stopped | Mode::Fault) || matches!(outgoing.rung, Rung::Stop);
    let flags = flag(command.enabled, shm::command_flags::ENABLED)
        | flag(outgoing.begins, shm::command_flags::BEGINS)
        | flag(stopping, shm::command_flags::STOPPING);
    shm::JointCommand {
        published_ns: now.0,
        tick: outgoing.tick,
        valid_until_ns: command.valid_until.0,
        pen_sequence: outgoing.pen_sequence,
        pen_stamp_ns: outgoing.pen_stamp.map_or(0, |stamp| stamp.0),
        q: command.q,
        qd: command.qd,
        mode: mode(outgoing.mode).into(),
        flags,
        ..Default::default()
    }
}

/// What the ports of the real-time thread are asked for by an operator's request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Asked {
    /// Mode and trust.
    Query,
    /// Read the settings again.
    Reload,
    /// Something for the loop.
    Loop(Request),
    /// Known, but not built into this daemon.
    Unsupported,
}

/// What a validated request asks for.
#[must_use]
pub fn asked(request: &ControlRequest) -> Asked {
    let Ok(op) = ControlOp::try_from(request.op) else { return Asked::Unsupported };
    Asked::Loop(match op {
        ControlOp::Query => return Asked::Query,
        ControlOp::Reload => return Asked::Reload,
        ControlOp::Arm => Request::Arm,
        ControlOp::MoveHome => Request::MoveHome,
        ControlOp::Disarm => Request::Disarm,
        ControlOp::Stop => Request::Stop,
        ControlOp::SetTrust => Request::SetTrust(request.value),
        ControlOp::TrustAuto => Request::TrustAuto,
        ControlOp::FreezeTrust => Request::FreezeTrust,
        ControlOp::SwitchPredictor => match shm::PredictorId::try_from(request.param).ok().and_then(kind) {
            Some(kind) => Request::SwitchPredictor(kind),
            None => return Asked::Unsupported,
        },
    })
}

/// What a refusal is called on the wire, and what a person should know about it.
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
            "the tool stands outside the workspace: `foretrace move home`, or move it near the writing plane by hand",
        ),
        Refusal::ToolNotAligned => (
            ControlStatus::Jump,
            "the tool does not point at the writing plane: `foretrace move home`, or turn it by hand",
        ),
        Refusal::EnableMissing => (ControlStatus::NotEnabled, "the dead-man switch is required and not held"),
        Refusal::StillStopping => (ControlStatus::WrongMode, "the arm is still being stopped: ask again"),
        Refusal::StopCame => (
            ControlStatus::StopCame,
            "a stop came after this request was sent: ask again if that is still wanted",
        ),
        Refusal::NotFollowing => (
            ControlStatus::NotFollowing,
            "the arm is not where it was told to be, or moves by itself: find out why, then disarm and arm anew",
        ),
        Refusal::AlreadyArmed => (ControlStatus::WrongMode, "the loop is armed already"),
        Refusal::DisarmFirst => {
            (ControlStatus::WrongMode, "the loop is armed: `foretrace request disarm` first")
        }
        Refusal::MovesHome => {
            (ControlStatus::WrongMode, "the arm is moving home: wait until it is there, or stop it")
        }
        Refusal::WayBlocked(_) => {
            (ControlStatus::WayBlocked, "something is in the straight way home: move the arm by hand")
        }
        Refusal::BadValue => (ControlStatus::Invalid, "the value is not a number in its legal range"),
        Refusal::PredictorUnavailable => {
            (ControlStatus::PredictorUnavailable, "the predictor is not available in this daemon")
        }
    }
}

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

/// Why the loop stopped by itself; a requested stop is none.
#[must_use]
pub const fn fault(reason: StopReason) -> shm::FaultReason {
    match reason {
        StopReason::None | StopReason::Requested => shm::FaultReason::None,
        StopReason::EnableLost => shm::FaultReason::DeadMan,
        StopReason::JointStateLost => shm::FaultReason::JointStateStale,
        StopReason::TimeLost => shm::FaultReason::TimeLost,
        StopReason::ArmSafety => shm::FaultReason::RobotStopped,
        StopReason::TrackingError => shm::FaultReason::TrackingError,
        StopReason::Envelope => shm::FaultReason::Envelope,
        StopReason::Overruns => shm::FaultReason::Overruns,
        StopReason::WayBlocked => shm::FaultReason::WayBlocked,
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
    };
    shm::StopDetail {
        cause: cause.into(),
        joint: detail.joint.map_or(-1, i32::from),
        amount: detail.amount,
        limit: detail.limit,
        at_ns: detail.at.0,
    }
}

/// A predictor's number.
#[must_use]
pub const fn predictor(kind: PredictorKind) -> shm::PredictorId {
    match kind {
        PredictorKind::Hold => shm::PredictorId::Hold,
        PredictorKind::ConstantVelocity => shm::PredictorId::ConstantVelocity,
        PredictorKind::Dybm => shm::PredictorId::Dybm,
        PredictorKind::Oracle => shm::PredictorId::Oracle,
        PredictorKind::Lstm => shm::PredictorId::Lstm,
        PredictorKind::DybmEsn => shm::PredictorId::DybmEsn,
        PredictorKind::ArRls => shm::PredictorId::ArRls,
        PredictorKind::Ours => shm::PredictorId::Ours,
    }
}

const fn kind(id: shm::PredictorId) -> Option<PredictorKind> {
    match id {
        shm::PredictorId::Hold => Some(PredictorKind::Hold),
        shm::PredictorId::ConstantVelocity => Some(PredictorKind::ConstantVelocity),
        shm::PredictorId::Dybm => Some(PredictorKind::Dybm),
        shm::PredictorId::Oracle => Some(PredictorKind::Oracle),
        shm::PredictorId::Lstm => Some(PredictorKind::Lstm),
        shm::PredictorId::DybmEsn => Some(PredictorKind::DybmEsn),
        shm::PredictorId::ArRls => Some(PredictorKind::ArRls),
        shm::PredictorId::Ours => Some(PredictorKind::Ours),
    }
}

/// Why trust is what it is.
#[must_use]
pub const fn trust_reason(reason: TrustReason) -> shm::TrustReason {
    match reason {
        TrustReason::Disarmed => shm::TrustReason::Inactive,
        TrustReason::Stale => shm::TrustReason::PenStale,
        TrustReason::PredictorInvalid => shm::TrustReason::PredictorUnhealthy,
        TrustReason::SwitchingPredictor => shm::TrustReason::PredictorSwitched,
        TrustReason::Jump => shm::TrustReason::PenJump,
        TrustReason::Warmup => shm::TrustReason::WarmUp,
        TrustReason::Manual => shm::TrustReason::Manual,
        TrustReason::Frozen => shm::TrustReason::Frozen,
        TrustReason::SolverUnhealthy => shm::TrustReason::SolverUnhealthy,
        TrustReason::LearnerUnhealthy => shm::TrustReason::LearnerUnhealthy,
        TrustReason::Unproven => shm::TrustReason::Unproven,
        TrustReason::Surprised => shm::TrustReason::Surprised,
        TrustReason::WorseThanHold => shm::TrustReason::WorseThanHold,
        TrustReason::ArmLimited => shm::TrustReason::ArmLimited,
        TrustReason::WorseThanSteady => shm::TrustReason::WorseThanConstantVelocity,
        TrustReason::Hysteresis => shm::TrustReason::Hysteresis,
        TrustReason::Auto => shm::TrustReason::Evidence,
    }
}

/// The bit of a right that is missing.
#[must_use]
pub const fn missing_right(right: Right) -> u32 {
    match right {
        Right::Fifo => shm::missing_rights::FIFO,
        Right::Affinity => shm::missing_rights::AFFINITY,
        Right::MemoryLock => shm::missing_rights::MEMORY_LOCK,
        Right::TimerSlack => shm::missing_rights::TIMER_SLACK,
        Right::SharedMemory => shm::missing_rights::SHARED_MEMORY_RESERVED,
    }
}

const fn flag(set: bool, bit: u32) -> u32 {
    if set { bit } else { 0 }
}
