//! Claims about programs on a controller: what they are allowed, what stops them, what watches them.

use super::*;
use crate::options::Series;
use crate::safety::SafetyBreach;
use foretrace_ur::rtde::RtdeValue;

const LOOP: &str = "def p():\n  while True:\n    sync()\n  end\nend\n";

fn world() -> World {
    World::new(ControllerOptions::new(Series::E))
}

fn run(world: &mut World, cycles: usize) {
    (0..cycles).for_each(|_| world.cycle());
}

fn texts(world: &mut World) -> String {
    format!("{:?}", world.messages.drain(..).collect::<Vec<_>>())
}

#[test]
fn a_program_moves_the_arm_and_ends() {
    let mut world = world();
    let from = world.robot.actual().q[0];
    world.take_script(
        "def m():\n  q = get_actual_joint_positions()\n  q[0] = q[0] + 0.2\n  movej(q, a=2, v=1)\n  \
         write_output_float_register(3, q[0])\nend\n",
    );
    assert_eq!(world.runtime(), Runtime::Playing);
    run(&mut world, 700);
    assert_eq!(world.runtime(), Runtime::Stopped);
    assert!((world.robot.actual().q[0] - from - 0.2).abs() < 1e-6);
    assert!((world.registers.doubles[3] - from - 0.2).abs() < 1e-9);
}

#[test]
fn servoj_takes_its_time_and_other_statements_none() {
    let mut world = world();
    world.take_script(
        "def s():\n  q = get_target_joint_positions()\n  i = 0\n  while i < 1000:\n    i = i + 1\n    \
         write_output_integer_register(0, i)\n    \
         servoj(q, t=0.004, lookahead_time=0.03, gain=500)\n  end\nend\n",
    );
    run(&mut world, 100);
    // Two cycles a pass.
    assert_eq!(world.registers.integers[0], 50);
    world.take_script("def s():\n  servoj(get_target_joint_positions(), lookahead_time=0.01)\nend\n");
    run(&mut world, 2);
    assert!(texts(&mut world).contains("lookahead_time must be from 0.03 to 0.2"));
}

#[test]
fn movel_leads_the_tool_straight_and_what_is_out_of_reach_stops_the_program() {
    let mut world = world();
    let from = world.robot.tcp_pose(&world.robot.actual().q);
    world.take_script(
        "def l():\n  a = get_actual_tcp_pose()\n  a[2] = a[2] + 0.1\n  movel(a, a=1.2, v=0.25)\n  \
         movej(get_inverse_kin(a), a=1, v=1)\nend\n",
    );
    for _ in 0..500 {
        world.cycle();
        let at = world.robot.tcp_pose(&world.robot.target.q);
        assert!((at[0] - from[0]).abs() < 1e-6 && (at[1] - from[1]).abs() < 1e-6, "{at:?}");
        assert!(world.robot.tcp_speed(&world.robot.actual())[2] < 0.26);
    }
    assert_eq!(world.runtime(), Runtime::Stopped);
    assert!((world.robot.tcp_pose(&world.robot.actual().q)[2] - from[2] - 0.1).abs() < 1e-5);
    world.take_script("def l():\n  movel(p[2, 0, 0, 0, 3, 0])\nend\n");
    run(&mut world, 2);
    assert!(texts(&mut world).contains("finds no joints"));
}

#[test]
fn killing_the_thread_of_a_motion_brakes_the_arm() {
    let mut world = world();
    world.take_script(
        "def k():\n  thread m():\n    speedj([0.5,0,0,0,0,0], 2, 100)\n  end\n  t = run m()\n  \
         sleep(0.5)\n  kill t\n  \
         sleep(1)\nend\n",
    );
    run(&mut world, 240);
    assert!((world.robot.actual().qd[0] - 0.5).abs() < 1e-3);
    run(&mut world, 200);
    assert_eq!(world.runtime(), Runtime::Playing);
    assert!(world.robot.actual().qd[0].abs() < 1e-6);
}

#[test]
fn a_new_script_takes_the_place_of_a_paused_one() {
    let mut world = world();
    world.take_script(LOOP);
    assert!(world.pause());
    run(&mut world, 200);
    assert_eq!(world.runtime(), Runtime::Paused);
    world.take_script(&LOOP.replace("p()", "other()"));
    run(&mut world, 200);
    assert_eq!((world.runtime(), world.program_name()), (Runtime::Playing, "other"));
}

