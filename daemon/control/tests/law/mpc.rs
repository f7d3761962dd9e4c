//! The MPC: model, optimality, limits, trust, hostile input.

use foretrace_clarabel::ClarabelProfile;
use foretrace_control::mpc::condense::Condensed;
use foretrace_control::mpc::model::{MotionRows, Scale, adjoint, rollout};
use foretrace_control::mpc::{AxisLimits, Gains, Mpc, MpcError, MpcSettings, Plan, SoftPenalty, SolvePath};
use foretrace_control::qp::backend::Backend;
use foretrace_control::qp::{KKT_TOLERANCE, QpStatus};
use foretrace_control::units::{AxisState, Trust};

const N: usize = 10;

fn limits() -> AxisLimits {
    AxisLimits { jerk_mps3: 800.0, acceleration_mps2: 12.0, velocity_mps: 1.0, position_m: [-0.2, 0.2] }
}

fn settings() -> MpcSettings {
    let gains = Gains { position: 1.0, velocity: 0.5, acceleration: 0.05, decay: 1.0 };
    MpcSettings {
        step_s: 0.01,
        gains_feedback: [gains; 3],
        gains_feedforward: [gains; 3],
        effort: 0.01,
        axes: [limits(); 3],
        soft_penalty: SoftPenalty::DEFAULT,
        backend: Backend::Exact,
        max_iterations: 200,
        servo_s: 0.0,
        unlimited: false,
    }
}

fn at_rest(position: f64) -> [AxisState; 3] {
    [AxisState::at_rest(position); 3]
}

#[test]
fn plan_is_zero_when_already_at_target() {
    let mut mpc = Mpc::<N>::new(&settings()).unwrap();
    for trust in [Trust::NONE, Trust::new(0.3), Trust::FULL] {
        let mut plan = Plan::resting(0.01);
        let there = at_rest(0.05);
        let preview = [[AxisState::at_rest(0.05); N]; 3];
        let report = mpc.plan(&there, &there, &preview, trust, 200, &mut plan);
        assert!(report.usable());
        assert!(report.axes.iter().all(|axis| axis.path == SolvePath::Gain && axis.iterations == 0));
        assert_eq!(plan.jerks, [[0.0; N]; 3]);
        assert_eq!(plan.state_at(0.05), Some(there));
    }
}

#[test]
fn a_far_target_is_approached_at_the_limits_and_inside_them() {
    let mut mpc = Mpc::<N>::new(&with_default_gains()).unwrap();
    for target in [0.1, -0.15] {
        let mut plan = Plan::resting(0.01);
        let preview = [[AxisState::at_rest(target); N]; 3];
        let report = mpc.plan(&at_rest(0.0), &at_rest(target), &preview, Trust::FULL, 200, &mut plan);
        for axis in &report.axes {
            assert_eq!(axis.status, QpStatus::Optimal, "{axis:?}");
            assert_eq!(axis.path, SolvePath::ActiveSet);
            assert!(axis.kkt_residual <= KKT_TOLERANCE);
            assert!(axis.active.acceleration > 0 && axis.active.saturated == 0, "{axis:?}");
        }
        for jerks in &plan.jerks {
            assert!(jerks.iter().all(|jerk| jerk.abs() <= 800.0 * (1.0 + 1e-15)), "{jerks:?}");
        }
        for step in 1..=N {
            for state in plan.state_at(step as f64 * 0.01).unwrap() {
                // 1e-9 of the normalised units, 1 m/s² being 0.1 of them.
                assert!(state.acceleration.abs() <= 12.0 + 1e-7 && state.velocity.abs() <= 1.0 + 1e-8);
            }
        }
    }
}

