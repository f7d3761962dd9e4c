//! The functions that programs may call, beside those of the interpreter itself.

const SIMULATED: &str = "\
    end_force_mode end_freedrive_mode end_teach_mode force_mode_set_damping \
    force_mode_set_gain_scaling get_actual_joint_positions get_actual_joint_speeds get_actual_tcp_pose \
    get_actual_tcp_speed get_analog_out get_configurable_digital_in get_configurable_digital_out \
    get_digital_in get_digital_out get_forward_kin get_inverse_kin get_inverse_kin_has_solution \
    get_standard_analog_out get_standard_digital_in get_standard_digital_out get_steptime \
    get_target_joint_positions get_target_joint_speeds get_target_payload get_target_payload_cog \
    get_target_payload_inertia get_target_tcp_pose get_tcp_offset get_tool_digital_out is_steady movej \
    movel popup protective_stop read_input_boolean_register read_input_float_register \
    read_input_integer_register read_output_boolean_register read_output_float_register \
    read_output_integer_register rtde_set_watchdog servoj set_analog_out set_configurable_digital_out \
    set_digital_out set_gravity set_payload set_payload_cog set_payload_mass set_standard_analog_out \
    set_standard_digital_out set_target_payload set_tcp set_tool_digital_out set_tool_voltage sleep \
    speedj stopj stopl sync textmsg write_output_boolean_register write_output_float_register \
    write_output_integer_register zero_ftsensor";

/// Known to a controller, and to programs of clients, but not simulated.
const NOT_SIMULATED: &str = "\
    direct_torque enable_external_ft_sensor force_mode freedrive_mode ft_rtde_input_enable \
    get_actual_joint_positions_history get_actual_tool_flange_pose \
    get_coriolis_and_centrifugal_torques get_freedrive_status get_jacobian \
    get_jacobian_time_derivative get_joint_torques get_mass_matrix get_target_joint_accelerations \
    get_target_tcp_speed get_target_waypoint get_tcp_force is_within_safety_limits movec movep servoc \
    socket_close socket_open socket_read_ascii_float socket_read_binary_integer socket_read_line \
    socket_read_string socket_send_int socket_send_line socket_send_string speedl teach_mode \
    tool_contact";

pub(super) fn is_simulated(name: &str) -> bool {
    SIMULATED.split_ascii_whitespace().any(|known| known == name)
}

pub(super) fn is_known_only(name: &str) -> bool {
    NOT_SIMULATED.split_ascii_whitespace().any(|known| known == name)
}
