//! Claims about what programs set, and about calls with arguments that no controller takes.

use super::dashboard_server::{DashboardReply, answer};
use super::options::{ControllerOptions, Series};
use super::world::{Runtime, World};

/// A world in which a program of `body` has run for `cycles`, and what it said.
fn after(series: Series, body: &str, cycles: u32) -> (World, String) {
    let mut world = World::new(ControllerOptions::new(series));
    world.take_script(&format!("def s():\n  {body}\nend\n"));
    (0..cycles).for_each(|_| world.cycle());
    let said = format!("{:?}", world.messages.drain(..).collect::<Vec<_>>());
    (world, said)
}

#[test]
fn a_payload_without_a_centre_is_at_the_tool_and_the_older_calls_take_the_inertia_back() {
    let set = "set_tcp(p[0.01, 0.02, 0.15, 0, 0, 0])\n  \
        set_target_payload(2, [0, 0, 0.1], [1, 2, 3, -0.1, 0, 0.1], transition_time=0.5)\n  \
        textmsg(\"inertia \", get_target_payload_inertia())\n  ";
    let (world, said) = after(Series::E, set, 5);
    assert!(said.contains("inertia [1.0, 2.0, 3.0, -0.1, 0.0, 0.1]"), "{said}");
    assert_eq!(world.robot.payload, (2.0, [0.0, 0.0, 0.1]));
    for (more, centre, inertia) in [
        ("set_payload(1)", [0.01, 0.02, 0.15], [0.0; 6]),
        ("set_payload(1, [0, 0.3, 0])", [0.0, 0.3, 0.0], [0.0; 6]),
        ("set_payload_mass(1)", [0.0, 0.0, 0.1], [0.0; 6]),
        ("set_target_payload(1, [0, 0, 0.2])", [0.0, 0.0, 0.2], [0.0; 6]),
    ] {
        let (world, said) = after(Series::E, &format!("{set}{more}"), 5);
        assert!(!said.contains("RuntimeException"), "{more}: {said}");
        assert_eq!((world.robot.payload, world.robot.payload_inertia), ((1.0, centre), inertia), "{more}");
    }
    for (wrong, why) in [
        ("set_target_payload(1)", "wants an argument for cog"),
        ("set_target_payload(1, [0, 0, 0], [-1, 0, 0, 0, 0, 0])", "no negative Ixx"),
        ("set_target_payload(1, [0, 0, 0], [0, 0, -0.1, 0, 0, 0])", "no negative Ixx"),
        ("set_target_payload(1, [0, 0, 0], [0, 0, 0, 134, 0, 0])", "within 133"),
        ("set_target_payload(1, [0, 0, 0], [0, 0, 0])", "six numbers"),
        ("set_target_payload(1, [0, 0, 0], [0, 0, 0, 0, 0, 0], -1)", "no negative transition_time"),
        ("set_payload(1, [0, 0])", "three numbers"),
        ("set_payload(-1)", "from 0 to 100"),
    ] {
        let (world, said) = after(Series::E, wrong, 5);
        assert!(said.contains(why), "{wrong}: {said}");
        // Nothing of a call that fails is taken.
        assert_eq!(
            (world.robot.payload, world.robot.payload_inertia),
            ((0.0, [0.0; 3]), [0.0; 6]),
            "{wrong}"
        );
    }
}

#[test]
fn a_blocking_popup_holds_its_thread_until_it_is_closed() {
    let body = "thread beside():\n    while True:\n      write_output_integer_register(0, \
        read_output_integer_register(0) + 1)\n      sync()\n    end\n  end\n  run beside()\n  \
        popup(\"look\", title=\"Stop\", blocking=True)\n  textmsg(\"went on\")";
    let (mut world, said) = after(Series::Cb3, body, 300);
    assert!(said.contains("look") && !said.contains("went on"), "{said}");
    assert_eq!(world.runtime(), Runtime::Playing);
    assert!(world.registers.integers[0] > 250);
    assert_eq!(answer(&mut world, "close popup"), DashboardReply::Line("closing popup".to_owned()));
    (0..5).for_each(|_| world.cycle());
    assert!(format!("{:?}", world.messages).contains("went on"));
    // One that does not block, and the next program after one that was stopped amid it.
    let (_, said) = after(Series::E, "popup(\"hi\")\n  popup(\"ho\", blocking=False)\n  textmsg(\"on\")", 5);
    assert!(said.contains("Text(\"on\")"), "{said}");
    let (mut world, _) = after(Series::E, "popup(\"look\", blocking=True)", 5);
    world.stop();
    assert!(world.popups.is_empty());
}

