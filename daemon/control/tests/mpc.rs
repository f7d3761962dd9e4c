//! The MPC: model, optimality, limits, trust, hostile input.

use foretrace_control::mpc::condense::Condensed;
use foretrace_control::mpc::model::{Motion, Scale, adjoint, rollout};
use foretrace_control::mpc::{
    AxisLimits, Backend, Gains, Mpc, MpcError, MpcSettings, Plan, SoftPenalty, SolvePath,
};
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
fn a_far_target_is_approached_at_the_limits() {
    let mut mpc = Mpc::<N>::new(&settings()).unwrap();
    let mut plan = Plan::resting(0.01);
    let preview = [[AxisState::at_rest(0.1); N]; 3];
    let report = mpc.plan(&at_rest(0.0), &at_rest(0.1), &preview, Trust::FULL, 200, &mut plan);
    for axis in &report.axes {
        assert_eq!(axis.status, QpStatus::Optimal, "{axis:?}");
        assert_eq!(axis.path, SolvePath::ActiveSet);
        assert!(axis.kkt_residual <= KKT_TOLERANCE);
    }
    for jerks in &plan.jerks {
        assert!(jerks.iter().all(|jerk| jerk.abs() <= 800.0 * (1.0 + 1e-15)), "{jerks:?}");
    }
    println!("{report:?}\n{plan:?}");
    let [_, _, _]: [AxisState; 3] = plan.state_at(0.1).unwrap();
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
    let force: Motion<N> = std::array::from_fn(|b| std::array::from_fn(|i| (b * 10 + i) as f64 * 0.01 - 0.1));
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
