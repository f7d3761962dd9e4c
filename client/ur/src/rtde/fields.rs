//! Which fields RTDE has, of what type, and from which version on.
//!
//! *Source*: RTDE guide, tables of outputs and inputs; versions where the table names one.

use super::value::FieldType::{self, *};

/// A version as far as fields depend on it, major, minor, bugfix: major 3 is CB3, 5 and above e-Series.
pub type FieldVersion = (u32, u32, u32);

/// Minor version and bugfix, since which there is a field.
type Since = (u32, u32);

/// Since the first version with RTDE.
const ALWAYS: [Since; 2] = since(0, 0);
const NEVER: Since = (u32::MAX, 0);

/// Since these minor versions of 3.x and of 5.x.
const fn since(cb3: u32, e: u32) -> [Since; 2] {
    [(cb3, 0), (e, 0)]
}

/// Since this minor version of 5.x, and never in 3.x.
const fn e_since(minor: u32) -> [Since; 2] {
    [NEVER, (minor, 0)]
}

/// Name, type, least version of 3.x and of 5.x.
type FieldRow = (&'static str, FieldType, [Since; 2]);

pub const OUTPUTS: &[FieldRow] = &[
    ("timestamp", Double, ALWAYS),
    ("target_q", Vector6d, ALWAYS),
    ("target_qd", Vector6d, ALWAYS),
    ("target_qdd", Vector6d, ALWAYS),
    ("target_current", Vector6d, ALWAYS),
    ("target_moment", Vector6d, ALWAYS),
    ("actual_q", Vector6d, ALWAYS),
    ("actual_qd", Vector6d, ALWAYS),
    ("actual_current", Vector6d, ALWAYS),
    ("actual_current_window", Vector6d, ALWAYS),
    ("joint_control_output", Vector6d, ALWAYS),
    ("actual_TCP_pose", Vector6d, ALWAYS),
    ("actual_TCP_speed", Vector6d, ALWAYS),
    ("actual_TCP_force", Vector6d, ALWAYS),
    ("target_TCP_pose", Vector6d, ALWAYS),
    ("target_TCP_speed", Vector6d, ALWAYS),
    ("actual_digital_input_bits", Uint64, ALWAYS),
    ("joint_temperatures", Vector6d, ALWAYS),
    ("actual_execution_time", Double, ALWAYS),
    ("robot_mode", Int32, ALWAYS),
    ("joint_mode", Vector6Int32, ALWAYS),
    ("safety_mode", Int32, ALWAYS),
    ("safety_status", Int32, since(10, 4)),
    ("actual_tool_accelerometer", Vector3d, ALWAYS),
    ("speed_scaling", Double, ALWAYS),
    ("target_speed_fraction", Double, ALWAYS),
    ("actual_momentum", Double, ALWAYS),
    ("actual_main_voltage", Double, ALWAYS),
    ("actual_robot_voltage", Double, ALWAYS),
    ("actual_robot_current", Double, ALWAYS),
    ("actual_joint_voltage", Vector6d, ALWAYS),
    ("actual_digital_output_bits", Uint64, ALWAYS),
    ("runtime_state", Uint32, ALWAYS),
    ("elbow_position", Vector3d, since(5, 0)),
    ("elbow_velocity", Vector3d, since(5, 0)),
    ("robot_status_bits", Uint32, ALWAYS),
    ("safety_status_bits", Uint32, ALWAYS),
    ("analog_io_types", Uint32, ALWAYS),
    ("standard_analog_input0", Double, ALWAYS),
    ("standard_analog_input1", Double, ALWAYS),
    ("standard_analog_output0", Double, ALWAYS),
    ("standard_analog_output1", Double, ALWAYS),
    ("io_current", Double, ALWAYS),
    ("euromap67_input_bits", Uint32, ALWAYS),
    ("euromap67_output_bits", Uint32, ALWAYS),
    ("euromap67_24V_voltage", Double, ALWAYS),
    ("euromap67_24V_current", Double, ALWAYS),
    ("tool_mode", Uint32, ALWAYS),
    ("tool_output_mode", Uint8, e_since(0)),
    ("tool_digital_output0_mode", Uint8, e_since(2)),
    ("tool_digital_output1_mode", Uint8, e_since(2)),
    ("tool_analog_input_types", Uint32, ALWAYS),
    ("tool_analog_input0", Double, ALWAYS),
    ("tool_analog_input1", Double, ALWAYS),
    ("tool_output_voltage", Int32, ALWAYS),
    ("tool_output_current", Double, ALWAYS),
    ("tool_temperature", Double, ALWAYS),
    ("tcp_force_scalar", Double, ALWAYS),
    ("joint_position_deviation_ratio", Double, ALWAYS),
    ("collision_detection_ratio", Double, since(15, 10)),
    ("time_scale_source", Int32, e_since(17)),
    ("tcp_offset", Vector6d, [(12, 0), (5, 1)]),
    ("script_control_line", Uint32, since(14, 9)),
    ("payload", Double, [(11, 0), (5, 1)]),
    ("payload_cog", Vector3d, [(11, 0), (5, 1)]),
    ("payload_inertia", Vector6d, since(15, 11)),
    ("ft_raw_wrench", Vector6d, e_since(9)),
    ("actual_current_as_torque", Vector6d, e_since(23)),
    ("output_bit_registers0_to_31", Uint32, ALWAYS),
    ("output_bit_registers32_to_63", Uint32, ALWAYS),
    ("input_bit_registers0_to_31", Uint32, since(4, 0)),
    ("input_bit_registers32_to_63", Uint32, since(4, 0)),
];

pub const INPUTS: &[FieldRow] = &[
    ("speed_slider_mask", Uint32, ALWAYS),
    ("speed_slider_fraction", Double, ALWAYS),
    ("standard_digital_output_mask", Uint8, ALWAYS),
    ("standard_digital_output", Uint8, ALWAYS),
    ("configurable_digital_output_mask", Uint8, ALWAYS),
    ("configurable_digital_output", Uint8, ALWAYS),
    ("tool_digital_output_mask", Uint8, ALWAYS),
    ("tool_digital_output", Uint8, ALWAYS),
    ("standard_analog_output_mask", Uint8, ALWAYS),
    ("standard_analog_output_type", Uint8, ALWAYS),
    ("standard_analog_output_0", Double, ALWAYS),
    ("standard_analog_output_1", Double, ALWAYS),
    ("external_force_torque", Vector6d, since(3, 0)),
    ("input_bit_registers0_to_31", Uint32, ALWAYS),
    ("input_bit_registers32_to_63", Uint32, ALWAYS),
];

/// A register of its own: `input_int_register_24`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Register {
    /// Input registers are written by clients, output registers by programs.
    pub input: bool,
    /// `Bool` (64 to 127), `Int32` or `Double` (0 to 47).
    pub kind: FieldType,
    pub number: usize,
}