#[test]
fn arguments_that_no_controller_takes_are_refused() {
    for wrong in [
        "get_actual_tcp_pose(5)",
        "get_steptime(1, 2, 3)",
        "get_target_payload(0)",
        "is_steady(True)",
        "get_joint_temp()",
        "get_joint_temp(9)",
        "get_joint_temp(-1)",
        "get_forward_kin(get_actual_joint_positions(), \"other_tcp\")",
        "sync(1)",
        "textmsg()",
        "popup()",
        "popup(\"a\", blocking=1)",
        "set_runstate_standard_digital_output_to_value(99, 99)",
        "set_runstate_standard_digital_output_to_value(8, 1)",
        "set_runstate_configurable_digital_output_to_value(0, 8)",
        "set_runstate_tool_digital_output_to_value(2, 1)",
        "set_runstate_standard_analog_output_to_value(2, 1)",
        "set_runstate_gp_boolean_output_to_value(128, 1)",
        "set_standard_digital_input_action(0, \"jump\")",
        "set_tool_digital_input_action(2, \"default\")",
        "set_gp_boolean_input_action(128, \"freedrive\")",
        "set_safety_mode_transition_hardness(7)",
        "set_tool_communication(True, 300, 0, 1, 1.5, 3.5)",
        "set_tool_communication(True, 9600, 3, 1, 1.5, 3.5)",
        "set_tool_communication(True, 9600, 0, 3, 1.5, 3.5)",
        "set_tool_communication(True, 9600, 0, 1, 0.5, 3.5)",
        "set_tool_communication(True, 9600, 0, 1, 1.5, 41)",
        "set_tool_communication(1, 9600, 0, 1, 1.5, 3.5)",
        "set_tool_digital_output_mode(5, 9)",
        "set_tool_digital_output_mode(0, 0)",
        "set_tool_output_mode(2)",
        "modbus_add_signal(\"192.168.0.9\", 255, 3, 3, \"a_name_of_21_characters\")",
        "modbus_add_signal(\"192.168.0.9\", 256, 3, 3, \"speed\")",
        "write_port_register(128, 65537)",
        "write_port_register(128, -32769)",
    ] {
        let (_, said) = after(Series::E, &format!("{wrong}\n  textmsg(\"went on\")"), 5);
        assert!(said.contains("RuntimeException") && !said.contains("went on"), "{wrong}: {said}");
    }
    for right in [
        "get_joint_temp(5)",
        "get_forward_kin(get_actual_joint_positions(), tcp=\"active_tcp\")",
        "get_forward_kin(\"current_joint_positions\")",
        "get_inverse_kin(get_actual_tcp_pose(), tcp=\"active_tcp\")",
        "set_tool_communication(False, 9600, 0, 1, 1.0, 0.0)",
        "set_runstate_standard_digital_output_to_value(7, 7)",
        "set_tool_digital_input_action(1, \"freedrive\")",
        "modbus_add_signal(\"192.168.0.9\", 255, 3, 3, \"a_name_of_20_letters\")",
    ] {
        let (_, said) = after(Series::E, &format!("{right}\n  textmsg(\"went on\")"), 5);
        assert!(said.contains("went on"), "{right}: {said}");
    }
}

#[test]
fn registers_of_ports_are_read_as_signed() {
    for (written, read) in [(65535, -1), (32767, 32767), (32768, -32768), (-32768, -32768), (65536, 0)] {
        let body =
            format!("write_port_register(128, {written})\n  textmsg(\"is \", read_port_register(128))");
        let (_, said) = after(Series::Cb3, &body, 5);
        assert!(said.contains(&format!("is {read}\"")), "{written}: {said}");
    }
}