#[test]
fn safety_stops_end_the_program_and_a_safeguard_pauses_it() {
    let mut world = world();
    world.take_script(LOOP);
    world.robot.safeguard_stop();
    run(&mut world, 200);
    assert_eq!((world.runtime(), world.robot.safety.number()), (Runtime::Paused, 5));
    assert!(!world.play());
    world.robot.safety.safeguard = false;
    assert!(world.play());
    run(&mut world, 200);
    assert_eq!(world.runtime(), Runtime::Playing);
    world.robot.protective_stop(ProtectiveReason::Deviation);
    run(&mut world, 1);
    assert_eq!(world.runtime(), Runtime::Stopped);
    assert!(texts(&mut world).contains("C153A0"));
    world.take_script(LOOP);
    assert_eq!(world.runtime(), Runtime::Stopped);
}

#[test]
fn watchdogs_pause_stop_or_ignore() {
    for (action, after) in
        [("pause", Runtime::Paused), ("stop", Runtime::Stopped), ("ignore", Runtime::Playing)]
    {
        let mut world = world();
        let watchdog = format!("  rtde_set_watchdog(\"input_int_register_24\", 10, \"{action}\")\n  while");
        world.take_script(&LOOP.replace("  while", &watchdog));
        let (slot, _) = world.inputs.free("input_int_register_24", 1).unwrap();
        for cycle in 0..20 {
            run(&mut world, 40);
            world.inputs.set(slot, RtdeValue::Int32(cycle), world.robot.cycle);
        }
        assert_eq!(world.runtime(), Runtime::Playing, "{action}");
        run(&mut world, 52 + 110);
        assert_eq!(world.runtime(), after, "{action}");
    }
}

#[test]
fn outputs_of_a_program_are_not_undone_by_a_client_that_sets_the_slider() {
    let mut world = world();
    let set = |world: &mut World, name: &str, value: RtdeValue| {
        let (slot, _) = world.inputs.free(name, 1).unwrap();
        world.inputs.set(slot, value, 0);
        world.apply_input(name);
    };
    set(&mut world, "standard_digital_output_mask", RtdeValue::Uint8(1));
    set(&mut world, "standard_digital_output", RtdeValue::Uint8(1));
    assert_eq!(world.robot.digital_outputs, 1);
    world.take_script("set_digital_out(0, False)\n");
    run(&mut world, 2);
    set(&mut world, "speed_slider_mask", RtdeValue::Uint32(1));
    set(&mut world, "speed_slider_fraction", RtdeValue::Double(0.25));
    assert_eq!((world.robot.digital_outputs, world.robot.slider), (0, 0.25));
    set(&mut world, "speed_slider_fraction", RtdeValue::Double(f64::NAN));
    assert_eq!(world.robot.slider, 0.25);
}

#[test]
fn messages_that_nobody_takes_are_bounded() {
    let mut world = world();
    world.take_script("def t():\n  while True:\n    textmsg(\"x\")\n    sync()\n  end\nend\n");
    run(&mut world, 10 * MOST_MESSAGES);
    assert_eq!(world.messages.len(), MOST_MESSAGES);
}

#[test]
fn a_safeguard_stop_without_a_program_leaves_the_next_program_running() {
    let mut world = world();
    world.robot.safeguard_stop();
    run(&mut world, 10);
    world.take_script(LOOP);
    assert_eq!(world.runtime(), Runtime::Stopped);
    world.robot.safety.safeguard = false;
    world.take_script(LOOP);
    run(&mut world, 10);
    assert_eq!(world.runtime(), Runtime::Playing);
}

#[test]
fn a_button_that_is_pressed_stays_pressed_through_a_reboot() {
    let mut world = world();
    world.robot.emergency_stop();
    world.robot.safeguard_stop();
    run(&mut world, 100);
    world.reboot();
    world.power_on();
    run(&mut world, 600);
    assert_eq!((world.robot.mode, world.robot.safety.number()), (RobotMode::PowerOff, 7));
    world.robot.safety.emergency = false;
    world.power_on();
    run(&mut world, 600);
    assert_eq!((world.robot.mode, world.robot.safety.number()), (RobotMode::Idle, 5));
}

