//! `JointCommand` (daemon to arm), `JointState` (arm to daemon) and the dead-man `Enable`.
//!
//! Consumer rule for commands: follow q + q̇·(now − stamp) until `valid_until_ns`, then brake independently.
//! Before the stamp this interpolates between two commands, after it it extrapolates.

use iceoryx2::prelude::ZeroCopySend;

use super::JOINTS;
use super::arm_line::ArmLine;
use super::check::{Rejection, Validate, flags, known, within};
use super::flags::{arm_flags, command_flags};
use super::header::Header;
use super::layout::wire;
use super::robot_mode::{RobotMode, SafetyMode};
use super::vocabulary::{EffortUnit, Mode};

wire! {
    /// Joint positions to be reached at `header.stamp_ns`, one control period after the tick that made them.
    "foretrace.JointCommandV2"
    pub struct JointCommand {
        /// Stamp: the time at which `q` holds; up to one period in the future.
        pub header: Header,
        /// When it was sent \[ns\].
        pub published_ns: u64,
        /// The tick that made it.
        pub tick: u64,
        /// The consumer brakes from this time on \[ns\].
        pub valid_until_ns: u64,
        /// Identity of the newest pen sample behind it: its number in its publisher's sequence; 0: none.
        pub pen_sequence: u64,
        /// Identity of the newest pen sample behind it: its device stamp \[ns\]; 0: none.
        pub pen_stamp_ns: u64,
        /// Joint positions at the stamp \[rad\].
        pub q: [f64; JOINTS],
        /// Joint velocities up to the stamp \[rad/s\].
        pub qd: [f64; JOINTS],
        /// [`Mode`].
        pub mode: u32,
        /// [`command_flags`].
        pub flags: u32,
    }
}

wire! {
    /// Measured state of the arm.
    "foretrace.JointStateV5"
    pub struct JointState {
        /// Stamp: when it was measured, on this host's clock.
        pub header: Header,
        /// The robot's own clock \[ns\]; 0: none.
        pub robot_stamp_ns: u64,
        /// Tick of the newest command accepted; 0: none. This and the next three are filled in by `echo`.
        pub command_tick: u64,
        /// When that command was accepted, on this host's clock \[ns\]; 0: unknown.
        pub command_accepted_ns: u64,
        /// `pen_sequence` of that command.
        pub pen_sequence: u64,
        /// `pen_stamp_ns` of that command.
        pub pen_stamp_ns: u64,
        /// Commands accepted so far.
        pub commands_received: u64,
        /// Commands refused so far (stale, foreign, malformed).
        pub commands_refused: u64,
        /// Joint positions \[rad\].
        pub q: [f64; JOINTS],
        /// Joint velocities \[rad/s\].
        pub qd: [f64; JOINTS],
        /// Joint currents or torques, positive along each joint's axis, in `effort_unit`.
        pub effort: [f64; JOINTS],
        /// [`SafetyMode`].
        pub safety_mode: u32,
        /// [`RobotMode`].
        pub robot_mode: u32,
        /// [`EffortUnit`]; 0: the arm reports no effort.
        pub effort_unit: u32,
        /// Number of the [`crate::ArmNote`] that is in force; 0: none.
        pub note: u32,
        /// The line to the arm's controller.
        pub line: ArmLine,
    }
}

wire! {
    /// The operator's dead-man, 50 times per second. Its absence is a stop too.
    "foretrace.EnableV1"
    pub struct Enable {
        /// Stamp: when it was sent.
        pub header: Header,
        /// 0: continue; anything else: stop.
        pub stop: u32,
        /// Zero.
        pub reserved: u32,
    }
}

/// Largest joint position on the wire \[rad\]: two turns, one more than any joint of a UR has. It exposes an
/// arm that sends degrees as soon as a joint is beyond 12.6 degrees.
pub const JOINT_POSITION_LIMIT_RAD: f64 = 4.0 * std::f64::consts::PI;
/// Largest joint velocity on the wire \[rad/s\].
pub const JOINT_VELOCITY_LIMIT_RADPS: f64 = 100.0;
/// Largest effort on the wire, in any unit.
pub const EFFORT_LIMIT: f64 = 1e5;

impl JointState {
    /// Echoes `command`, accepted at `accepted_ns` on this host's clock, with the identity of its pen sample.
    /// Read the clock after the command has come: the daemon refuses an echo from before it was sent.
    pub fn echo(&mut self, command: &JointCommand, accepted_ns: u64) {
        self.command_tick = command.tick;
        self.command_accepted_ns = accepted_ns;
        self.pen_sequence = command.pen_sequence;
        self.pen_stamp_ns = command.pen_stamp_ns;
    }
}