impl Register {
    /// The register that `name` names. `input_bit_register_64` is one, `input_bit_registers0_to_31` is not.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        let (input, rest) = match name.strip_prefix("input_") {
            Some(rest) => (true, rest),
            None => (false, name.strip_prefix("output_")?),
        };
        let (kind, digits) = [(Bool, "bit"), (Int32, "int"), (Double, "double")]
            .into_iter()
            .find_map(|(kind, word)| Some((kind, rest.strip_prefix(word)?.strip_prefix("_register_")?)))?;
        // No sign, no leading zero: a controller knows each by one name.
        let plain =
            digits.bytes().all(|byte| byte.is_ascii_digit()) && (digits == "0" || !digits.starts_with('0'));
        let number: usize = digits.parse().ok().filter(|_| plain)?;
        let range = if kind == Bool { 64..128 } else { 0..48 };
        range.contains(&number).then_some(Self { input, kind, number })
    }

    /// Upper registers (24 to 47) came with 3.9 and 5.3, single bits too.
    const fn least(self) -> [Since; 2] {
        if matches!(self.kind, Bool) || self.number >= 24 { since(9, 3) } else { since(4, 0) }
    }
}

fn exists(least: [Since; 2], (major, minor, bugfix): FieldVersion) -> bool {
    let [cb3, e] = least;
    match major {
        0..=2 => false,
        3 => (minor, bugfix) >= cb3,
        5 => (minor, bugfix) >= e,
        _ => true,
    }
}

