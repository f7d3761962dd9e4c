//! The functions that programs may call, beside those of the interpreter itself.
//!
//! *Source*: the script manuals of 3.15 and 5.11, and what the programs of others call beside them. Where the
//! manuals do not tell which version brought a function, every version of the series has it.

use super::options::Series;
use foretrace_ur::rtde::ControllerVersion;

/// What becomes of a call.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum KnownAs {
    Simulated,
    /// A setting, as the header of a program of the pendant has them: taken and remembered.
    SetUp,
    /// A controller has it; here it fails when it is called.
    Missing,
}

use KnownAs::{Missing, SetUp, Simulated};

/// Minor version and bugfix.
type MinorVersion = (u32, u32);

const NEVER: MinorVersion = (u32::MAX, 0);
/// Least version of 3.x and of 5.x.
const ALWAYS: [MinorVersion; 2] = [(0, 0), (0, 0)];
const E: [MinorVersion; 2] = [NEVER, (0, 0)];
/// Later than the manual of 5.11.
const LATER: [MinorVersion; 2] = [NEVER, (12, 0)];

const fn e_since(minor: u32) -> [MinorVersion; 2] {
    [NEVER, (minor, 0)]
}

/// What a CB3 loads, because programs for both series have it behind no guard or behind one that looks when
/// it runs, and cannot do: the call fails.
const FAILS_ON_CB3: [&str; 2] = ["force_mode_set_gain_scaling", "tool_contact"];

