//! A robot state: its sub-packages as numbers.
//!
//! Contract: a known sub-package that is longer than here (a later version) gives what is known; a shorter
//! one is malformed. Unknown ones are passed over by number.

use super::{Malformed, unframe};

/// Sub-packages of a state, in the order in which they came.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RobotState {
    pub parts: Vec<SubPackage>,
}

#[derive(Debug, Clone, PartialEq)]
pub enum SubPackage {
    /// 0
    RobotMode(RobotModeData),
    /// 1
    Joints(JointData),
    /// 2
    Tool(ToolData),
    /// 3
    Masterboard(MasterboardData),
    /// 4
    Cartesian(CartesianInfo),
    /// 5
    Kinematics(KinematicsInfo),
    /// 6
    Configuration(ConfigurationData),
    /// 8: teach button pressed, enabled, inputs and outputs enabled.
    Additional([bool; 3]),
    Other(u8),
}

/// Sub-package 0: modes and speed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RobotModeData {
    /// \[µs\]
    pub timestamp_us: u64,
    /// A controller talks to the arm.
    pub connected: bool,
    /// It is an arm, not a simulation of PolyScope's.
    pub enabled: bool,
    pub power_on: bool,
    pub emergency_stopped: bool,
    pub protective_stopped: bool,
    /// A program is running.
    pub program_running: bool,
    /// A program is paused.
    pub program_paused: bool,
    /// As RTDE's `robot_mode`.
    pub robot_mode: u8,
    /// 0 position, 1 teach, 2 force, 3 torque.
    pub control_mode: u8,
    /// Of the speed slider, in \[0, 1\].
    pub target_speed_fraction: f64,
    /// As RTDE's `speed_scaling`.
    pub speed_scaling: f64,
    /// What the slider may be at most.
    pub target_speed_fraction_limit: f64,
}

/// One joint of sub-package 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OneJoint {
    /// \[rad\]
    pub q_actual: f64,
    /// \[rad\]
    pub q_target: f64,
    /// \[rad/s\]
    pub qd_actual: f64,
    /// \[A\]
    pub current: f32,
    /// \[V\]
    pub voltage: f32,
    /// \[°C\]
    pub temperature: f32,
    /// 253 running, 239 power off, 248 idle (guide).
    pub mode: u8,
}

/// Sub-package 1: the six joints from the base on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointData(pub [OneJoint; 6]);

/// Sub-package 2: the tool's connector.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ToolData {
    /// \[V\] or \[A\]
    pub analog_input: [f64; 2],
    /// 0, 12 or 24 \[V\]
    pub output_voltage: u8,
    /// As RTDE's `tool_mode`.
    pub mode: u8,
}

/// Sub-package 3: the control box.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MasterboardData {
    /// Bit by bit: 8 standard, 8 configurable, 2 of the tool.
    pub digital_input_bits: u32,
    pub digital_output_bits: u32,
    /// \[V\] or \[A\]
    pub analog_input: [f64; 2],
    /// \[V\] or \[A\]
    pub analog_output: [f64; 2],
    /// As RTDE's `safety_mode`.
    pub safety_mode: u8,
}

/// Sub-package 4: the tool centre point.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CartesianInfo {
    /// Position \[m\] and rotation vector \[rad\] in the base frame.
    pub pose: [f64; 6],
    /// The same from flange to tool centre point.
    pub tcp_offset: [f64; 6],
}

/// Sub-package 5: the arm's own kinematics, nominal ones corrected by the factory's calibration.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct KinematicsInfo {
    /// One a joint; tells arms apart.
    pub checksum: [u32; 6],
    /// \[rad\]
    pub theta: [f64; 6],
    /// \[m\]
    pub a: [f64; 6],
    /// \[m\]
    pub d: [f64; 6],
    /// \[rad\]
    pub alpha: [f64; 6],
    /// 0 calibrated, 1 not, 2 in another way wrong: the guide names no values, clients show it as a number.
    pub calibration_status: u32,
}

/// Sub-package 6: limits, nominal kinematics, kind of robot.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ConfigurationData {
    /// Least and largest position of each joint \[rad\].
    pub position_limits: [[f64; 2]; 6],
    /// Largest speed \[rad/s\] and acceleration \[rad/s²\] of each joint.
    pub motion_limits: [[f64; 2]; 6],
    /// Defaults: joint speed \[rad/s\], joint acceleration \[rad/s²\], tool speed \[m/s\], tool acceleration
    /// \[m/s²\], equivalent radius \[m\].
    pub defaults: [f64; 5],
    /// \[m\]
    pub a: [f64; 6],
    /// \[m\]
    pub d: [f64; 6],
    /// \[rad\]
    pub alpha: [f64; 6],
    /// \[rad\]
    pub theta: [f64; 6],
    /// Version of the control box.
    pub masterboard_version: i32,
    /// 0 without a control box.
    pub controller_box_type: i32,
    /// 1 UR5, 2 UR10, 3 UR3, 4 UR16.
    pub robot_type: i32,
    /// 1 CB2, 2 CB3 with the first joints, 3 CB3, 4 e-Series (as the guide counts generations).
    pub robot_subtype: i32,
}

impl RobotState {
    pub(super) fn payload(&self) -> Vec<u8> {
        self.parts.iter().flat_map(SubPackage::encode).collect()
    }

    pub(super) fn decode(mut payload: &[u8]) -> Result<Self, Malformed> {
        let mut parts = Vec::new();
        // Each takes at least its header: no more than fit into a package.
        while !payload.is_empty() {
            let Some((kind, body)) = unframe(&mut payload)? else { return Err(Malformed::Payload(16)) };
            parts.push(SubPackage::decode(kind, body).ok_or(Malformed::Payload(kind))?);
        }
        Ok(Self { parts })
    }

    /// Sub-package 5.
    #[must_use]
    pub fn kinematics(&self) -> Option<&KinematicsInfo> {
        self.parts.iter().find_map(|part| match part {
            SubPackage::Kinematics(kinematics) => Some(kinematics),
            _ => None,
        })
    }
}
