//! The numbers of the law and the prior of its corrections: each has an effect, and none, however absurd,
//! makes a tick panic or a command leave its limits.

use crate::support::judging::Judge;
use crate::support::{Bench, settings};
use foretrace_control::estimate::refine::{Curve, CurvePart, CurveShape, Curves, RefinePrior};
use foretrace_control::estimate::{LEADS, LawParameters};
use foretrace_control::follower::{Follower, FollowerError};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::PredictorKind;
use foretrace_control::units::Stamp;

const UNIT_M: f64 = 1e-4;
const STEP_S: f64 = 0.01;

fn tuned(change: impl FnOnce(&mut LawParameters, &mut RefinePrior)) -> Judge {
    let (mut law, mut prior) = (LawParameters::SHIPPED, RefinePrior::SHIPPED);
    change(&mut law, &mut prior);
    Judge::tuned(STEP_S, &law, &prior)
}

/// Noise of a coarse tablet and of a clean one \[m\].
const NOISE_M: [f64; 2] = [2e-5, 1e-8];

/// A pen on a circle, 1.4 mm a step, whose samples have that much noise \[m\]; `t` in steps.
fn pen(t: f64, noise_m: f64) -> [f64; 2] {
    let noise = noise_m * (t * 7919.0).sin();
    [0.014 * (0.1 * t).sin() + noise, 0.014 * (0.1 * t).cos() - noise]
}

/// Writes for this many steps, each previewed as constant velocity, with a sample a quarter and a half step
/// after its grid point; returns the corrected positions 1 to 12 steps ahead.
fn write(judge: &mut Judge, steps: u32, noise_m: f64) -> Vec<[f64; 2]> {
    let at = |steps: f64| Stamp((1e9 + steps * STEP_S * 1e9) as u64);
    let mut preview = [[0.0; 2]; LEADS];
    for k in 1..=steps {
        let t = f64::from(k);
        let ([x, y], [px, py]) = (pen(t, noise_m), pen(t - 1.0, noise_m));
        judge.realise([x, y], UNIT_M);
        for (ahead, point) in (1..).map(f64::from).zip(&mut preview) {
            *point = [x + ahead * (x - px), y + ahead * (y - py)];
        }
        judge.preview([x, y], &preview);
        for phase in [0.25, 0.5] {
            let expected = [x + phase * (x - px), y + phase * (y - py)];
            judge.sample(at(t + phase), pen(t + phase, noise_m), phase, expected);
        }
    }
    (1..=12).zip(preview).map(|(lead, point)| judge.believed(lead, point)).collect()
}

#[test]
fn every_number_of_the_corrections_changes_what_is_believed() {
    let written = |change: &dyn Fn(&mut LawParameters, &mut RefinePrior)| {
        NOISE_M.map(|noise_m| [3, 40, 400].map(|steps| write(&mut tuned(change), steps, noise_m)))
    };
    let usual = written(&|_, _| {});
    assert_eq!(usual[0][1], write(&mut Judge::new(STEP_S, true), 40, NOISE_M[0]), "the default");
    for (name, value) in [
        ("leap", 1.0),
        ("memory", 10.0),
        ("prior_cases", 4.0),
        ("first_cases", 500.0),
        ("ordinary_innovation", 1.0),
        ("ordinary_acceleration", 400.0),
        ("largest", 0.1),
        ("shortest", 3.0),
        ("filter_coarsest", 1e5),
        ("filter_ratio", 1.5),
        ("filter_reach_s", 0.04),
        ("filter_pace", 0.9),
        ("filter_settled", 10_000.0),
        ("filter_better", 0.0),
        ("filter_velocity", 1.0),
        ("filter_acceleration", 0.0),
        ("filter_forget_s", 0.001),
    ] {
        let changed = written(&|law, _| *law = law.with(LawParameters::named(name).unwrap(), value));
        assert_ne!(changed, usual, "{name} changes nothing");
    }
    let part = CurvePart { amplitude: 0.5, shape: CurveShape::Rising, reach_steps: 4.0 };
    type Change = fn(&mut RefinePrior, CurvePart);
    let changes: [Change; 3] = [
        |p, _| p.coarse.left.base = 0.5,
        |p, _| p.coarse.velocity.parts[0].as_mut().unwrap().amplitude = 0.2,
        |p, part| p.coarse.innovation.parts[1] = Some(part),
    ];
    for (index, change) in changes.into_iter().enumerate() {
        assert_ne!(written(&|_, prior| change(prior, part)), usual, "change {index} of the prior");
    }
}

