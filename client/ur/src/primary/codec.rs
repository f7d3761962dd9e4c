//! Sub-packages of a robot state as bytes, both ways. Sizes: client interface guide, 3.5 and later.

use super::framed;
use super::state::{
    CartesianInfo, ConfigurationData, JointData, KinematicsInfo, MasterboardData, OneJoint, RobotModeData,
    SubPackage, ToolData,
};
use crate::rtde::value::take;

/// Reads numbers from the front of bytes.
struct BodyReader<'a>(&'a [u8]);

impl BodyReader<'_> {
    /// Passes over what is not used.
    fn skip<const BYTES: usize>(&mut self) -> Option<[u8; BYTES]> {
        take(&mut self.0)
    }

    fn u8(&mut self) -> Option<u8> {
        take(&mut self.0).map(|[byte]| byte)
    }

    fn bool(&mut self) -> Option<bool> {
        self.u8().map(|byte| byte != 0)
    }

    fn u32(&mut self) -> Option<u32> {
        take(&mut self.0).map(u32::from_be_bytes)
    }

    fn i32(&mut self) -> Option<i32> {
        take(&mut self.0).map(i32::from_be_bytes)
    }

    fn f32(&mut self) -> Option<f32> {
        take(&mut self.0).map(f32::from_be_bytes)
    }

    fn f64(&mut self) -> Option<f64> {
        take(&mut self.0).map(f64::from_be_bytes)
    }

    fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.f64()?;
        }
        Some(numbers)
    }

    fn pairs(&mut self) -> Option<[[f64; 2]; 6]> {
        let mut pairs = [[0.0; 2]; 6];
        for pair in &mut pairs {
            *pair = self.f64s()?;
        }
        Some(pairs)
    }
}

trait Put {
    fn f64s(&mut self, numbers: &[f64]);
    fn f32s(&mut self, numbers: &[f32]);
    fn bools(&mut self, bools: &[bool]);
}

impl Put for Vec<u8> {
    fn f64s(&mut self, numbers: &[f64]) {
        numbers.iter().for_each(|number| self.extend_from_slice(&number.to_be_bytes()));
    }

    fn f32s(&mut self, numbers: &[f32]) {
        numbers.iter().for_each(|number| self.extend_from_slice(&number.to_be_bytes()));
    }

    fn bools(&mut self, bools: &[bool]) {
        self.extend(bools.iter().copied().map(u8::from));
    }
}

impl SubPackage {
    pub(super) fn encode(&self) -> Vec<u8> {
        let mut b = Vec::new();
        let kind = match self {
            Self::RobotMode(mode) => {
                b.extend_from_slice(&mode.timestamp_us.to_be_bytes());
                b.bools(&[mode.connected, mode.enabled, mode.power_on, mode.emergency_stopped]);
                b.bools(&[mode.protective_stopped, mode.program_running, mode.program_paused]);
                b.extend_from_slice(&[mode.robot_mode, mode.control_mode]);
                b.f64s(&[mode.target_speed_fraction, mode.speed_scaling, mode.target_speed_fraction_limit]);
                b.push(0);
                0
            }
            Self::Joints(JointData(joints)) => {
                for joint in joints {
                    b.f64s(&[joint.q_actual, joint.q_target, joint.qd_actual]);
                    // The fourth float is not used any more.
                    b.f32s(&[joint.current, joint.voltage, joint.temperature, 0.0]);
                    b.push(joint.mode);
                }
                1
            }
            Self::Tool(tool) => {
                b.extend_from_slice(&[0, 0]);
                b.f64s(&tool.analog_input);
                b.f32s(&[48.0]);
                b.push(tool.output_voltage);
                b.f32s(&[0.0, 30.0]);
                b.push(tool.mode);
                2
            }
            Self::Masterboard(board) => {
                b.extend_from_slice(&board.digital_input_bits.to_be_bytes());
                b.extend_from_slice(&board.digital_output_bits.to_be_bytes());
                b.extend_from_slice(&[0, 0]);
                b.f64s(&board.analog_input);
                b.extend_from_slice(&[0, 0]);
                b.f64s(&board.analog_output);
                // Temperature, voltage, current, current of the outputs.
                b.f32s(&[30.0, 48.0, 1.0, 0.0]);
                // Safety mode, reduced mode, no Euromap, four reserved, operational mode, enabling switch.
                b.extend_from_slice(&[board.safety_mode, 0, 0, 0, 0, 0, 0, 0, 0]);
                3
            }
            Self::Cartesian(cartesian) => {
                b.f64s(&cartesian.pose);
                b.f64s(&cartesian.tcp_offset);
                4
            }
            Self::Kinematics(kinematics) => {
                kinematics.checksum.iter().for_each(|sum| b.extend_from_slice(&sum.to_be_bytes()));
                b.f64s(&kinematics.theta);
                b.f64s(&kinematics.a);
                b.f64s(&kinematics.d);
                b.f64s(&kinematics.alpha);
                b.extend_from_slice(&kinematics.calibration_status.to_be_bytes());
                5
            }
            Self::Configuration(config) => {
                b.f64s(config.position_limits.as_flattened());
                b.f64s(config.motion_limits.as_flattened());
                b.f64s(&config.defaults);
                b.f64s(&config.a);
                b.f64s(&config.d);
                b.f64s(&config.alpha);
                b.f64s(&config.theta);
                for number in [
                    config.masterboard_version,
                    config.controller_box_type,
                    config.robot_type,
                    config.robot_subtype,
                ] {
                    b.extend_from_slice(&number.to_be_bytes());
                }
                6
            }
            Self::Additional(bools) => {
                b.bools(bools);
                b.push(0);
                8
            }
            Self::Other(kind) => *kind,
        };
        framed(kind, &b)
    }

