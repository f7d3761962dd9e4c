//! Claims about threads that move the arm, programs that pause, and programs written for both series.

use super::options::{ControllerOptions, Series};
use super::world::{Runtime, World};

const OTHER: &str = "Another thread is already controlling the robot";

fn world(series: Series) -> World {
    World::new(ControllerOptions::new(series))
}

fn texts(world: &mut World) -> String {
    format!("{:?}", world.messages.drain(..).collect::<Vec<_>>())
}

fn run(world: &mut World, cycles: u32) {
    (0..cycles).for_each(|_| world.cycle());
}

#[test]
fn a_motion_of_a_second_thread_ends_the_program_without_a_protective_stop() {
    let slow = "movej([0, -1.5, 1.5, 0, 0, 0], a=0.5, v=0.2)";
    let loops = |call: &str| format!("while True:\n      {call}\n    end");
    for (one, two) in [
        (slow.to_owned(), "movej([1, -1.5, 1.5, 0, 0, 0])"),
        (slow.to_owned(), "movel(p[0.4, 0.1, 0.4, 0, 3, 0])"),
        (slow.to_owned(), "servoj(get_actual_joint_positions())"),
        (slow.to_owned(), "stopj(2)"),
        ("speedj([0.1, 0, 0, 0, 0, 0], 0.1, 3)".to_owned(), "stopl(2)"),
        (loops("servoj(get_target_joint_positions())"), "speedj([0.1, 0, 0, 0, 0, 0], 0.5, 0.1)"),
        (loops("servoj(get_target_joint_positions(), t=0.1)"), "movej([1, -1.5, 1.5, 0, 0, 0])"),
    ] {
        for series in [Series::Cb3, Series::E] {
            // Whichever of both is the program's own thread.
            for own_waits in [true, false] {
                let mut world = world(series);
                let (inside, outside) = if own_waits {
                    (one.clone(), format!("sleep(0.3)\n  {two}"))
                } else {
                    (format!("sleep(0.3)\n    {two}"), one.clone())
                };
                world.take_script(&format!(
                    "def two():\n  thread mover():\n    {inside}\n  end\n  run mover()\n  {outside}\n  \
                     sleep(1)\n  textmsg(\"went on\")\nend\n"
                ));
                run(&mut world, series.rate_hz());
                let said = texts(&mut world);
                let what = format!("{series:?} {own_waits} {one} {two}: {said}");
                assert_eq!(world.runtime(), Runtime::Stopped, "{what}");
                assert!(said.contains(OTHER) && !said.contains("went on"), "{what}");
                assert!(world.robot.ready() && world.robot.steady(), "{what}");
            }
        }
    }
}

#[test]
fn threads_that_move_the_arm_one_after_the_other_are_let() {
    for (what, text) in [
        ("a motion that is over", "run mover()\n  sleep(1.5)\n  movej([0.1, -1.5, 1.5, 0, 0, 0])"),
        ("a thread that is awaited", "t = run mover()\n  join t\n  movej([0.1, -1.5, 1.5, 0, 0, 0])"),
        ("a thread that is killed", "t = run mover()\n  sleep(0.1)\n  kill t\n  stopj(5)\n  movej(here)"),
        ("a servo that is killed", "t = run servo()\n  sleep(0.1)\n  kill t\n  stopj(5)\n  movej(here)"),
        ("a servo that stops itself", "t = run servo()\n  sleep(0.1)\n  on = False\n  sync()\n  stopj(5)"),
        ("calls in turn", "run servo()\n  sleep(0.1)\n  on = False\n  join_me = 1\n  sleep(0.1)\n  stopj(5)"),
    ] {
        for series in [Series::Cb3, Series::E] {
            let mut world = world(series);
            world.take_script(&format!(
                "def turns():\n  global on = True\n  global here = get_actual_joint_positions()\n  \
                 thread mover():\n    movej([0, -1.5, 1.5, 0, 0, 0], a=10, v=3)\n  end\n  \
                 thread servo():\n    while on:\n      servoj(here)\n    end\n  end\n  \
                 {text}\n  textmsg(\"came by\")\nend\n"
            ));
            run(&mut world, 20 * series.rate_hz());
            let said = texts(&mut world);
            assert!(
                said.contains("came by") && !said.contains("RuntimeException"),
                "{series:?} {what}: {said}"
            );
        }
    }
}

#[test]
fn pause_holds_the_program_until_it_is_played() {
    for series in [Series::Cb3, Series::E] {
        let mut world = world(series);
        world.take_script(
            "def p():\n  thread beside():\n    while True:\n      write_output_integer_register(0, \
             read_output_integer_register(0) + 1)\n      sync()\n    end\n  end\n  run beside()\n  \
             sync()\n  textmsg(\"before\")\n  pause\n  textmsg(\"after\")\n  sync()\nend\n",
        );
        run(&mut world, series.rate_hz());
        let said = texts(&mut world);
        assert!(said.contains("before") && !said.contains("after"), "{said}");
        assert_eq!(world.runtime(), Runtime::Paused);
        let counted = world.registers.integers[0];
        run(&mut world, 50);
        // A thread beside it stands, too.
        assert_eq!(world.registers.integers[0], counted);
        assert!(world.play());
        run(&mut world, series.rate_hz());
        assert!(texts(&mut world).contains("after"));
        assert_eq!(world.runtime(), Runtime::Stopped);
    }
}

#[test]
fn a_secondary_program_does_not_pause_the_program_beside_it() {
    let mut world = world(Series::E);
    world.take_script("def p():\n  while True:\n    sync()\n  end\nend\n");
    world.take_script("sec s():\n  pause\nend\n");
    run(&mut world, 500);
    assert_eq!(world.runtime(), Runtime::Playing);
    assert!(texts(&mut world).contains("a secondary program cannot pause"));
}

/// A program of our own with the calls of the maker's external control: for a CB3 some stand unguarded or
/// behind a guard that looks when it runs.
const FOR_BOTH: &str = "def both():\n  def scale(gain):\n    if get_steptime() < 0.005:\n      \
    force_mode_set_gain_scaling(gain)\n    end\n  end\n  def touch():\n    return tool_contact(\
    direction=get_actual_tcp_speed())\n  end\n  def sensor(on):\n    ft_rtde_input_enable(on)\n  end\n  \
    scale(0.5)\n  textmsg(\"loaded\")\n";

#[test]
fn a_program_for_both_series_loads_and_what_this_one_cannot_do_fails_when_it_is_called() {
    for series in [Series::Cb3, Series::E] {
        let mut world = world(series);
        world.take_script(&format!("{FOR_BOTH}end\n"));
        run(&mut world, 20);
        let said = texts(&mut world);
        assert!(said.contains("loaded") && !said.contains("RuntimeException"), "{series:?}: {said}");
        for call in ["touch()", "sensor(True)"] {
            world.take_script(&format!("{FOR_BOTH}  {call}\n  textmsg(\"went on\")\nend\n"));
            run(&mut world, 20);
            let said = texts(&mut world);
            assert!(
                said.contains("is not simulated") && !said.contains("went on"),
                "{series:?} {call}: {said}"
            );
        }
    }
    let mut world = world(Series::Cb3);
    world.take_script("def s():\n  force_mode_set_gain_scaling(0.5)\n  textmsg(\"went on\")\nend\n");
    run(&mut world, 20);
    assert!(!texts(&mut world).contains("went on"));
}