#[test]
fn a_new_hand_is_refined_by_the_prior_and_a_leap_by_nothing() {
    let flat = Curve { base: 0.0, parts: [None; 2] };
    let mut none = tuned(|_, prior| {
        prior.coarse = Curves { left: flat, innovation: flat, velocity: flat, acceleration: flat };
    });
    // One step: nothing is judged yet. Without weights the preview is shortened at most, never bent.
    let [[nx, ny], [x, y], [px, py]] = [1.5, 1.0, 0.0].map(|t| pen(t, NOISE_M[0]));
    let bend = |judge: &mut Judge| {
        let believed = write(judge, 1, NOISE_M[0]);
        let ([bx, by], [ax, ay]) = (believed[2], [x + 3.0 * (x - px) - nx, y + 3.0 * (y - py) - ny]);
        ((bx - nx) * ay - (by - ny) * ax).abs() / ax.hypot(ay)
    };
    let [unbent, bent] = [bend(&mut none), bend(&mut Judge::new(STEP_S, true))];
    assert!(unbent < 1e-12 && bent > 1e-6, "{unbent} m, {bent} m");
    let mut nervous = tuned(|law, _| law.leap = 0.0);
    assert!(
        write(&mut nervous, 5, NOISE_M[0]).iter().all(|at| *at == pen(5.5, NOISE_M[0])),
        "everything is a leap"
    );
}

#[test]
fn no_number_makes_a_tick_panic() {
    const ABSURD: [f64; 7] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 0.0, 1e-300, 1e300];
    for number in LawParameters::NUMBERS {
        for value in ABSURD {
            write(&mut tuned(|law, _| *law = law.with(number, value)), 120, NOISE_M[1]);
        }
    }
    // A non-finite prior has no effect; no other weight makes a position non-finite.
    for value in ABSURD {
        let part = CurvePart { amplitude: value, shape: CurveShape::Growing, reach_steps: value };
        let changes: [&dyn Fn(&mut RefinePrior); 2] =
            [&|p| p.coarse.left.base = value, &|p| p.coarse.velocity.parts = [Some(part); 2]];
        for (index, change) in changes.into_iter().enumerate() {
            let believed = write(&mut tuned(|_, prior| change(prior)), 120, NOISE_M[1]);
            let finite = believed.as_flattened().iter().all(|x| x.is_finite());
            assert!(finite, "change {index}, {value}: {believed:?}");
        }
    }
}

/// As above, with every stage of a tick.
#[test]
fn no_number_makes_a_follower_leave_its_limits() {
    for number in LawParameters::NUMBERS {
        for value in [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e300] {
            let mut wanted = settings(PredictorKind::CONSTANT_VELOCITY);
            wanted.law = wanted.law.with(number, value);
            // The bench checks every command.
            let mut bench = Bench::armed(wanted);
            for tick in 0..250 {
                let t = 0.002 * f64::from(tick);
                let at = [0.02 * (8.0 * t).sin(), 0.01 * (13.0 * t).sin()];
                let sample = PenReading::new(bench.now, at, true);
                bench.tick(if tick % 3 == 0 { std::slice::from_ref(&sample) } else { &[] });
            }
        }
    }
}

#[test]
fn a_follower_takes_no_prior_with_a_number_out_of_bounds_and_starts_from_the_one_that_it_is_given() {
    let with = |prior: RefinePrior| {
        let mut wanted = settings(PredictorKind::CONSTANT_VELOCITY);
        wanted.prior = prior;
        Follower::<10, 6>::new(wanted)
    };
    let mut bad = RefinePrior::SHIPPED;
    bad.clean.innovation.base = f64::NAN;
    let refused = with(bad).err().unwrap();
    assert!(matches!(refused, FollowerError::Prior(_)), "{refused:?}");
    assert_eq!(
        refused.to_string(),
        "the weights that refinement starts from: clean.innovation: base = NaN is outside -4 to 4"
    );
    let mut other = RefinePrior::SHIPPED;
    other.coarse.innovation.base = 0.5;
    assert_eq!(with(other).unwrap().settings().prior, other);
}
