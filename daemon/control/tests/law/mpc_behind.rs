//! Plans behind a servo that is a filter: optimal by an independently written objective, inside the command's
//! limits, and better for the arm than plans that ignore the servo.

use foretrace_clarabel::ClarabelProfile;
use foretrace_control::mpc::{AxisLimits, Gains, Mpc, MpcSettings, Plan, SoftPenalty, Start};
use foretrace_control::qp::QpStatus;
use foretrace_control::qp::backend::Backend;
use foretrace_control::units::{AxisState, Trust};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const N: usize = 20;
const STEP_S: f64 = 0.005;
const SERVO_S: f64 = 0.030;
const CAP: u32 = 2000;

fn settings(jerk_mps3: f64, acceleration_mps2: f64) -> MpcSettings {
    let limits = AxisLimits { jerk_mps3, acceleration_mps2, velocity_mps: 2.0, position_m: [-0.3, 0.3] };
    MpcSettings {
        step_s: STEP_S,
        servo_s: SERVO_S,
        unlimited: false,
        gains_feedback: [Gains { position: 1.0, velocity: 3.5, acceleration: 0.0, decay: 1.0 }; 3],
        gains_feedforward: [Gains { position: 0.7, velocity: 0.1, acceleration: 0.05, decay: 0.95 }; 3],
        effort: 3.2,
        axes: [limits; 3],
        soft_penalty: SoftPenalty::DEFAULT,
        backend: Backend::Exact,
        max_iterations: CAP,
    }
}

struct Problem {
    start: Start,
    held: [AxisState; 3],
    preview: [[AxisState; N]; 3],
    trust: Trust,
}

fn problem(rng: &mut Pcg64Mcg) -> Problem {
    let mut axis = |reach: f64| AxisState {
        position: rng.random_range(-0.02..0.02),
        velocity: reach * rng.random_range(-0.3..0.3),
        acceleration: reach * rng.random_range(-4.0..4.0),
    };
    let command = [axis(1.0), axis(1.0), axis(1.0)];
    let arm = command.map(|state| {
        let away = axis(0.5);
        AxisState { position: state.position + 0.2 * away.position, ..away }
    });
    let held = [axis(0.0), axis(0.0), axis(0.0)];
    let preview = std::array::from_fn(|_| {
        let (size, omega, phase) =
            (rng.random_range(0.002..0.01), rng.random_range(5.0..30.0), rng.random_range(0.0..6.3));
        std::array::from_fn(|i| {
            let angle = omega * (i + 1) as f64 * STEP_S + phase;
            AxisState {
                position: size * f64::sin(angle),
                velocity: size * omega * f64::cos(angle),
                acceleration: -size * omega * omega * f64::sin(angle),
            }
        })
    });
    Problem { start: Start { command, arm }, held, preview, trust: Trust::new(rng.random_range(-0.3..1.3)) }
}

/// Command and arm after `dt` with ÿ = ω²(c − y) − 2ωẏ, by the Runge-Kutta method.
fn together(command: &AxisState, arm: [f64; 2], jerk: f64, dt: f64) -> (AxisState, [f64; 2]) {
    const PIECES: usize = 8;
    let omega = 2.0 / SERVO_S;
    let h = dt / PIECES as f64;
    let mut arm = arm;
    for piece in 0..PIECES {
        let rate = |t: f64, [y, v]: [f64; 2]| {
            let c = command.advanced(jerk, piece as f64 * h + t).position;
            [v, omega * omega * (c - y) - 2.0 * omega * v]
        };
        let plus = |a: [f64; 2], b: [f64; 2], by: f64| [a[0] + by * b[0], a[1] + by * b[1]];
        let k1 = rate(0.0, arm);
        let k2 = rate(0.5 * h, plus(arm, k1, 0.5 * h));
        let k3 = rate(0.5 * h, plus(arm, k2, 0.5 * h));
        let k4 = rate(h, plus(arm, k3, h));
        for (i, state) in arm.iter_mut().enumerate() {
            *state += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
        }
    }
    (command.advanced(jerk, dt), arm)
}