    pub(super) fn decode(kind: u8, body: &[u8]) -> Option<Self> {
        let mut r = BodyReader(body);
        Some(match kind {
            0 => Self::RobotMode(RobotModeData {
                timestamp_us: take(&mut r.0).map(u64::from_be_bytes)?,
                connected: r.bool()?,
                enabled: r.bool()?,
                power_on: r.bool()?,
                emergency_stopped: r.bool()?,
                protective_stopped: r.bool()?,
                program_running: r.bool()?,
                program_paused: r.bool()?,
                robot_mode: r.u8()?,
                control_mode: r.u8()?,
                target_speed_fraction: r.f64()?,
                speed_scaling: r.f64()?,
                // Since 3.2.
                target_speed_fraction_limit: r.f64().unwrap_or(1.0),
            }),
            1 => {
                let mut joints = [OneJoint::default(); 6];
                for joint in &mut joints {
                    let [q_actual, q_target, qd_actual] = r.f64s()?;
                    let (current, voltage, temperature) = (r.f32()?, r.f32()?, r.f32()?);
                    r.skip::<4>()?;
                    let mode = r.u8()?;
                    *joint = OneJoint { q_actual, q_target, qd_actual, current, voltage, temperature, mode };
                }
                Self::Joints(JointData(joints))
            }
            2 => {
                r.skip::<2>()?;
                let analog_input = r.f64s()?;
                r.skip::<4>()?;
                let output_voltage = r.u8()?;
                r.skip::<8>()?;
                Self::Tool(ToolData { analog_input, output_voltage, mode: r.u8()? })
            }
            3 => {
                let (digital_input_bits, digital_output_bits) = (r.u32()?, r.u32()?);
                r.skip::<2>()?;
                let analog_input = r.f64s()?;
                r.skip::<2>()?;
                let analog_output = r.f64s()?;
                r.skip::<16>()?;
                Self::Masterboard(MasterboardData {
                    digital_input_bits,
                    digital_output_bits,
                    analog_input,
                    analog_output,
                    safety_mode: r.u8()?,
                })
            }
            // The offset came with 3.1.
            4 => Self::Cartesian(CartesianInfo { pose: r.f64s()?, tcp_offset: r.f64s().unwrap_or_default() }),
            5 => {
                let mut checksum = [0; 6];
                for sum in &mut checksum {
                    *sum = r.u32()?;
                }
                let (theta, a, d, alpha) = (r.f64s()?, r.f64s()?, r.f64s()?, r.f64s()?);
                let calibration_status = r.u32()?;
                Self::Kinematics(KinematicsInfo { checksum, theta, a, d, alpha, calibration_status })
            }
            6 => Self::Configuration(ConfigurationData {
                position_limits: r.pairs()?,
                motion_limits: r.pairs()?,
                defaults: r.f64s()?,
                a: r.f64s()?,
                d: r.f64s()?,
                alpha: r.f64s()?,
                theta: r.f64s()?,
                masterboard_version: r.i32()?,
                controller_box_type: r.i32()?,
                robot_type: r.i32()?,
                robot_subtype: r.i32()?,
            }),
            8 => Self::Additional([r.bool()?, r.bool()?, r.bool()?]),
            kind => Self::Other(kind),
        })
    }
}
