//! AR-RLS: it identifies the process behind its input, excludes jumps from its coefficients, and does not
//! wind up in silence.

use foretrace_control::predict::models::ar_rls::{
    ArRls, ArRlsLearner, ArRlsSettings, ArRlsWeights, ORDER, REGRESSORS,
};
use foretrace_control::predict::{ModelParameters, OnlineModel, Predictor};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const STEP_NS: u64 = 10_000_000;

fn learner(settings: ArRlsSettings) -> ArRlsLearner {
    ArRlsLearner::new(settings, ArRlsWeights::constant_velocity(STEP_NS)).unwrap()
}

/// x[t] = x[t−1] A_1 + x[t−2] A_2 + noise, uniform within ±`noise`; a damped oscillation that couples the
/// axes.
fn process(steps: usize, noise: f64) -> Vec<[f64; 2]> {
    let mut dice = Pcg64::seed_from_u64(11);
    let (mut one, mut two) = ([0.0; 2], [0.0; 2]);
    (0..steps)
        .map(|_| {
            let [a, b] = PROCESS;
            let mut x = [0.0; 2];
            for out in 0..2 {
                for axis in 0..2 {
                    x[out] += one[axis] * a[axis][out] + two[axis] * b[axis][out];
                }
                x[out] += dice.random_range(-noise..noise);
            }
            (two, one) = (one, x);
            x
        })
        .collect()
}

/// A_1 and A_2, in x out.
const PROCESS: [[[f64; 2]; 2]; 2] = [[[1.5, 0.1], [-0.2, 1.2]], [[-0.7, 0.0], [0.1, -0.5]]];

#[test]
fn recovers_a_known_process() {
    // λ = 1 and no clipping is plain least squares: coefficients to a few standard errors, σ/√(n var x) <
    // 0.01.
    let settings = ArRlsSettings { forgetting: 1.0, huber: 100.0, gate: 1e3, ..ArRlsSettings::default() };
    let mut learner = learner(settings);
    for x in process(40_000, 2.0) {
        learner.learn(x);
    }
    let found = learner.parameters().coefficients;
    for (lag, matrix) in found.iter().enumerate() {
        let wanted = PROCESS.get(lag).copied().unwrap_or_default();
        for (a, b) in matrix.as_flattened().iter().zip(wanted.as_flattened()) {
            assert!((a - b).abs() < 0.03, "lag {lag}: {a} instead of {b}");
        }
    }
    assert_eq!((learner.counters().gated, learner.counters().restarted), (0, 0));
}

#[test]
fn agrees_with_the_normal_equations() {
    // RLS with λ = 1 from P₀ = p·I and θ₀ minimises Σ|x − φθ|² + |θ − θ₀|²/p exactly.
    let settings = ArRlsSettings { forgetting: 1.0, huber: 1e3, gate: 1e3, covariance: 0.5 };
    let mut learner = learner(settings);
    let inputs = process(300, 3.0);
    let mut normal = nalgebra::DMatrix::<f64>::identity(REGRESSORS, REGRESSORS) / 0.5;
    let theta_0 = nalgebra::DMatrix::from_fn(REGRESSORS, 2, |i, j| f64::from(u8::from(i == j)));
    let mut right = &normal * &theta_0;
    for (t, x) in inputs.iter().enumerate() {
        let phi = nalgebra::DVector::from_fn(REGRESSORS, |i, _| {
            t.checked_sub(1 + i / 2).map_or(0.0, |lag| inputs[lag][i % 2])
        });
        normal += &phi * phi.transpose();
        right += &phi * nalgebra::RowDVector::from_row_slice(x);
        learner.learn(*x);
    }
    let exact = normal.cholesky().unwrap().solve(&right);
    for (i, row) in learner.parameters().coefficients.as_flattened().iter().enumerate() {
        for (j, theta) in row.iter().enumerate() {
            assert!((theta - exact[(i, j)]).abs() < 1e-9, "{theta} instead of {}", exact[(i, j)]);
        }
    }
}

#[test]
fn starts_as_constant_velocity_and_is_of_use_within_one_letter() {
    let mut learner = learner(ArRlsSettings::default());
    assert_eq!(learner.learn([3.0, -4.0]), [0.0, 0.0]);
    let mut out = [[0.0; 2]; 3];
    learner.preview(&mut out);
    assert_eq!(out, [[3.0, -4.0]; 3]);
    // A circle is an autoregressive process: after 60 steps its continuation is known.
    learner.reset_state();
    let circle = |t: usize| [12.0 * (0.2 * t as f64).cos(), 12.0 * (0.2 * t as f64).sin()];
    for t in 0..60 {
        learner.learn(circle(t));
    }
    let mut out = [[0.0; 2]; 10];
    learner.preview(&mut out);
    for (ahead, [x, y]) in out.iter().enumerate() {
        let [cx, cy] = circle(60 + ahead);
        assert!((x - cx).hypot(y - cy) < 0.6, "step {ahead}");
    }
}

#[test]
fn jumps_empty_the_memory_and_are_neither_learned_from_nor_across() {
    let mut learner = learner(ArRlsSettings::default());
    for x in process(200, 2.0) {
        learner.learn(x);
    }
    let before = *learner.parameters();
    let gate = learner.settings().gate;
    learner.learn([gate * 0.8, gate * 0.7]);
    assert_eq!(*learner.parameters(), before);
    assert_eq!(learner.memory().recent, [[0.0; 2]; ORDER]);
    assert_eq!(learner.counters().gated, 1);
    // Without predecessors the next displacement is not learned from.
    assert_eq!(learner.learn([5.0, 5.0]), [0.0, 0.0]);
    assert_eq!(*learner.parameters(), before);
    let mut predictor = ArRls::new(before, gate).unwrap();
    predictor.observe([5.0, 5.0]);
    predictor.observe([2.0 * gate, 0.0]);
    assert_eq!(predictor.state().recent, [[0.0; 2]; ORDER]);
}

