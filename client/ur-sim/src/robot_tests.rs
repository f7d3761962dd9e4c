//! Claims about the robot: lag, limits, stops, slider, power.

use super::*;
use crate::motion::Trapezoid;
use crate::options::Series;

fn robot(series: Series) -> SimulatedRobot {
    SimulatedRobot::new(ControllerOptions::new(series))
}

/// Runs `cycles`, checking the arm's limits in each; the largest acceleration of joint 0 \[rad/s²\].
fn run(robot: &mut SimulatedRobot, cycles: u32) -> f64 {
    let mut hardest = 0.0f64;
    for _ in 0..cycles {
        let before = robot.actual();
        robot.step();
        let after = robot.actual();
        for joint in 0..6 {
            assert!(after.qd[joint].abs() <= SPEED_LIMIT_RADPS + 1e-9, "{after:?}");
            let a = (after.qd[joint] - before.qd[joint]).abs() / robot.dt();
            assert!(a <= 40.0 + 1e-6, "{a}");
            hardest = hardest.max(a);
        }
    }
    hardest
}

#[test]
fn servoj_is_late_by_its_look_ahead_and_4_ms_at_500_hz() {
    let mut robot = robot(Series::E);
    let home = robot.target.q;
    let mut gap = 0.0;
    for cycle in 0..1500u32 {
        let mut target = home;
        target[0] += 0.2 * f64::from(cycle) * robot.dt();
        robot.servo(target, 0.030);
        robot.step();
        // Joints at this cycle's end against the target for its beginning.
        gap = target[0] + 0.2 * robot.dt() - robot.actual().q[0];
    }
    let lag_ms = gap / 0.2 * 1e3;
    assert!((lag_ms - 34.0).abs() < 0.1, "{lag_ms}");
    assert!(robot.ready());
}

#[test]
fn a_sudden_change_stops_protectively_and_is_unlocked_after_5_s_only() {
    for series in [Series::Cb3, Series::E] {
        let mut robot = robot(series);
        let mut target = robot.target.q;
        target[1] += 0.3;
        robot.servo(target, 0.030);
        robot.step();
        assert_eq!((robot.safety.number(), robot.safety.bits()), (3, 1 << 2 | 1 << 10));
        assert_eq!(robot.safety.protective().unwrap().code(), (204, 1));
        assert!(robot.safety.unlock(robot.cycle).is_err());
        run(&mut robot, 5 * series.rate_hz());
        assert!(robot.safety.unlock(robot.cycle).is_ok() && robot.ready());
    }
}

#[test]
fn targets_that_are_no_numbers_stop_protectively() {
    let mut robot = robot(Series::E);
    robot.servo([f64::NAN; 6], 0.03);
    run(&mut robot, 10);
    assert_eq!(robot.safety.number(), 3);
    assert!(robot.actual().q.iter().all(|q| q.is_finite()));
}

#[test]
fn a_stop_amid_a_servo_motion_is_gentle_and_comes_to_rest() {
    let mut robot = robot(Series::E);
    let home = robot.target.q;
    for cycle in 0..500u32 {
        let mut target = home;
        target[0] += 1.0 * f64::from(cycle) * robot.dt();
        robot.servo(target, 0.030);
        run(&mut robot, 1);
    }
    let moving = robot.actual().q[0];
    robot.brake(4.0);
    let hardest = run(&mut robot, 200);
    assert!(robot.stands() && robot.motion == RobotMotion::Rest);
    // v²/2a = 0.125 rad; no jump to the target that was 34 ms ahead.
    let way = robot.actual().q[0] - moving;
    assert!((way - 0.125).abs() < 0.01 && hardest < 8.0, "{way} {hardest}");
}

#[test]
fn slider_slows_movej_down_and_shows() {
    let mut robot = robot(Series::Cb3);
    robot.slider = 0.5;
    run(&mut robot, 50);
    assert_eq!(robot.speed_scaling, 0.5);
    let from = robot.target.q;
    let mut to = from;
    to[0] += 1.0;
    robot.plan(|point| RobotMotion::Line(Trapezoid::new(point.q, to, 1.0, 2.0, 0.0)));
    let mut fastest = 0.0f64;
    for _ in 0..400 {
        run(&mut robot, 1);
        fastest = fastest.max(robot.actual().qd[0]);
    }
    assert!((fastest - 0.5).abs() < 1e-3 && (robot.actual().q[0] - to[0]).abs() < 1e-6, "{fastest}");
}