#[test]
fn condensed_model_matches_the_rolled_out_one() {
    let condensed = Condensed::<N>::new();
    let start = [3.0, -2.0, 0.7];
    let jerks: [f64; N] = std::array::from_fn(|i| ((i * 7 + 3) % 11) as f64 * 0.1 - 0.5);
    let motion = rollout(&start, &jerks);
    for i in 0..N {
        for (quantity, block) in [3, 2, 1].into_iter().enumerate() {
            let free: f64 = (0..3).map(|k| condensed.free[i][quantity][k] * start[k]).sum();
            let forced: f64 = (0..N).map(|j| condensed.forced[quantity][i][j] * jerks[j]).sum();
            assert!((motion[block][i] - free - forced).abs() < 1e-12, "step {i}, quantity {quantity}");
        }
    }
    let force: MotionRows<N> =
        std::array::from_fn(|b| std::array::from_fn(|i| (b * 10 + i) as f64 * 0.01 - 0.1));
    let gradient = adjoint(&force);
    for (j, entry) in gradient.iter().enumerate() {
        let mut expected = force[0][j];
        for (quantity, block) in [3, 2, 1].into_iter().enumerate() {
            expected += (0..N).map(|i| condensed.forced[quantity][i][j] * force[block][i]).sum::<f64>();
        }
        assert!((entry - expected).abs() < 1e-12);
    }
}

#[test]
fn one_step_matches_the_hand_worked_number() {
    // Δ = 0.01 s, from rest, 600 m/s³ for one step: 600·1e-6/6 = 1e-4 m, 0.03 m/s, 6 m/s².
    let scale = Scale::new(0.01);
    let [_, [a], [v], [p]] = rollout(&[0.0; 3], &[600.0 * scale.jerk]);
    assert!((p / scale.position - 1e-4).abs() < 1e-18);
    assert!((v / scale.velocity - 0.03).abs() < 1e-16);
    assert!((a / scale.acceleration - 6.0).abs() < 1e-13);
}

#[test]
fn settings_outside_their_range_are_refused_with_the_value() {
    let mut bad = settings();
    bad.axes[1].jerk_mps3 = -800.0;
    let error = Mpc::<N>::new(&bad).unwrap_err();
    assert!(matches!(error, MpcError::Limit { axis: 1, quantity: "jerk", value: -800.0, .. }));
    assert_eq!(error.to_string(), "MPC jerk limit of axis 1 is -800 m/s³, must be within [1, 100000] m/s³");
}

fn state(position: f64, velocity: f64, acceleration: f64) -> AxisState {
    AxisState { position, velocity, acceleration }
}

/// A wave that starts at the origin and reaches no limit.
fn gentle_preview() -> [[AxisState; N]; 3] {
    std::array::from_fn(|axis| {
        std::array::from_fn(|i| {
            let phase = (i + 1) as f64 * 0.1 + axis as f64;
            state(0.002 * phase.sin(), 0.02 * phase.cos(), 0.0)
        })
    })
}

fn with_default_gains() -> MpcSettings {
    MpcSettings {
        gains_feedback: [Gains::FEEDBACK; 3],
        gains_feedforward: [Gains::FEEDFORWARD; 3],
        effort: Gains::EFFORT,
        ..settings()
    }
}

#[test]
fn equal_gains_give_the_same_plan_as_gains_refactored_at_every_alpha() {
    // A feedforward gain one ulp away takes the path that factors H anew.
    let mut other = settings();
    for gains in &mut other.gains_feedforward {
        gains.position = gains.position.next_up();
    }
    let (mut constant, mut refactored) =
        (Mpc::<N>::new(&settings()).unwrap(), Mpc::<N>::new(&other).unwrap());
    let preview = gentle_preview();
    for k in 0..50 {
        let trust = Trust::new(f64::from(k) / 49.0);
        let (mut one, mut two) = (Plan::resting(0.01), Plan::resting(0.01));
        let far = at_rest(0.001 * f64::from(k));
        assert!(constant.plan(&at_rest(0.0), &far, &preview, trust, 200, &mut one).usable());
        assert!(refactored.plan(&at_rest(0.0), &far, &preview, trust, 200, &mut two).usable());
        for (a, b) in one.jerks.as_flattened().iter().zip(two.jerks.as_flattened()) {
            // 1e-16 in a gain, amplified by the condition of H, about 1e6; jerk limit 800 m/s³.
            assert!((a - b).abs() < 1e-5, "{a} against {b} at {trust:?}");
        }
    }
}

