//! Claims about the robot: lag, limits, stops, slider, power.

use super::*;
use crate::controller::motion::Line;
use crate::controller::options::Series;

fn robot(series: Series) -> Robot {
    Robot::new(Options::new(series))
}

/// Runs `cycles`, checking the arm's limits in each; the largest acceleration of joint 0 \[rad/s²\].
fn run(robot: &mut Robot, cycles: u32) -> f64 {
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
    assert!(robot.steady() && robot.motion == Motion::Rest);
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
    robot.plan(|point| Motion::Line(Line::new(point.q, to, 1.0, 2.0, 0.0)));
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
    robot.plan(|_| Motion::Speed { qd: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], acceleration: 5.0, left: 10_000 });
    run(&mut robot, 300);
    assert!(robot.actual().qd[0] > 0.9);
    robot.emergency_stop();
    assert_eq!((robot.safety.number(), robot.safety.bits() & (1 << 7)), (7, 1 << 7));
    run(&mut robot, 100);
    assert_eq!(robot.mode, RobotMode::PowerOff);
    robot.safety.emergency = false;
    assert!(!robot.ready());
    robot.mode = RobotMode::PowerOn { until: None };
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
    robot.plan(|point| Motion::Line(Line::new(point.q, to, 1.0, 2.0, 0.0)));
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
