//! The messages of the real-time thread: pen, joints, dead-man, command.

use foretrace_control::contact::{EffortReading, EffortUnit};
use foretrace_control::follower::{EnableReading, JointCommand, JointReading, Mode, Rung};
use foretrace_control::pen::{PenOrigin, PenReading};
use foretrace_control::units::Stamp;
use foretrace_shm as shm;

use super::words::mode;
use super::{JOINTS, flag};

/// The newest command that the arm has accepted, as it reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Echo {
    /// The tick that made the command.
    pub tick: u64,
    /// When the arm accepted it, if reported.
    pub accepted: Option<Stamp>,
    /// The pen sample behind the command: its number in its sender's sequence; 0: none.
    pub pen_sequence: u64,
    /// The pen sample behind the command: its stamp.
    pub pen_stamp: Option<Stamp>,
}

/// A command to be sent, with information for consumers.
#[derive(Debug, Clone, Copy)]
pub struct Outgoing {
    /// The tick that made it, from 1.
    pub tick: u64,
    /// The command of the law.
    pub command: JointCommand<JOINTS>,
    /// Mode of the loop.
    pub mode: Mode,
    /// Which fallback made it.
    pub rung: Rung,
    /// It is the first since arming.
    pub begins: bool,
    /// Newest pen sample behind it: its number in its sender's sequence; 0: none.
    pub pen_sequence: u64,
    /// Newest pen sample behind it: its stamp.
    pub pen_stamp: Option<Stamp>,
}

/// A pen sample in metres of the device's plane, received at `now`.
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

/// A measured arm. Arms that report no modes are assumed to be ready.
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

/// The efforts of a joint state; `None` if the arm reports none.
#[must_use]
pub fn effort_reading(state: &shm::JointState) -> Option<EffortReading<JOINTS>> {
    effort_of(state.header.stamp_ns, &state.effort, state.effort_unit)
}

/// The same from a tick's record.
#[must_use]
pub fn effort_of(stamp_ns: u64, effort: &[f64; JOINTS], unit: u32) -> Option<EffortReading<JOINTS>> {
    let unit = match shm::EffortUnit::try_from(unit) {
        Ok(shm::EffortUnit::NewtonMetres) => EffortUnit::NewtonMetres,
        Ok(shm::EffortUnit::Amperes) => EffortUnit::Amperes,
        Ok(shm::EffortUnit::Share) => EffortUnit::Share,
        Ok(shm::EffortUnit::None) | Err(_) => return None,
    };
    Some(EffortReading { stamp: Stamp(stamp_ns), effort: *effort, unit })
}

/// What efforts are given in, on the wire.
#[must_use]
pub const fn effort_unit(unit: EffortUnit) -> shm::EffortUnit {
    match unit {
        EffortUnit::NewtonMetres => shm::EffortUnit::NewtonMetres,
        EffortUnit::Amperes => shm::EffortUnit::Amperes,
        EffortUnit::Share => shm::EffortUnit::Share,
    }
}

/// The echo of a joint state: the command that the arm obeys; `None` if the arm echoes nothing.
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