#[test]
fn a_trust_ramp_moves_the_jerk_in_proportion_to_its_step() {
    let mut mpc = Mpc::<N>::new(&with_default_gains()).unwrap();
    let preview = gentle_preview();
    for held in [at_rest(0.004), at_rest(0.05)] {
        let largest_change = |mpc: &mut Mpc<N>, steps: u32| {
            let mut previous: Option<f64> = None;
            let mut largest = 0.0_f64;
            for k in 0..=steps {
                let mut plan = Plan::resting(0.01);
                let trust = Trust::new(f64::from(k) / f64::from(steps));
                assert!(mpc.plan(&at_rest(0.0), &held, &preview, trust, 200, &mut plan).usable());
                let jerk = plan.jerks[0][0];
                largest = largest.max(previous.map_or(0.0, |previous| (jerk - previous).abs()));
                previous = Some(jerk);
            }
            largest
        };
        let (coarse, fine) = (largest_change(&mut mpc, 100), largest_change(&mut mpc, 1000));
        assert!(coarse > 0.0 && fine < 0.2 * coarse, "{fine} after {coarse}");
    }
}

#[test]
fn poisoned_input_fails_and_leaves_the_old_plan() {
    let mut mpc = Mpc::<N>::new(&with_default_gains()).unwrap();
    let good = (at_rest(0.0), at_rest(0.01), gentle_preview());
    let before = Plan::<N>::resting(0.01);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300] {
        for place in 0..9 {
            let (mut start, mut held, mut preview) = good;
            let target = match place / 3 {
                0 => &mut start[1],
                1 => &mut held[1],
                _ => &mut preview[1][4],
            };
            match place % 3 {
                0 => target.position = bad,
                1 => target.velocity = bad,
                _ => target.acceleration = bad,
            }
            let mut plan = before;
            let report = mpc.plan(&start, &held, &preview, Trust::new(0.5), 200, &mut plan);
            if bad.is_finite() {
                // An acceleration with zero gain may have any finite value.
                assert!(report.usable() == (plan != before) || place % 3 == 2, "{report:?}");
            } else {
                assert_eq!(report.axes[1].status, QpStatus::NotFinite, "{bad} at {place}");
                assert_eq!(report.axes[1].path, SolvePath::Failed);
                assert!(report.kkt_residual().is_nan());
                assert!(!report.usable());
            }
            if !report.usable() {
                assert_eq!(plan, before);
            }
            assert!(plan.jerks.as_flattened().iter().all(|jerk| jerk.abs() <= 800.0 * (1.0 + 1e-15)));
        }
    }
    let mut plan = before;
    assert!(
        mpc.plan(&good.0, &good.1, &good.2, Trust::FULL, 200, &mut plan).usable(),
        "poison leaves no trace"
    );
}

#[test]
fn at_trust_zero_a_broken_preview_is_not_even_read() {
    let mut mpc = Mpc::<N>::new(&with_default_gains()).unwrap();
    let broken = [[state(f64::NAN, f64::NAN, f64::NAN); N]; 3];
    let (mut with, mut without) = (Plan::resting(0.01), Plan::resting(0.01));
    assert!(mpc.plan(&at_rest(0.0), &at_rest(0.01), &broken, Trust::NONE, 200, &mut with).usable());
    assert!(
        mpc.plan(&at_rest(0.0), &at_rest(0.01), &gentle_preview(), Trust::NONE, 200, &mut without).usable()
    );
    assert_eq!(with, without);
}

