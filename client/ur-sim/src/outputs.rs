//! What each RTDE output reads: from the robot, the program, the registers.
//!
//! Currents, voltages and temperatures are those of an arm at rest in a warm room; forces are 0.

use super::robot::SPEED_LIMIT_RADPS;
use super::world::World;
use foretrace_ur::rtde::fields::{FieldVersion, Register, output};
use foretrace_ur::rtde::value::{FieldType, RtdeValue};

/// How an output is read.
#[derive(Debug, Clone)]
pub enum OutputSource {
    State(fn(&World) -> RtdeValue),
    Register(Register),
    /// An input, by name.
    Input(String),
}

impl OutputSource {
    /// The source of an output of this version, with its type.
    #[must_use]
    pub fn of(name: &str, version: FieldVersion) -> Option<(Self, FieldType)> {
        let kind = output(name, version)?;
        let source = match Register::from_name(name) {
            Some(register) if !register.input => Self::Register(register),
            Some(_) => Self::Input(name.to_owned()),
            None if name.starts_with("input_bit") => Self::Input(name.to_owned()),
            None => Self::State(reader(name)?),
        };
        Some((source, kind))
    }

    #[must_use]
    pub fn read(&self, world: &World) -> RtdeValue {
        match self {
            Self::State(read) => read(world),
            Self::Input(name) => world.inputs.value(name).unwrap_or(RtdeValue::Int32(0)),
            Self::Register(register) => {
                let (registers, number) = (&world.registers, register.number);
                match register.kind {
                    FieldType::Int32 => {
                        RtdeValue::Int32(registers.integers.get(number).copied().unwrap_or(0))
                    }
                    FieldType::Double => {
                        RtdeValue::Double(registers.doubles.get(number).copied().unwrap_or(0.0))
                    }
                    _ => RtdeValue::Bool(registers.bits >> (number % 128) & 1 == 1),
                }
            }
        }
    }
}

/// Mode of a joint, as the client interface guide counts them.
#[must_use]
pub fn joint_mode(world: &World) -> u8 {
    match world.robot.mode.number() {
        7 => 253,
        5 => 248,
        _ => 239,
    }
}

fn word(bits: u128, shift: u32) -> RtdeValue {
    RtdeValue::Uint32((bits >> shift & 0xffff_ffff) as u32)
}