fn look_up(table: &[FieldRow], name: &str, version: FieldVersion) -> Option<FieldType> {
    table.iter().find(|(known, _, least)| *known == name && exists(*least, version)).map(|(_, kind, _)| *kind)
}

/// Type of an output of a controller of this version; input registers can be read as outputs too.
#[must_use]
pub fn output(name: &str, version: FieldVersion) -> Option<FieldType> {
    let register = || Register::from_name(name).filter(|r| exists(r.least(), version)).map(|r| r.kind);
    look_up(OUTPUTS, name, version).or_else(register)
}

/// Type of an input of a controller of this version.
#[must_use]
pub fn input(name: &str, version: FieldVersion) -> Option<FieldType> {
    let register =
        || Register::from_name(name).filter(|r| r.input && exists(r.least(), version)).map(|r| r.kind);
    look_up(INPUTS, name, version).or_else(register)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_told_apart_by_direction_and_version() {
        assert_eq!(output("actual_q", (3, 4, 0)), Some(Vector6d));
        assert_eq!(input("actual_q", (5, 11, 0)), None);
        assert_eq!(output("ft_raw_wrench", (5, 8, 0)), None);
        assert_eq!(output("ft_raw_wrench", (5, 9, 0)), Some(Vector6d));
        assert_eq!(output("ft_raw_wrench", (3, 15, 0)), None);
        assert_eq!(output("payload_inertia", (3, 15, 0)), Some(Vector6d));
        assert_eq!(input("speed_slider_mask", (3, 15, 0)), Some(Uint32));
        assert_eq!(output("speed_slider_mask", (3, 15, 0)), None);
        assert_eq!(output("", (5, 11, 0)), None);
        for name in ["tool_digital_output0_mode", "tool_digital_output1_mode"] {
            assert_eq!(output(name, (5, 2, 0)), Some(Uint8));
            assert_eq!((output(name, (5, 1, 9)), output(name, (3, 15, 0))), (None, None));
        }
        for (version, has) in [((3, 13, 9), false), ((3, 14, 0), true), ((5, 8, 9), false), ((5, 9, 0), true)]
        {
            assert_eq!(output("script_control_line", version), has.then_some(Uint32), "{version:?}");
        }
        for (version, has) in [((3, 11, 9), false), ((3, 12, 0), true), ((5, 5, 0), false), ((5, 5, 1), true)]
        {
            assert_eq!(output("tcp_offset", version), has.then_some(Vector6d), "{version:?}");
        }
    }

    #[test]
    fn registers_are_known_by_one_name_each() {
        assert_eq!(input("input_int_register_24", (3, 15, 0)), Some(Int32));
        assert_eq!(input("input_int_register_24", (3, 8, 0)), None);
        assert_eq!(output("input_double_register_47", (5, 3, 0)), Some(Double));
        assert_eq!(input("output_double_register_3", (5, 3, 0)), None);
        assert_eq!(output("output_bit_register_127", (5, 3, 0)), Some(Bool));
        for wrong in [
            "input_int_register_48",
            "input_int_register_024",
            "input_int_register_+4",
            "output_int_register_",
            "output_bit_register_63",
            "output_bit_register_128",
            "input_double_register_4 ",
        ] {
            assert_eq!(output(wrong, (5, 11, 0)), None, "{wrong}");
        }
    }

    #[test]
    fn no_name_stands_twice() {
        for table in [OUTPUTS, INPUTS] {
            for (i, (name, ..)) in table.iter().enumerate() {
                assert!(table.iter().skip(i + 1).all(|(other, ..)| other != name), "{name}");
                assert!(Register::from_name(name).is_none(), "{name}");
            }
        }
    }
}