/// In the order of the alphabet, which [`known`] relies on.
#[rustfmt::skip]
const NAMES: &[(&str, KnownAs, [MinorVersion; 2])] = &[
    ("add_frame", Missing, LATER),
    ("attach_frame", Missing, LATER),
    ("clear_interpreter", Simulated, e_since(8)),
    ("convert_pose", Missing, LATER),
    ("conveyor_pulse_decode", Missing, ALWAYS),
    ("delete_all_frames", Missing, LATER),
    ("delete_frame", Missing, LATER),
    ("direct_torque", Missing, LATER),
    ("eip_reader_factory", Missing, LATER),
    ("eip_writer_factory", Missing, LATER),
    ("enable_external_ft_sensor", Missing, ALWAYS),
    ("encoder_enable_pulse_decode", Missing, ALWAYS),
    ("encoder_enable_set_tick_count", Missing, ALWAYS),
    ("encoder_get_tick_count", Missing, ALWAYS),
    ("encoder_set_tick_count", Missing, ALWAYS),
    ("encoder_unwind_delta_tick_count", Missing, ALWAYS),
    ("end_force_mode", Simulated, ALWAYS),
    ("end_freedrive_mode", Simulated, ALWAYS),
    ("end_interpreter", Simulated, e_since(8)),
    ("end_screw_driving", Missing, E),
    ("end_teach_mode", Simulated, ALWAYS),
    ("estimate_payload", Missing, LATER),
    ("force", Simulated, ALWAYS),
    ("force_mode", Missing, ALWAYS),
    ("force_mode_example", Missing, ALWAYS),
    ("force_mode_get_damping", Missing, LATER),
    ("force_mode_get_gain_scaling", Missing, LATER),
    ("force_mode_set_damping", Simulated, ALWAYS),
    ("force_mode_set_gain_scaling", Simulated, ALWAYS),
    ("frame_tracking_disable", Missing, LATER),
    ("frame_tracking_enable", Missing, LATER),
    ("freedrive_mode", Missing, ALWAYS),
    ("freedrive_mode_no_incorrect_payload_check", Missing, ALWAYS),
    ("ft_rtde_input_enable", Missing, [(14, 1), (9, 1)]),
    ("get_actual_joint_accelerations", Missing, LATER),
    ("get_actual_joint_positions", Simulated, ALWAYS),
    ("get_actual_joint_positions_history", Missing, [(0, 0), (4, 0)]),
    ("get_actual_joint_speeds", Simulated, ALWAYS),
    ("get_actual_tcp_pose", Simulated, ALWAYS),
    ("get_actual_tcp_speed", Simulated, ALWAYS),
    ("get_actual_tool_flange_pose", Simulated, ALWAYS),
    ("get_analog_in", Simulated, ALWAYS),
    ("get_analog_out", Simulated, ALWAYS),
    ("get_base_acceleration", Missing, LATER),
    ("get_children", Missing, LATER),
    ("get_configurable_digital_in", Simulated, ALWAYS),
    ("get_configurable_digital_out", Simulated, ALWAYS),
    ("get_controller_temp", Simulated, ALWAYS),
    ("get_conveyor_tick_count", Missing, ALWAYS),
    ("get_coriolis_and_centrifugal_torques", Missing, LATER),
    ("get_digital_in", Simulated, ALWAYS),
    ("get_digital_out", Simulated, ALWAYS),
    ("get_euromap_input", Missing, ALWAYS),
    ("get_euromap_output", Missing, ALWAYS),
    ("get_flag", Simulated, ALWAYS),
    ("get_forward_kin", Simulated, ALWAYS),
    ("get_frame_parent", Missing, LATER),
    ("get_freedrive_status", Simulated, e_since(10)),
    ("get_gravity", Missing, LATER),
    ("get_inverse_kin", Simulated, ALWAYS),
    ("get_inverse_kin_has_solution", Simulated, ALWAYS),
    ("get_jacobian", Missing, LATER),
    ("get_jacobian_time_derivative", Missing, LATER),
    ("get_joint_positions", Simulated, ALWAYS),
    ("get_joint_temp", Simulated, ALWAYS),
    ("get_joint_torques", Simulated, ALWAYS),
    ("get_mass_matrix", Missing, LATER),
    ("get_pose", Missing, LATER),
    ("get_rtde_value", Missing, LATER),
    ("get_standard_analog_in", Simulated, ALWAYS),
    ("get_standard_analog_out", Simulated, ALWAYS),
    ("get_standard_digital_in", Simulated, ALWAYS),
    ("get_standard_digital_out", Simulated, ALWAYS),
    ("get_steptime", Simulated, ALWAYS),
    ("get_target_joint_accelerations", Missing, LATER),
    ("get_target_joint_positions", Simulated, ALWAYS),
    ("get_target_joint_speeds", Simulated, ALWAYS),
    ("get_target_payload", Simulated, ALWAYS),
    ("get_target_payload_cog", Simulated, ALWAYS),
    ("get_target_payload_inertia", Simulated, [(15, 0), (10, 0)]),
    ("get_target_tcp_pose", Simulated, ALWAYS),
    ("get_target_tcp_pose_along_path", Missing, ALWAYS),
    ("get_target_tcp_speed", Simulated, ALWAYS),
    ("get_target_tcp_speed_along_path", Missing, ALWAYS),
    ("get_target_waypoint", Missing, [(0, 0), (3, 0)]),
    ("get_tcp_force", Simulated, ALWAYS),
    ("get_tcp_offset", Simulated, ALWAYS),
    ("get_tool_accelerometer_reading", Simulated, ALWAYS),
    ("get_tool_analog_in", Simulated, ALWAYS),
    ("get_tool_current", Simulated, ALWAYS),
    ("get_tool_digital_in", Simulated, ALWAYS),
    ("get_tool_digital_out", Simulated, ALWAYS),
    ("get_tool_digital_output_mode", Missing, E),
    ("get_tool_output_mode", Missing, E),
    ("get_tool_temp", Missing, LATER),
    ("high_holding_torque_disable", Missing, LATER),
    ("high_holding_torque_enable", Missing, LATER),
    ("interpreter_mode", Simulated, e_since(8)),
    ("is_frame", Missing, LATER),
    ("is_steady", Simulated, ALWAYS),
    ("is_within_safety_limits", Simulated, ALWAYS),
    ("jerk_gain_scaling_get", Missing, LATER),
    ("jerk_gain_scaling_set", Missing, LATER),
    ("mc_add_circular", Missing, ALWAYS),
    ("mc_add_linear", Missing, ALWAYS),
    ("mc_add_path", Missing, ALWAYS),
    ("mc_get_target_rtcp_speed", Missing, ALWAYS),
    ("mc_initialize", Missing, ALWAYS),
    ("mc_load_path", Missing, ALWAYS),
    ("mc_run_motion", Missing, ALWAYS),
    ("mc_set_pcs", Missing, ALWAYS),
    ("mc_set_speed_factor", Missing, ALWAYS),
    ("modbus_add_rw_signal", Missing, LATER),
    ("modbus_add_signal", SetUp, ALWAYS),
    ("modbus_delete_signal", SetUp, ALWAYS),
    ("modbus_get_error", Missing, LATER),
    ("modbus_get_signal_status", Simulated, ALWAYS),
    ("modbus_get_time_since_signal_invalid", Missing, LATER),
    ("modbus_reset_connection", Missing, LATER),
    ("modbus_send_custom_command", SetUp, ALWAYS),
    ("modbus_set_digital_input_action", SetUp, ALWAYS),
    ("modbus_set_output_register", SetUp, ALWAYS),
    ("modbus_set_output_signal", SetUp, ALWAYS),
    ("modbus_set_runstate_dependent_choice", SetUp, ALWAYS),
    ("modbus_set_signal_update_frequency", SetUp, ALWAYS),
    ("modbus_set_signal_watchdog", Missing, LATER),
    ("motion_version_get", Missing, LATER),
    ("motion_version_set", Missing, LATER),
    ("move_frame", Missing, LATER),
    ("movec", Missing, ALWAYS),
    ("movej", Simulated, ALWAYS),
    ("movel", Simulated, ALWAYS),
    ("movep", Missing, ALWAYS),
    ("optimovej", Missing, LATER),
    ("optimovel", Missing, LATER),
    ("path_offset_disable", Missing, ALWAYS),
    ("path_offset_enable", Missing, ALWAYS),
    ("path_offset_get", Missing, ALWAYS),
    ("path_offset_set", Missing, ALWAYS),
    ("path_offset_set_alpha_filter", Missing, ALWAYS),
    ("path_offset_set_max_offset", Missing, ALWAYS),
    ("pause_on_error_code", SetUp, ALWAYS),
    ("popup", Simulated, ALWAYS),
    ("position_deviation_warning", SetUp, ALWAYS),
    ("powerdown", Missing, ALWAYS),
    ("protective_stop", Simulated, ALWAYS),
    ("random", Simulated, ALWAYS),
    ("read_input_boolean_register", Simulated, ALWAYS),
    ("read_input_float_register", Simulated, ALWAYS),
    ("read_input_integer_register", Simulated, ALWAYS),
    ("read_output_boolean_register", Simulated, ALWAYS),
    ("read_output_float_register", Simulated, ALWAYS),
    ("read_output_integer_register", Simulated, ALWAYS),
    ("read_port_bit", Simulated, ALWAYS),
    ("read_port_register", Simulated, ALWAYS),
    ("request_boolean_from_primary_client", Missing, ALWAYS),
    ("request_float_from_primary_client", Missing, ALWAYS),
    ("request_integer_from_primary_client", Missing, ALWAYS),
    ("request_string_from_primary_client", Missing, ALWAYS),
    ("reset_revolution_counter", SetUp, ALWAYS),
    ("reset_world_model", Missing, LATER),
    ("rpc_factory", Missing, ALWAYS),
    ("rtde_set_watchdog", Simulated, ALWAYS),
    ("screw_driving", Missing, E),
    ("servoc", Missing, ALWAYS),
    ("servoj", Simulated, ALWAYS),
    ("set_analog_inputrange", SetUp, ALWAYS),
    ("set_analog_out", Simulated, ALWAYS),
    ("set_analog_outputdomain", SetUp, ALWAYS),
    ("set_base_acceleration", Missing, LATER),
    ("set_baselight_iec", Missing, LATER),
    ("set_baselight_off", Missing, LATER),
    ("set_baselight_solid", Missing, LATER),
    ("set_configurable_digital_input_action", SetUp, ALWAYS),
    ("set_configurable_digital_out", Simulated, ALWAYS),
    ("set_conveyor_tick_count", Missing, ALWAYS),
    ("set_digital_out", Simulated, ALWAYS),
    ("set_euromap_output", Missing, ALWAYS),
    ("set_euromap_runstate_dependent_choice", SetUp, ALWAYS),
    ("set_flag", Simulated, ALWAYS),
    ("set_gp_boolean_input_action", SetUp, ALWAYS),
    ("set_gravity", SetUp, ALWAYS),
    ("set_input_actions_to_default", SetUp, ALWAYS),
    ("set_mass_properties", Missing, LATER),
    ("set_payload", SetUp, ALWAYS),
    ("set_payload_cog", SetUp, ALWAYS),
    ("set_payload_from_attached_frames", Missing, LATER),
    ("set_payload_mass", SetUp, ALWAYS),
    ("set_pos", Missing, ALWAYS),
    ("set_runstate_configurable_digital_output_to_value", SetUp, ALWAYS),
    ("set_runstate_gp_boolean_output_to_value", SetUp, ALWAYS),
    ("set_runstate_outputs", SetUp, ALWAYS),
    ("set_runstate_standard_analog_output_to_value", SetUp, ALWAYS),
    ("set_runstate_standard_digital_output_to_value", SetUp, ALWAYS),
    ("set_runstate_tool_digital_output_to_value", SetUp, ALWAYS),
    ("set_safety_mode_transition_hardness", SetUp, ALWAYS),
    ("set_standard_analog_input_domain", SetUp, ALWAYS),
    ("set_standard_analog_out", Simulated, ALWAYS),
    ("set_standard_digital_input_action", SetUp, ALWAYS),
    ("set_standard_digital_out", Simulated, ALWAYS),
    ("set_target_payload", SetUp, [(15, 0), (10, 0)]),
    ("set_tcp", SetUp, ALWAYS),
    ("set_tool_analog_input_domain", SetUp, ALWAYS),
    ("set_tool_communication", SetUp, E),
    ("set_tool_digital_input_action", SetUp, ALWAYS),
    ("set_tool_digital_out", Simulated, ALWAYS),
    ("set_tool_digital_output_mode", SetUp, E),
    ("set_tool_output_mode", SetUp, E),
    ("set_tool_voltage", SetUp, ALWAYS),
    ("sleep", Simulated, ALWAYS),
    ("socket_close", Simulated, ALWAYS),
    ("socket_get_var", Simulated, ALWAYS),
    ("socket_open", Simulated, ALWAYS),
    ("socket_read_ascii_float", Simulated, ALWAYS),
    ("socket_read_binary_integer", Simulated, ALWAYS),
    ("socket_read_byte_list", Simulated, ALWAYS),
    ("socket_read_line", Simulated, ALWAYS),
    ("socket_read_string", Simulated, ALWAYS),
    ("socket_send_byte", Simulated, ALWAYS),
    ("socket_send_int", Simulated, ALWAYS),
    ("socket_send_line", Simulated, ALWAYS),
    ("socket_send_string", Simulated, ALWAYS),
    ("socket_set_var", Simulated, ALWAYS),
    ("speedj", Simulated, ALWAYS),
    ("speedl", Missing, ALWAYS),
    ("stop_conveyor_tracking", Missing, ALWAYS),
    ("stopj", Simulated, ALWAYS),
    ("stopl", Simulated, ALWAYS),
    ("sync", Simulated, ALWAYS),
    ("teach_mode", Missing, ALWAYS),
    ("textmsg", Simulated, ALWAYS),
    ("time", Missing, LATER),
    ("tool_contact", Missing, [(0, 0), (4, 0)]),
    ("tool_contact_examples", Missing, E),
    ("tool_wrench_limit_disable", Missing, LATER),
    ("tool_wrench_limit_set", Missing, LATER),
    ("track_conveyor_circular", Missing, ALWAYS),
    ("track_conveyor_linear", Missing, ALWAYS),
    ("write_output_boolean_register", Simulated, ALWAYS),
    ("write_output_float_register", Simulated, ALWAYS),
    ("write_output_integer_register", Simulated, ALWAYS),
    ("write_port_bit", Simulated, ALWAYS),
    ("write_port_register", Simulated, ALWAYS),
    ("zero_ftsensor", Simulated, ALWAYS),
];

