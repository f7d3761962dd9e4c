//! What the fit finds of arms that are known, with and without faulty joints.

use super::*;

const TICK_NS: u64 = 2_000_000;
const JOINTS: usize = 6;

/// A hand: sums of sines that no two joints share.
fn asked(joint: usize, t: f64) -> f64 {
    let (j, t) = (joint as f64, t.max(0.0));
    let begins = (t / 0.3).min(1.0);
    begins * (0.06 * ((7.0 + j) * t).sin() + 0.03 * ((17.0 - j) * t + j).sin())
}

/// An arm of servos integrated in small steps, behind a pure delay.
struct Arm {
    delay_s: f64,
    group_s: f64,
    damping: f64,
    joints: [[f64; 2]; JOINTS],
}

impl Arm {
    fn new(delay_s: f64, group_s: f64, damping: f64) -> Self {
        let joints = std::array::from_fn(|j| [asked(j, 0.0), 0.0]);
        Self { delay_s, group_s, damping, joints }
    }

    fn pass(&mut self, t: f64) {
        let w = 2.0 * self.damping / self.group_s;
        let h = 2e-3 / 40.0;
        for (j, [q, qd]) in self.joints.iter_mut().enumerate() {
            for step in 0..40 {
                let u = asked(j, t - 2e-3 + h * (f64::from(step) + 0.5) - self.delay_s);
                *qd += h * (w * w * (u - *q) - 2.0 * self.damping * w * *qd);
                *q += h * *qd;
            }
        }
    }
}

/// Shape found after 6 s, and the largest error of what was expected of a joint in the last three.
fn found(mut arm: Arm, odd: impl Fn(usize, f64) -> f64) -> (Shape, f64) {
    let (mut commands, mut joints, mut response) = (JointTrack::new(), JointTrack::new(), Response::new());
    let mut worst = 0.0_f64;
    for tick in 1..=3000_u64 {
        let (stamp, t) = (Stamp(tick * TICK_NS), tick as f64 * 2e-3);
        commands.push(stamp, &std::array::from_fn::<f64, JOINTS, _>(|j| asked(j, t)));
        arm.pass(t);
        let honest: [f64; JOINTS] = arm.joints.map(|[q, _]| q);
        joints.push(stamp, &std::array::from_fn::<f64, JOINTS, _>(|j| odd(j, honest[j])));
        if tick.is_multiple_of(5) {
            let k = tick / 5;
            response.add(k, joints.at(k).unwrap(), &commands, 1.0);
            if let (Some(expected), true) = (response.expected(), t > 3.0) {
                assert_eq!(expected.stamp, stamp);
                let errors = expected.q.iter().zip(honest).map(|(q, honest)| (q - honest).abs());
                worst = errors.fold(worst, f64::max);
            }
        }
    }
    (response.shape().expect("it moved enough"), worst)
}

#[test]
fn delay_and_damping_are_those_of_the_arm() {
    for (delay_s, group_s, damping) in [
        (0.0, 0.03, 1.0),
        (0.0, 0.03, 0.5),
        (0.0, 0.06, 0.45),
        (0.004, 0.008, 0.5),
        (0.07, 0.03, 1.0),
        (0.1, 0.03, 0.5),
        (0.15, 0.04, 0.6),
        (0.0, 0.146, 1.0),
    ] {
        let (shape, worst) = found(Arm::new(delay_s, group_s, damping), |_, q| q);
        let lag_s = shape.delay_s + shape.servo_s;
        assert!((lag_s - delay_s - group_s).abs() < 2e-3, "{delay_s} {group_s} {damping}: {shape:?}");
        // A servo faster than the grid, or behind a delay that is no candidate, stands for both.
        let shows = group_s > 0.02 && (delay_s == 0.0 || delay_s == 0.1);
        assert!(!shows || (shape.damping() - damping).abs() < 0.1, "{damping}: {shape:?}");
        assert!(worst < 2e-3, "{delay_s} {group_s} {damping}: {worst} rad off");
    }
}

/// One or two joints that do something else have no say in what is expected of them.
#[test]
fn odd_joints_do_not_explain_themselves() {
    type Odd = fn(usize, f64) -> f64;
    let cases: [(&str, Odd); 4] = [
        ("half as far", |j, q| if j == 0 { 0.5 * q } else { q }),
        ("turned about", |j, q| if j == 2 { -q } else { q }),
        ("two stand", |j, q| if j == 1 || j == 3 { 0.0 } else { q }),
        ("offset", |j, q| if j == 4 { q + 0.2 } else { q }),
    ];
    for (name, odd) in cases {
        for (delay_s, group_s, damping) in [(0.002, 0.03, 1.0), (0.1, 0.03, 0.6), (0.0, 0.1, 1.0)] {
            let (shape, worst) = found(Arm::new(delay_s, group_s, damping), odd);
            let lag_s = shape.delay_s + shape.servo_s;
            assert!((lag_s - delay_s - group_s).abs() < 3e-3, "{name}, {group_s}: {shape:?}");
            assert!(worst < 3e-3, "{name}, {delay_s} {group_s} {damping}: {worst} rad off");
        }
    }
}

#[test]
fn nothing_is_known_without_motion_or_after_a_break() {
    let (mut commands, mut response) = (JointTrack::<2>::new(), Response::<2>::new());
    for k in 1..400_u64 {
        commands.push(Stamp(k * GRID_NS), &[0.3, -0.4]);
        response.add(k.saturating_sub(1), &[0.3, -0.4], &commands, 0.0);
        assert_eq!((response.expected(), response.shape()), (None, None));
    }
    // Both joints swing as commanded.
    for k in 400..600_u64 {
        let q = [0.3 + 0.1 * (0.1 * k as f64).sin(), -0.4 + 0.1 * (0.13 * k as f64).sin()];
        commands.push(Stamp(k * GRID_NS), &q);
        if let Some(at) = commands.at(k - 1).copied() {
            response.add(k - 1, &at, &commands, 1.0);
        }
    }
    assert!(response.expected().is_some());
    response.break_off(0.1);
    assert_eq!((response.expected(), response.shape()), (None, None));
}

#[test]
fn a_servo_overshoots_a_step_by_what_its_damping_says_and_trails_a_ramp_by_its_group_delay() {
    for damping in [0.4_f64, 0.5, 0.7, 1.0, 2.0] {
        let servo = SecondOrder::damped(6.0, damping);
        let (mut state, mut most) = ([0.0, 0.0], 0.0_f64);
        state = servo.step(state, 1.0, 1.0);
        for _ in 0..400 {
            state = servo.step(state, 1.0, 1.0);
            most = most.max(state[0]);
        }
        let over = (-std::f64::consts::PI * damping / (1.0 - damping * damping).max(1e-9).sqrt()).exp();
        assert!((most - 1.0 - over).abs() < 0.03 * over + 1e-9, "{damping}: {most}");
        let mut state = [0.0, 0.0];
        for k in 0..400 {
            state = servo.step(state, f64::from(k), f64::from(k + 1));
        }
        assert!((400.0 - state[0] - 6.0).abs() < 1e-6 && (state[1] - 1.0).abs() < 1e-9, "{state:?}");
    }
    // No filter at all: with its target within a step or two, never beyond.
    let still = SecondOrder::new(0.0, 0.0);
    let [y, _] = still.step(still.step([0.0, 0.0], 1.0, 1.0), 1.0, 1.0);
    assert!((y - 1.0).abs() < 1.0 && y.is_finite());
}