#[test]
fn an_emergency_stop_brakes_and_takes_the_power() {
    let mut robot = robot(Series::E);
    robot.plan(|_| RobotMotion::Speed {
        qd: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        acceleration: 5.0,
        left: 10_000,
    });
    run(&mut robot, 300);
    assert!(robot.actual().qd[0] > 0.9);
    robot.emergency_stop();
    // Let go of at once: it still brakes, and takes the power.
    robot.safety.emergency = false;
    assert_eq!((robot.safety.number(), robot.safety.bits() & (1 << 7)), (7, 1 << 7));
    run(&mut robot, 100);
    assert_eq!((robot.mode, robot.safety.number()), (RobotMode::PowerOff, 1));
    assert!(!robot.ready());
    robot.mode = RobotMode::PowerOn { until: None, release: false };
    run(&mut robot, 260);
    assert_eq!(robot.mode, RobotMode::Idle);
    robot.mode = RobotMode::Releasing { until: None };
    run(&mut robot, 260);
    assert!(robot.ready());
}

#[test]
fn a_pause_stands_still_and_goes_on() {
    let mut robot = robot(Series::E);
    let mut to = robot.target.q;
    to[2] += 0.5;
    robot.plan(|point| RobotMotion::Line(Trapezoid::new(point.q, to, 1.0, 2.0, 0.0)));
    run(&mut robot, 100);
    robot.paused = true;
    run(&mut robot, 200);
    let stands = robot.actual();
    run(&mut robot, 100);
    assert!(robot.speed_scaling == 0.0 && robot.actual() == stands && robot.target.q != to);
    robot.paused = false;
    run(&mut robot, 1000);
    assert!((robot.actual().q[2] - to[2]).abs() < 1e-6);
}

/// Joint 0 at 1 rad/s.
fn moving(series: Series) -> SimulatedRobot {
    let mut robot = robot(series);
    robot.plan(|_| RobotMotion::Speed {
        qd: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        acceleration: 5.0,
        left: 10_000,
    });
    run(&mut robot, 500);
    assert!((robot.actual().qd[0] - 1.0).abs() < 1e-3);
    robot
}

/// Cycles until the target stands.
fn until_rest(robot: &mut SimulatedRobot) -> u32 {
    (1..5000)
        .find(|_| {
            run(robot, 1);
            robot.motion == RobotMotion::Rest
        })
        .expect("it comes to rest")
}

#[test]
fn a_safety_stop_is_never_softer_than_a_stop_that_is_going_on() {
    for stop in [SimulatedRobot::emergency_stop, |robot: &mut SimulatedRobot| {
        robot.protective_stop(ProtectiveReason::Asked)
    }] {
        let mut soft = moving(Series::E);
        soft.brake(0.5);
        run(&mut soft, 10);
        stop(&mut soft);
        // 1 rad/s at 20 rad/s² is 25 cycles.
        assert!(until_rest(&mut soft) <= 26);
        let mut hard = moving(Series::E);
        hard.brake(40.0);
        run(&mut hard, 1);
        stop(&mut hard);
        assert!(until_rest(&mut hard) <= 13);
    }
}

#[test]
fn an_emergency_stop_takes_the_power_of_an_arm_that_does_not_stand_and_of_one_that_powers_up() {
    let mut runaway = robot(Series::E);
    runaway.break_now(FaultKind::Runaway(1.0));
    runaway.step();
    runaway.emergency_stop();
    let cycles = (1..5000).find(|_| {
        runaway.step();
        runaway.mode == RobotMode::PowerOff
    });
    assert_eq!(cycles, Some(250), "half a second");
    let stands = runaway.actual();
    runaway.step();
    assert_eq!((runaway.actual(), stands.qd), (stands, [0.0; 6]));

    let mut releasing = robot(Series::E);
    releasing.mode = RobotMode::Releasing { until: None };
    releasing.emergency_stop();
    run(&mut releasing, 2000);
    assert_eq!((releasing.mode, releasing.safety.number()), (RobotMode::PowerOff, 7));
}

/// Streams a target at `speed_radps` to joint 0 until a protective stop; after how many cycles, of at most
/// `most`.
fn until_deviation(
    robot: &mut SimulatedRobot,
    target: &mut [f64; 6],
    speed_radps: f64,
    most: u32,
) -> Option<u32> {
    (0..most).find(|_| {
        target[0] += speed_radps * robot.dt();
        robot.servo(*target, 0.030);
        // A broken arm keeps no limits.
        robot.step();
        robot.safety.protective() == Some(ProtectiveReason::Deviation)
    })
}

#[test]
fn a_slower_slider_does_not_hide_an_arm_that_stands_and_stops_none_that_is_only_slower() {
    for slider in [1.0, 0.5] {
        let mut robot = robot(Series::E);
        robot.slider = slider;
        run(&mut robot, 200);
        let mut target = robot.target.q;
        assert_eq!(until_deviation(&mut robot, &mut target, 0.5, 500), None, "{slider}");
        robot.break_now(FaultKind::Stuck);
        assert!(until_deviation(&mut robot, &mut target, 0.5, 1000).is_some(), "{slider}");
    }
    // At half speed joints do 1.67 rad/s: it falls behind by a radian, as a sound arm does.
    let mut slow = robot(Series::E);
    slow.slider = 0.5;
    run(&mut slow, 200);
    let mut target = slow.target.q;
    assert_eq!(until_deviation(&mut slow, &mut target, 2.2, 1000), None);
    assert!(target[0] - slow.actual().q[0] > 0.8);
}