/// What a controller of this series and version knows `name` as.
pub(super) fn known(name: &str, series: Series, version: ControllerVersion) -> Option<KnownAs> {
    let at = NAMES.binary_search_by(|(known, ..)| (*known).cmp(name)).ok()?;
    let (_, how, [cb3, e]) = NAMES.get(at)?;
    let is = if version.major > 5 { (u32::MAX - 1, 0) } else { (version.minor, version.bugfix) };
    let least = if series == Series::Cb3 { *cb3 } else { *e };
    let how = if series == Series::Cb3 && FAILS_ON_CB3.contains(&name) { Missing } else { *how };
    (is >= least).then_some(how)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::usual_version;

    #[test]
    fn names_are_in_order_and_known_by_series_and_version() {
        assert!(NAMES.is_sorted_by(|(a, ..), (b, ..)| a < b));
        let cb3 = |name| known(name, Series::Cb3, usual_version(Series::Cb3));
        let e = |name| known(name, Series::E, usual_version(Series::E));
        for (name, _, _) in NAMES {
            assert!(cb3(name).is_none() || e(name).is_some(), "{name} went with e-Series");
        }
        for name in ["set_tool_communication", "interpreter_mode", "set_tool_output_mode", "screw_driving"] {
            assert_eq!((cb3(name), e(name).is_some()), (None, true), "{name}");
        }
        let mut older = usual_version(Series::E);
        older.minor = 7;
        assert_eq!(known("interpreter_mode", Series::E, older), None);
        assert_eq!((e("optimovej"), e("fly_away")), (None, None));
        older.minor = 21;
        assert_eq!(known("optimovej", Series::E, older), Some(Missing));
        assert_eq!((e("movec"), cb3("movec")), (Some(Missing), Some(Missing)));
        assert_eq!(known("attach_frame", Series::E, older), Some(Missing));
        for name in FAILS_ON_CB3 {
            assert_eq!(cb3(name), Some(Missing), "{name}");
        }
        assert_eq!(e("force_mode_set_gain_scaling"), Some(Simulated));
    }

    #[test]
    fn some_names_came_with_a_bugfix_or_a_minor_version() {
        let at = |series, minor, bugfix, name| {
            known(name, series, ControllerVersion { minor, bugfix, ..usual_version(series) }).is_some()
        };
        for (series, minor) in [(Series::Cb3, 14), (Series::E, 9)] {
            assert!(!at(series, minor, 0, "ft_rtde_input_enable"), "{series:?}");
            assert!(at(series, minor, 1, "ft_rtde_input_enable"), "{series:?}");
            assert!(at(series, minor + 1, 0, "ft_rtde_input_enable"), "{series:?}");
        }
        for (name, minor) in [
            ("get_target_waypoint", 3),
            ("get_actual_joint_positions_history", 4),
            ("tool_contact", 4),
            ("get_freedrive_status", 10),
        ] {
            assert!(!at(Series::E, minor - 1, 9, name) && at(Series::E, minor, 0, name), "{name}");
        }
    }
}