#[test]
fn a_start_outside_every_soft_limit_still_has_a_best_plan() {
    let mut mpc = Mpc::<N>::new(&with_default_gains()).unwrap();
    let outside = [state(0.25, 1.5, 0.0), state(-0.3, -2.0, -20.0), state(0.19, 0.9, 15.0)];
    let mut plan = Plan::resting(0.01);
    let report = mpc.plan(&outside, &at_rest(0.0), &gentle_preview(), Trust::NONE, 300, &mut plan);
    for axis in &report.axes {
        assert_eq!(axis.status, QpStatus::Optimal, "{axis:?}");
        assert!(axis.active.saturated > 0);
    }
    assert!(plan.jerks[0][0] <= -800.0 * (1.0 - 1e-12), "brakes with all it has: {:?}", plan.jerks[0]);
}

#[test]
fn the_iteration_budget_is_kept_and_reported() {
    let mut mpc = Mpc::<N>::new(&with_default_gains()).unwrap();
    let before = Plan::resting(0.01);
    let mut plan = before;
    let report = mpc.plan(&at_rest(0.0), &at_rest(0.15), &gentle_preview(), Trust::NONE, 3, &mut plan);
    for axis in &report.axes {
        assert_eq!((axis.status, axis.iterations), (QpStatus::IterationCap, 3));
    }
    assert_eq!(plan, before);
}

#[test]
fn plan_states_follow_the_jerks_and_end_with_the_horizon() {
    let mut plan = Plan::<3>::resting(0.01);
    plan.start = [state(0.01, 0.1, -1.0); 3];
    plan.jerks = [[100.0, -200.0, 50.0]; 3];
    let at_step = plan.start[0].advanced(100.0, 0.01);
    let expected = at_step.advanced(-200.0, 0.004);
    let found = plan.state_at(0.014).unwrap()[0];
    assert!((found.position - expected.position).abs() < 1e-17);
    assert!((found.velocity - expected.velocity).abs() < 1e-15);
    assert!((found.acceleration - expected.acceleration).abs() < 1e-12);
    let end = plan.state_at(plan.duration_s()).unwrap()[0];
    let expected = at_step.advanced(-200.0, 0.01).advanced(50.0, 0.01);
    assert!((end.position - expected.position).abs() < 1e-16);
    assert_eq!(plan.state_at(0.0), Some(plan.start));
    for outside in [-1e-9, 0.0300001, f64::NAN, f64::INFINITY] {
        assert_eq!(plan.state_at(outside), None);
    }
}

#[test]
fn clarabel_as_backend_agrees_where_no_limit_is_active_and_is_usable_where_some_are() {
    for profile in [&ClarabelProfile::Default, &ClarabelProfile::Tuned] {
        let mut exact = Mpc::<N>::new(&with_default_gains()).unwrap();
        let mut clarabel =
            Mpc::<N>::new(&MpcSettings { backend: Backend::Other(profile), ..with_default_gains() }).unwrap();
        for (target, tolerance) in [(0.001, 1e-3), (0.03, 0.1)] {
            let (mut one, mut two) = (Plan::resting(0.01), Plan::resting(0.01));
            let preview = gentle_preview();
            assert!(
                exact.plan(&at_rest(0.0), &at_rest(target), &preview, Trust::NONE, 200, &mut one).usable()
            );
            let report = clarabel.plan(&at_rest(0.0), &at_rest(target), &preview, Trust::NONE, 200, &mut two);
            assert!(report.usable(), "{report:?}");
            assert!(report.axes.iter().all(|axis| axis.path == SolvePath::Other));
            for (a, b) in one.jerks.as_flattened().iter().zip(two.jerks.as_flattened()) {
                assert!((a - b).abs() < tolerance * 800.0, "{a} against {b}");
            }
        }
    }
}