#[test]
fn one_wild_step_moves_the_coefficients_no_more_than_a_clipped_one() {
    let train = process(500, 2.0);
    let after = |last: [f64; 2]| {
        let mut learner = learner(ArRlsSettings::default());
        train.iter().for_each(|x| {
            learner.learn(*x);
        });
        let [px, py] = {
            let mut out = [[0.0; 2]];
            learner.preview(&mut out);
            out[0]
        };
        learner.learn([px + last[0], py + last[1]]);
        *learner.parameters()
    };
    let huber = ArRlsSettings::default().huber;
    assert_eq!(after([huber, -huber]), after([huber * 2.0, -huber * 1.5]));
    assert_ne!(after([huber, -huber]), after([huber * 0.5, -huber]));
}

/// No wind-up: with `input` for a long time, P stays within its bound and the model recovers as from a cold
/// start.
fn stays_sound(name: &str, input: impl Fn(usize) -> [f64; 2]) {
    let settings = ArRlsSettings::default();
    let bound = settings.covariance * REGRESSORS as f64 / settings.forgetting * 1.00001;
    let mut learner = learner(settings);
    let ordinary = process(1000, 2.0);
    ordinary.iter().for_each(|x| {
        learner.learn(*x);
    });
    for t in 0..200_000 {
        learner.learn(input(t));
        assert!(learner.uncertainty() <= bound, "{name}: trace {}", learner.uncertainty());
    }
    learner.parameters().validate().unwrap();
    assert_eq!(learner.counters().restarted, 0, "{name}");
    let error = error_after_a_second(&mut learner, &ordinary);
    let cold = error_after_a_second(&mut self::learner(settings), &ordinary);
    assert!(error < 2.0 * cold, "{name}: error {error}, {cold} from a cold start");
}

/// Summed squared error from the hundredth step on.
fn error_after_a_second(learner: &mut ArRlsLearner, inputs: &[[f64; 2]]) -> f64 {
    learner.reset_state();
    let errors = inputs.iter().map(|x| {
        let [px, py] = learner.learn(*x);
        (px - x[0]).powi(2) + (py - x[1]).powi(2)
    });
    errors.skip(100).sum()
}

#[test]
fn silence_and_one_sided_motion_do_not_wind_up_the_covariance() {
    stays_sound("silence", |_| [0.0; 2]);
    stays_sound("tremor below the still bound", |t| [1e-4 * (t % 3) as f64, 0.0]);
    stays_sound("a straight line", |_| [10.0, 0.0]);
    stays_sound("mostly silence", |t| if t % 50 < 2 { [6.0, -1.0] } else { [0.0; 2] });
    stays_sound("a pure sine", |t| [14.0 * (0.3 * t as f64).sin(), 0.0]);
}

#[test]
fn silence_is_not_forgotten_over() {
    let mut learner = learner(ArRlsSettings::default());
    process(2000, 2.0).iter().for_each(|x| {
        learner.learn(*x);
    });
    let (parameters, trace) = (*learner.parameters(), learner.uncertainty());
    (0..ORDER).for_each(|_| {
        learner.learn([0.0; 2]);
    });
    let settled = learner.uncertainty();
    (0..100_000).for_each(|_| {
        learner.learn([0.0; 2]);
    });
    assert_eq!(learner.uncertainty(), settled);
    assert!(settled < 2.0 * trace);
    let moved = parameters.coefficients.as_flattened().as_flattened().iter();
    let now = learner.parameters().coefficients;
    assert!(moved.zip(now.as_flattened().as_flattened()).all(|(a, b)| (a - b).abs() < 0.2));
}

#[test]
fn settings_out_of_bounds_are_refused_with_the_legal_range() {
    let good = ArRlsSettings::default();
    for bad in [
        ArRlsSettings { forgetting: 0.5, ..good },
        ArRlsSettings { forgetting: 1.1, ..good },
        ArRlsSettings { forgetting: f64::NAN, ..good },
        ArRlsSettings { gate: 0.0, ..good },
        ArRlsSettings { gate: f64::INFINITY, ..good },
        ArRlsSettings { huber: -1.0, ..good },
        ArRlsSettings { huber: f64::NAN, ..good },
        ArRlsSettings { covariance: 0.0, ..good },
        ArRlsSettings { covariance: f64::INFINITY, ..good },
    ] {
        let error = ArRlsLearner::new(bad, ArRlsWeights::constant_velocity(STEP_NS)).unwrap_err();
        assert!(error.to_string().contains("legal are"), "{error}");
    }
    assert!(ArRls::new(ArRlsWeights::constant_velocity(STEP_NS), -1.0).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn units_do_not_matter(seed in any::<u64>(), rms in 1e-3..1e3f64) {
        // The same motion in other units, with settings for that RMS, gives the same prediction in those
        // units.
        let mut dice = Pcg64::seed_from_u64(seed);
        let factor = rms / 10.0;
        let mut one = learner(ArRlsSettings::for_rms(10.0));
        let mut other = learner(ArRlsSettings::for_rms(rms));
        for _ in 0..300 {
            let x: [f64; 2] = std::array::from_fn(|_| dice.random_range(-30.0..30.0));
            let [ax, ay] = one.learn(x);
            let [bx, by] = other.learn(x.map(|x| x * factor));
            prop_assert!((ax * factor - bx).abs() < 1e-6 * rms && (ay * factor - by).abs() < 1e-6 * rms);
        }
    }
}