fn reader(name: &str) -> Option<fn(&World) -> RtdeValue> {
    use RtdeValue::{Double, Int32, Uint8, Uint32, Uint64, Vector3d, Vector6Int32, Vector6d};
    Some(match name {
        "timestamp" => |w| Double(w.robot.timestamp()),
        "target_q" => |w| Vector6d(w.robot.target.q),
        "target_qd" => |w| Vector6d(w.robot.target.qd),
        "target_qdd" => |w| Vector6d(w.robot.target_qdd),
        "actual_q" => |w| Vector6d(w.robot.actual().q),
        "actual_qd" => |w| Vector6d(w.robot.actual().qd),
        "target_current" | "actual_current" | "joint_control_output" => |w| Vector6d(w.robot.currents()),
        "target_moment" => |_| Vector6d([0.0; 6]),
        "actual_current_as_torque" | "actual_TCP_force" | "ft_raw_wrench" => |_| Vector6d([0.0; 6]),
        "actual_current_window" => |_| Vector6d([0.5; 6]),
        "actual_TCP_pose" => |w| Vector6d(w.robot.tcp_pose(&w.robot.actual().q)),
        "actual_TCP_speed" => |w| Vector6d(w.robot.tcp_speed(&w.robot.actual())),
        "target_TCP_pose" => |w| Vector6d(w.robot.tcp_pose(&w.robot.target.q)),
        "target_TCP_speed" => |w| Vector6d(w.robot.tcp_speed(&w.robot.target)),
        "actual_digital_input_bits" => |w| Uint64(w.robot.digital_inputs),
        "actual_digital_output_bits" => |w| Uint64(w.robot.digital_outputs),
        "joint_temperatures" => |_| Vector6d([30.0; 6]),
        "actual_execution_time" => |_| Double(0.2),
        "robot_mode" => |w| Int32(w.robot.mode.number()),
        "joint_mode" => |w| Vector6Int32([i32::from(joint_mode(w)); 6]),
        "safety_mode" | "safety_status" => |w| Int32(w.robot.safety.number()),
        "actual_tool_accelerometer" => |_| Vector3d([0.0, 0.0, 9.81]),
        "speed_scaling" => |w| Double(w.robot.speed_scaling),
        "target_speed_fraction" => |w| Double(w.robot.slider),
        "actual_momentum" => |w| {
            let speed = w.robot.actual().qd.iter().fold(0.0, |most, qd| f64::max(most, qd.abs()));
            Double(25.0 * speed / SPEED_LIMIT_RADPS)
        },
        "actual_main_voltage" | "actual_robot_voltage" => |_| Double(48.0),
        "actual_robot_current" => |_| Double(1.0),
        "actual_joint_voltage" => |_| Vector6d([48.0; 6]),
        "runtime_state" => |w| Uint32(w.runtime().number()),
        "elbow_position" => |w| {
            let (_, elbow) = w.robot.elbow();
            Vector3d(elbow)
        },
        "elbow_velocity" => |w| {
            let (velocity, _) = w.robot.elbow();
            Vector3d(velocity)
        },
        "robot_status_bits" => |w| {
            let power = u32::from(w.robot.mode.number() >= 4);
            Uint32(power | u32::from(w.runtime().number() != 1) << 1)
        },
        "safety_status_bits" => |w| Uint32(w.robot.safety.bits()),
        "analog_io_types" => |w| Uint32(w.robot.setup.analog_domains),
        "standard_analog_input0" | "standard_analog_input1" => |_| Double(0.004),
        "standard_analog_output0" => |w| Double(w.robot.analog_outputs.first().copied().unwrap_or(0.0)),
        "standard_analog_output1" => |w| Double(w.robot.analog_outputs.last().copied().unwrap_or(0.0)),
        "io_current" | "euromap67_24V_voltage" | "euromap67_24V_current" => |_| Double(0.0),
        "euromap67_input_bits" | "euromap67_output_bits" | "tool_analog_input_types" => |_| Uint32(0),
        "tool_mode" => |w| Uint32(u32::from(joint_mode(w))),
        "tool_output_mode" => |w| Uint8(w.robot.setup.tool_output_mode),
        "tool_digital_output0_mode" => |w| Uint8(w.robot.setup.tool_digital_output_modes[0]),
        "tool_digital_output1_mode" => |w| Uint8(w.robot.setup.tool_digital_output_modes[1]),
        "tool_analog_input0" | "tool_analog_input1" | "tool_output_current" => |_| Double(0.0),
        "tool_output_voltage" => |w| Int32(w.robot.setup.tool_voltage),
        "tool_temperature" => |_| Double(30.0),
        "tcp_force_scalar" | "joint_position_deviation_ratio" | "collision_detection_ratio" => {
            |_| Double(0.0)
        }
        "time_scale_source" => |_| Int32(-1),
        "tcp_offset" => |w| Vector6d(w.robot.tcp_offset),
        "script_control_line" => |w| Uint32(w.line()),
        "payload" => |w| Double(w.robot.payload.0),
        "payload_inertia" => |w| Vector6d(w.robot.payload_inertia),
        "payload_cog" => |w| Vector3d(w.robot.payload.1),
        "output_bit_registers0_to_31" => |w| word(w.registers.bits, 0),
        "output_bit_registers32_to_63" => |w| word(w.registers.bits, 32),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{ControllerOptions, Series};
    use foretrace_ur::rtde::fields::OUTPUTS;

    #[test]
    fn every_output_is_read_with_the_type_that_is_promised() {
        let world = World::new(ControllerOptions::new(Series::E));
        let mut names: Vec<String> = OUTPUTS.iter().map(|(name, ..)| (*name).to_owned()).collect();
        for register in ["input_int_register_47", "output_double_register_0", "output_bit_register_127"] {
            names.push(register.to_owned());
        }
        for name in names {
            let (source, kind) = OutputSource::of(&name, (10, 0, 0)).unwrap_or_else(|| panic!("{name}"));
            assert_eq!(source.read(&world).field_type(), kind, "{name}");
        }
    }
}