#[test]
fn violation_fault_recovery_and_backdrive_stop_the_program_until_an_operator_has_acted() {
    type Act = fn(&mut World);
    let stops: [(Act, i32, i32, Act); 4] = [
        (|w| w.robot.breach(SafetyBreach::Violation), 8, 3, World::restart_safety),
        (|w| w.robot.breach(SafetyBreach::Fault), 9, 3, World::restart_safety),
        (|w| w.robot.breach(SafetyBreach::Recovery), 4, 7, |w| w.robot.safety.breach = None),
        (|w| assert!(w.backdrive(true)), 1, 6, |w| assert!(w.backdrive(false))),
    ];
    for (stop, safety, mode, mend) in stops {
        let mut world = world();
        world.take_script("def s():\n  speedj([0.5,0,0,0,0,0], 2, 100)\nend\n");
        run(&mut world, 300);
        stop(&mut world);
        run(&mut world, 200);
        assert_eq!((world.robot.safety.number(), world.robot.mode.number()), (safety, mode));
        assert_eq!(world.runtime(), Runtime::Stopped, "{safety} {mode}");
        let stands = world.robot.actual();
        assert_eq!(stands.qd, [0.0; 6], "{safety} {mode}");
        world.take_script(LOOP);
        world.power_on();
        run(&mut world, 600);
        assert_eq!((world.runtime(), world.robot.actual()), (Runtime::Stopped, stands), "{safety} {mode}");
        assert_eq!(world.robot.mode.number(), mode);
        mend(&mut world);
        world.power_on();
        run(&mut world, 600);
        world.brake_release();
        run(&mut world, 600);
        assert!(world.robot.ready(), "{safety} {mode}");
        world.take_script(LOOP);
        assert_eq!(world.runtime(), Runtime::Playing);
    }
}

#[test]
fn in_local_control_no_line_of_a_client_is_obeyed() {
    for line in ["stop program", "pause program", "def other():\n  sync()\nend", "sec s():\n  stopj(2)\nend"]
    {
        let mut world = world();
        world.take_script(LOOP);
        world.remote = false;
        world.arrive(Arrival::read(line)).unwrap();
        run(&mut world, 100);
        assert_eq!((world.runtime(), world.program_name()), (Runtime::Playing, "p"), "{line}");
        assert!(texts(&mut world).contains("not in remote control"), "{line}");
    }
    let mut world = World::new(ControllerOptions { running: false, ..ControllerOptions::new(Series::E) });
    world.remote = false;
    world.take_script("set robotmode run");
    run(&mut world, 600);
    assert_eq!(world.robot.mode, RobotMode::PowerOff);
}

#[test]
fn one_program_is_looked_at_in_a_cycle_and_what_waits_is_bounded() {
    let mut world = world();
    let one = "sec s():\n  write_output_integer_register(0, read_output_integer_register(0) + 1)\nend\n";
    for _ in 0..MOST_ARRIVALS {
        world.arrive(Arrival::read(one)).unwrap();
    }
    assert!(world.arrive(Arrival::read(one)).is_err());
    for cycle in 1..=3 {
        run(&mut world, 1);
        assert_eq!(world.registers.integers[0], cycle);
    }
}

#[test]
fn calls_that_calculate_count_as_what_they_take() {
    // Of a pose out of reach all postures are looked at.
    let far = "def f():\n  i = 0\n  while i < 40:\n    \
               if get_inverse_kin_has_solution(p[3,0,0,0,3,0]):\n      halt\n    end\n    i = i + 1\n    \
               write_output_integer_register(0, i)\n  end\nend\n";
    let mut world = world();
    world.take_script(far);
    let mut before = 0;
    for _ in 0..100 {
        run(&mut world, 1);
        let calls = world.registers.integers[0] - before;
        assert!((0..=8).contains(&calls), "{calls} searches in a cycle");
        before += calls;
    }
    // Bounded, not refused.
    assert_eq!((before, world.runtime()), (40, Runtime::Stopped));
    assert_eq!(texts(&mut world).matches("RuntimeException").count(), 0);
}