impl Validate for JointCommand {
    fn validate(&self) -> Result<(), Rejection> {
        within("q", &self.q, JOINT_POSITION_LIMIT_RAD)?;
        within("qd", &self.qd, JOINT_VELOCITY_LIMIT_RADPS)?;
        known::<_, Mode>("mode", self.mode)?;
        flags("flags", self.flags, command_flags::ALL)
    }
}

impl Validate for JointState {
    fn validate(&self) -> Result<(), Rejection> {
        within("q", &self.q, JOINT_POSITION_LIMIT_RAD)?;
        within("qd", &self.qd, JOINT_VELOCITY_LIMIT_RADPS)?;
        within("effort", &self.effort, EFFORT_LIMIT)?;
        known::<_, SafetyMode>("safety_mode", self.safety_mode)?;
        known::<_, RobotMode>("robot_mode", self.robot_mode)?;
        known::<_, EffortUnit>("effort_unit", self.effort_unit)?;
        flags("line.flags", self.line.flags, arm_flags::ALL)
    }
}

impl Validate for Enable {
    fn validate(&self) -> Result<(), Rejection> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::vocabulary::RejectReason;

    #[test]
    fn any_single_bad_joint_refuses_the_whole_message() {
        for joint in 0..JOINTS {
            let mut command = JointCommand::default();
            command.q[joint] = f64::NAN;
            assert_eq!(command.validate().unwrap_err().reason, RejectReason::NotFinite);
            let mut state = JointState::default();
            state.qd[joint] = -101.0;
            assert_eq!(state.validate(), Err(Rejection::new(RejectReason::OutOfRange, "qd")));
        }
    }

    #[test]
    fn unknown_modes_and_flags_are_refused() {
        let command = JointCommand { mode: 7, ..Default::default() };
        assert_eq!(command.validate(), Err(Rejection::new(RejectReason::UnknownEnum, "mode")));
        let command = JointCommand { flags: 8, ..Default::default() };
        assert_eq!(command.validate(), Err(Rejection::new(RejectReason::UnknownFlags, "flags")));
        let state = JointState { safety_mode: 99, ..Default::default() };
        assert_eq!(state.validate().unwrap_err().field, "safety_mode");
        let state = JointState { robot_mode: 10, ..Default::default() };
        assert_eq!(state.validate().unwrap_err().field, "robot_mode");
        let state = JointState { effort_unit: 4, ..Default::default() };
        assert_eq!(state.validate(), Err(Rejection::new(RejectReason::UnknownEnum, "effort_unit")));
        let line = ArmLine { flags: 4, ..Default::default() };
        let state = JointState { line, ..Default::default() };
        assert_eq!(state.validate(), Err(Rejection::new(RejectReason::UnknownFlags, "line.flags")));
    }

    #[test]
    fn an_echo_names_the_command_and_its_pen_sample() {
        let command = JointCommand { tick: 3, pen_sequence: 4, pen_stamp_ns: 5, ..Default::default() };
        let mut state = JointState::default();
        state.echo(&command, 6);
        let echoed = [state.command_tick, state.pen_sequence, state.pen_stamp_ns, state.command_accepted_ns];
        assert_eq!(echoed, [3, 4, 5, 6]);
    }

    #[test]
    fn bounds_are_legal_themselves_and_every_number_has_one() {
        let state = JointState {
            q: [JOINT_POSITION_LIMIT_RAD; JOINTS],
            qd: [-JOINT_VELOCITY_LIMIT_RADPS; JOINTS],
            effort: [EFFORT_LIMIT; JOINTS],
            ..Default::default()
        };
        assert_eq!(state.validate(), Ok(()));
        let beyond = JointState { effort: [1.01 * EFFORT_LIMIT; JOINTS], ..state };
        assert_eq!(beyond.validate().unwrap_err().field, "effort");
        let command = JointCommand { q: state.q, qd: state.qd, ..Default::default() };
        assert_eq!(command.validate(), Ok(()));
        for (joint, field) in [(12.6, "q"), (-12.6, "q")] {
            let beyond = JointCommand { q: [joint; JOINTS], ..command };
            assert_eq!(beyond.validate().unwrap_err().field, field);
        }
        // Two turns: 12.566 rad.
        assert!((JOINT_POSITION_LIMIT_RAD - 12.566).abs() < 1e-3);
    }
}