#[test]
fn slow_and_paused_arms_fall_behind_and_are_reported() {
    for kind in [FaultKind::Slow(0.05), FaultKind::Paused] {
        let mut robot = robot(Series::E);
        let mut target = robot.target.q;
        assert_eq!(until_deviation(&mut robot, &mut target, 1.0, 200), None);
        robot.break_now(kind);
        assert!(until_deviation(&mut robot, &mut target, 1.0, 1000).is_some(), "{kind:?}");
        assert!(target[0] - robot.actual().q[0] > 0.4, "{kind:?}");
    }
}

#[test]
fn an_arm_stays_broken_through_power_and_reboot_until_it_is_mended() {
    let mut robot = robot(Series::E);
    robot.break_now(FaultKind::Stuck);
    run(&mut robot, 10);
    let stuck = robot.actual().q;
    let lead = |robot: &mut SimulatedRobot| {
        robot.mode = RobotMode::Running;
        let mut to = robot.target.q;
        to[0] += 0.2;
        robot.plan(|point| RobotMotion::Line(Trapezoid::new(point.q, to, 1.0, 2.0, 0.0)));
        run(robot, 1000);
        robot.actual().q[0] - stuck[0]
    };
    robot.power_off();
    run(&mut robot, 10);
    assert_eq!(lead(&mut robot), 0.0);
    robot.reboot();
    assert_eq!((robot.mode, robot.timestamp()), (RobotMode::PowerOff, 0.0));
    assert_eq!(lead(&mut robot), 0.0);
    robot.mend();
    run(&mut robot, 100);
    assert!((lead(&mut robot) - 0.2).abs() < 1e-6, "{:?}", robot.actual());
}

#[test]
fn the_tools_angular_velocity_is_that_of_the_joint_that_turns_it() {
    // At home the tool points down: its rotation vector is half a turn long and changes its sign.
    let mut robot = robot(Series::E);
    robot.tcp_offset = [0.0, 0.0, 0.15, 0.0, 0.0, 0.0];
    robot.plan(|_| RobotMotion::Speed {
        qd: [0.0, 0.0, 0.0, 0.0, 0.0, 0.5],
        acceleration: 5.0,
        left: 10_000,
    });
    run(&mut robot, 1);
    let (target, actual) = (robot.tcp_speed(&robot.target), robot.tcp_speed(&robot.actual()));
    assert!(target[5].abs() > 1.5 * actual[5].abs(), "{target:?} {actual:?}");
    run(&mut robot, 500);
    for _ in 0..2500 {
        run(&mut robot, 1);
        let [x, y, z, rx, ry, rz] = robot.tcp_speed(&robot.actual());
        assert!((x * x + y * y + z * z).sqrt() < 1e-6, "{x} {y} {z}");
        // The axis of the last joint points down.
        assert!(rx.abs() < 1e-3 && ry.abs() < 1e-3 && (rz + 0.5).abs() < 1e-3, "{rx} {ry} {rz}");
    }
}

#[test]
fn an_arm_is_steady_half_a_second_after_it_stands() {
    for series in [Series::Cb3, Series::E] {
        let mut robot = robot(series);
        assert!(robot.steady());
        let here = robot.target.q;
        let mut to = here;
        to[0] += 0.1;
        robot.plan(|point| RobotMotion::Line(Trapezoid::new(point.q, to, 1.0, 2.0, 0.0)));
        robot.step();
        assert!(!robot.steady());
        let stood = (0..).find(|_| {
            robot.step();
            robot.stands() && robot.target.qd.iter().all(|qd| *qd == 0.0)
        });
        assert!(stood.is_some());
        let steady = (0..5000).find(|_| {
            assert!(robot.stands());
            robot.step();
            robot.steady()
        });
        let waited = (f64::from(steady.unwrap()) + 2.0) * robot.dt();
        assert!((waited - 0.5).abs() < 2.0 * robot.dt(), "{series:?}: {waited}");
        // A servo that holds its target is steady; one that creeps is not.
        for _ in 0..series.rate_hz() {
            robot.servo(to, 0.1);
            robot.step();
        }
        assert!(robot.steady());
        for _ in 0..series.rate_hz() {
            to[0] += 1e-6;
            robot.servo(to, 0.1);
            robot.step();
        }
        assert!(!robot.steady());
    }
}