/// ½J of one axis from SI quantities, with the errors of the arm.
fn objective(settings: &MpcSettings, problem: &Problem, axis: usize, jerks: &[f64; N]) -> f64 {
    let omega = 2.0 / SERVO_S;
    let units = [1e3, 1e3 * STEP_S, 1e3 * STEP_S * STEP_S];
    let (feedback, feedforward) = (settings.gains_feedback[axis], settings.gains_feedforward[axis]);
    let error = |gains: &Gains, i: usize, from: &AxisState, to: &AxisState| {
        let decay = gains.decay.powi(i as i32);
        (gains.position * decay * (from.position - to.position) * units[0]).powi(2)
            + (gains.velocity * decay * (from.velocity - to.velocity) * units[1]).powi(2)
            + (gains.acceleration * decay * (from.acceleration - to.acceleration) * units[2]).powi(2)
    };
    let alpha = problem.trust.alpha();
    let mut command = problem.start.command[axis];
    let mut arm = [problem.start.arm[axis].position, problem.start.arm[axis].velocity];
    let mut sum = 0.0;
    for (i, jerk) in jerks.iter().enumerate() {
        (command, arm) = together(&command, arm, *jerk, STEP_S);
        let seen = AxisState {
            position: arm[0],
            velocity: arm[1],
            acceleration: omega * omega * (command.position - arm[0]) - 2.0 * omega * arm[1],
        };
        sum += 0.5 * (1.0 - alpha) * error(&feedback, i, &problem.held[axis], &seen);
        sum += 0.5 * alpha * error(&feedforward, i, &problem.preview[axis][i], &seen);
        sum += 0.5 * settings.effort * (jerk * units[2] * STEP_S).powi(2);
    }
    sum
}

#[test]
fn no_other_jerks_serve_the_arm_better() {
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    let settings = settings(1e5, 100.0);
    let mut mpc = Mpc::<N>::new(&settings).unwrap();
    let mut plan = Plan::resting(STEP_S);
    let mut nearly = 0;
    for _ in 0..60 {
        let problem = problem(&mut rng);
        let report =
            mpc.plan_behind(&problem.start, &problem.held, &problem.preview, problem.trust, CAP, &mut plan);
        assert!(report.axes.iter().all(|axis| axis.status == QpStatus::Optimal), "{report:?}");
        for axis in (0..3).filter(|axis| report.axes[*axis].active.total() == 0) {
            let best = objective(&settings, &problem, axis, &plan.jerks[axis]);
            for size in [1.0, 30.0, 300.0] {
                let other = plan.jerks[axis].map(|jerk| jerk + size * rng.random_range(-1.0..1.0));
                let worse = objective(&settings, &problem, axis, &other);
                assert!(worse >= best * (1.0 - 1e-7), "{worse} is better than {best}, {size} m/s³ away");
                nearly += i32::from(size == 1.0 && worse < best * 1.01);
            }
        }
    }
    assert!(nearly > 60, "neighbours so far off test no optimum: {nearly}");
}

#[test]
fn the_command_keeps_its_limits_and_clarabel_agrees() {
    let mut rng = Pcg64Mcg::seed_from_u64(12);
    let settings = settings(800.0, 6.0);
    let mut mpc = Mpc::<N>::new(&settings).unwrap();
    let mut clarabel =
        Mpc::<N>::new(&MpcSettings { backend: Backend::Other(&ClarabelProfile::Default), ..settings })
            .unwrap();
    let (mut plan, mut second) = (Plan::resting(STEP_S), Plan::resting(STEP_S));
    let (mut active, mut judged) = (0, 0);
    for _ in 0..150 {
        let problem = problem(&mut rng);
        let Problem { start, held, preview, trust } = &problem;
        let report = mpc.plan_behind(start, held, preview, *trust, CAP, &mut plan);
        let other = clarabel.plan_behind(start, held, preview, *trust, CAP, &mut second);
        for axis in 0..3 {
            assert_eq!(report.axes[axis].status, QpStatus::Optimal, "{:?}", report.axes[axis]);
            active += u32::from(report.axes[axis].active.total() > 0);
            assert!(plan.jerks[axis].iter().all(|jerk| jerk.abs() <= 800.0 * (1.0 + 1e-12)));
            if report.axes[axis].active.saturated > 0 || !other.usable() {
                continue;
            }
            judged += 1;
            let ours = objective(&settings, &problem, axis, &plan.jerks[axis]);
            let theirs = objective(&settings, &problem, axis, &second.jerks[axis]);
            assert!((ours / theirs - 1.0).abs() < 1e-4, "{ours}, Clarabel {theirs}");
        }
        for step in 1..=N {
            for (axis, state) in plan.state_at(step as f64 * STEP_S).unwrap().iter().enumerate() {
                let soft = report.axes[axis].active.saturated > 0;
                assert!(soft || state.acceleration.abs() <= 6.0 + 1e-6, "{state:?}");
            }
        }
    }
    assert!(active > 150 && judged > 150, "{active} with limits active, {judged} judged");
}

#[test]
fn a_servo_out_of_range_is_refused_with_the_value() {
    let bad = MpcSettings { servo_s: 2.0, ..settings(800.0, 6.0) };
    let error = Mpc::<N>::new(&bad).unwrap_err().to_string();
    assert_eq!(error, "MPC servo delay is 2 s, must be 0 or within [0.001, 1] s");
}