/// Hold in closed loop at 2 ms: overshoot over the step height.
#[test]
fn a_held_target_is_approached_without_ringing() {
    let mut mpc = Mpc::<N>::new(&with_default_gains()).unwrap();
    // A jump of 50 mm needs more than the horizon to brake from: a little more overshoot.
    for (height, overshoot) in [(0.001, 0.03), (0.01, 0.03), (0.05, 0.06)] {
        let mut start = at_rest(0.0);
        let mut plan = Plan::resting(0.01);
        let mut highest = 0.0_f64;
        for _ in 0..250 {
            assert!(
                mpc.plan(&start, &at_rest(height), &gentle_preview(), Trust::NONE, 200, &mut plan).usable()
            );
            start = plan.state_at(0.002).unwrap();
            highest = highest.max(start[0].position);
        }
        assert!(highest <= height * (1.0 + overshoot), "overshoot of {} %", (highest / height - 1.0) * 100.0);
        assert!((start[0].position - height).abs() < 0.001 * height, "at rest on the target");
    }
}

/// Letters of 30 mm with a perfect preview: error well below the visible 0.2 mm.
#[test]
fn a_perfect_preview_is_followed_within_a_hundredth_of_a_millimetre() {
    let pen = |axis: usize, time: f64| {
        let mut pen = AxisState::default();
        for (amplitude, hertz) in [(0.010, 1.5), (0.004, 3.1), (0.0013, 5.5)] {
            let omega = hertz * std::f64::consts::TAU;
            let phase = omega * time + axis as f64;
            pen.position += amplitude * phase.sin();
            pen.velocity += amplitude * omega * phase.cos();
            pen.acceleration -= amplitude * omega * omega * phase.sin();
        }
        pen
    };
    let mut mpc = Mpc::<N>::new(&with_default_gains()).unwrap();
    let mut start: [AxisState; 3] = std::array::from_fn(|axis| pen(axis, 0.0));
    let mut plan = Plan::resting(0.01);
    let mut sum = 0.0;
    for k in 0..2000 {
        let now = f64::from(k) * 0.002;
        let preview =
            std::array::from_fn(|axis| std::array::from_fn(|i| pen(axis, now + (i + 1) as f64 * 0.01)));
        assert!(mpc.plan(&start, &start, &preview, Trust::FULL, 200, &mut plan).usable());
        start = plan.state_at(0.002).unwrap();
        sum +=
            (0..3).map(|axis| (start[axis].position - pen(axis, now + 0.002).position).powi(2)).sum::<f64>();
    }
    let rms = (sum / 6000.0).sqrt();
    assert!(rms < 1e-5, "{rms} m");
}

#[test]
fn a_planner_can_move_to_the_real_time_thread() {
    fn movable<T: Send>() {}
    movable::<Mpc<N>>();
}

#[test]
fn every_illegal_setting_names_itself() {
    type Break = fn(&mut MpcSettings);
    let cases: [(Break, &str); 9] = [
        (|s| s.step_s = 0.0, "step is 0"),
        (|s| s.effort = f64::NAN, "effort weight is NaN"),
        (|s| s.gains_feedback[2].velocity = -1.0, "feedback gain on velocity of axis 2 is -1"),
        (|s| s.gains_feedforward[0].decay = 0.0, "feedforward decay of axis 0 is 0"),
        (|s| s.axes[0].velocity_mps = f64::INFINITY, "velocity limit of axis 0 is inf"),
        (|s| s.axes[1].position_m = [0.1, 0.1], "workspace of axis 1 is [0.1, 0.1]"),
        (|s| s.soft_penalty.velocity = 0.0, "penalty on velocity is 0"),
        (|s| s.max_iterations = 0, "iteration cap is 0"),
        (|s| s.axes[2].acceleration_mps2 = -12.0, "acceleration limit of axis 2 is -12"),
    ];
    for (broken, message) in cases {
        let mut bad = settings();
        broken(&mut bad);
        let error = Mpc::<N>::new(&bad).unwrap_err().to_string();
        assert!(error.contains(message), "{error:?} should say {message:?}");
    }
    let mut singular = settings();
    singular.effort = 1e-9;
    singular.gains_feedback[1] = Gains { position: 1e3, velocity: 0.0, acceleration: 0.0, decay: 1.0 };
    assert_eq!(Mpc::<30>::new(&singular).unwrap_err(), MpcError::Singular { axis: 1 });
}
