//! The parameters of refinement: each has an effect, and none, however absurd, makes a tick panic.

use crate::support::judging::Judge;
use crate::support::settings;
use foretrace_control::estimate::refine::{
    Curve, CurvePart, CurveShape, Curves, RefineParameters, RefinePrior,
};
use foretrace_control::estimate::skill::SKILL_LEADS;
use foretrace_control::follower::{Follower, FollowerError};
use foretrace_control::predict::PredictorKind;
use foretrace_control::units::Stamp;

const UNIT_M: f64 = 1e-4;
const STEP_S: f64 = 0.01;

fn tuned(change: impl FnOnce(&mut RefineParameters)) -> Judge {
    let mut parameters = RefineParameters::SHIPPED;
    change(&mut parameters);
    Judge::refining(STEP_S, parameters)
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
fn write(skill: &mut Judge, steps: u32, noise_m: f64) -> Vec<[f64; 2]> {
    let at = |steps: f64| Stamp((1e9 + steps * STEP_S * 1e9) as u64);
    let mut preview = [[0.0; 2]; SKILL_LEADS];
    for k in 1..=steps {
        let t = f64::from(k);
        let ([x, y], [px, py]) = (pen(t, noise_m), pen(t - 1.0, noise_m));
        skill.realise([x, y], UNIT_M);
        for (ahead, point) in (1..).map(f64::from).zip(&mut preview) {
            *point = [x + ahead * (x - px), y + ahead * (y - py)];
        }
        skill.preview([x, y], [x - px, y - py], &preview);
        for phase in [0.25, 0.5] {
            let expected = [x + phase * (x - px), y + phase * (y - py)];
            skill.sample(at(t + phase), pen(t + phase, noise_m), phase, expected);
        }
    }
    (1..=12).zip(preview).map(|(lead, point)| skill.believed(lead, point)).collect()
}

#[test]
fn every_parameter_changes_what_is_believed() {
    let written = |change: fn(&mut RefineParameters)| {
        NOISE_M.map(|noise_m| [3, 40, 400].map(|steps| write(&mut tuned(change), steps, noise_m)))
    };
    let usual = written(|_| {});
    assert_eq!(usual[0][1], write(&mut Judge::new(STEP_S, true), 40, NOISE_M[0]), "the default");
    type Change = fn(&mut RefineParameters);
    let changes: [(&str, Change); 17] = [
        ("leap", |p| p.leap = 1.0),
        ("forgetting", |p| p.blend.forgetting = 0.9),
        ("ordinary", |p| p.blend.ordinary[0] = 1.0),
        ("prior_cases", |p| p.blend.prior_cases = 4.0),
        ("prior_worth", |p| p.blend.prior_worth = 500.0),
        ("largest", |p| p.blend.largest = 0.1),
        ("shortest", |p| p.blend.shortest = 3.0),
        ("changes", |p| p.observer.changes[0] = 1e5),
        ("reach_s", |p| p.observer.reach_s = 0.04),
        ("pace", |p| p.observer.pace = 0.9),
        ("settled", |p| p.observer.settled = 10_000),
        ("better", |p| p.observer.better = 0.0),
        ("first", |p| p.observer.filter.first[2] = 0.0),
        ("forget_after_s", |p| p.observer.filter.forget_after_s = 0.001),
        ("base", |p| p.prior.coarse.left.base = 0.5),
        ("amplitude", |p| p.prior.coarse.velocity.parts[0].as_mut().unwrap().amplitude = 0.2),
        ("part", |p| {
            let part = CurvePart { amplitude: 0.5, shape: CurveShape::Rising, reach_steps: 4.0 };
            p.prior.coarse.innovation.parts[1] = Some(part);
        }),
    ];
    for (name, change) in changes {
        assert_ne!(written(change), usual, "{name} changes nothing");
    }
}

#[test]
fn a_new_hand_is_refined_by_the_prior_and_a_leap_by_nothing() {
    let flat = Curve { base: 0.0, parts: [None; 2] };
    let mut none = tuned(|p| {
        p.prior.coarse = Curves { left: flat, innovation: flat, velocity: flat, acceleration: flat };
    });
    // One step: nothing is judged yet. Without weights the preview is shortened at most, never bent.
    let [[nx, ny], [x, y], [px, py]] = [1.5, 1.0, 0.0].map(|t| pen(t, NOISE_M[0]));
    let bend = |skill: &mut Judge| {
        let believed = write(skill, 1, NOISE_M[0]);
        let ([bx, by], [ax, ay]) = (believed[2], [x + 3.0 * (x - px) - nx, y + 3.0 * (y - py) - ny]);
        ((bx - nx) * ay - (by - ny) * ax).abs() / ax.hypot(ay)
    };
    let [unbent, bent] = [bend(&mut none), bend(&mut Judge::new(STEP_S, true))];
    assert!(unbent < 1e-12 && bent > 1e-6, "{unbent} m, {bent} m");
    let mut nervous = tuned(|p| p.leap = 0.0);
    assert!(
        write(&mut nervous, 5, NOISE_M[0]).iter().all(|at| *at == pen(5.5, NOISE_M[0])),
        "everything is a leap"
    );
}

#[test]
fn no_parameter_makes_a_tick_panic() {
    type Change = fn(&mut RefineParameters, f64);
    let changes: [Change; 15] = [
        |p, v| p.leap = v,
        |p, v| p.blend.forgetting = v,
        |p, v| p.blend.ordinary = [v; 4],
        |p, v| p.blend.prior_cases = v,
        |p, v| p.blend.prior_worth = v,
        |p, v| p.blend.largest = v,
        |p, v| p.blend.shortest = v,
        |p, v| p.observer.changes = [v; 5],
        |p, v| p.observer.reach_s = v,
        |p, v| p.observer.pace = v,
        |p, v| (p.observer.settled, p.observer.better) = (0, v),
        |p, v| p.observer.filter.first = [v; 3],
        |p, v| p.observer.filter.forget_after_s = v,
        |p, v| p.prior.coarse.left.base = v,
        |p, v| {
            let part = CurvePart { amplitude: v, shape: CurveShape::Growing, reach_steps: v };
            p.prior.coarse.velocity.parts = [Some(part); 2];
        },
    ];
    for (index, change) in changes.into_iter().enumerate() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 0.0, 1e-300, 1e300] {
            let believed = write(&mut tuned(|p| change(p, value)), 120, NOISE_M[1]);
            // A non-finite prior has no effect; no other weight makes a position non-finite.
            let of_the_prior = index >= 13;
            let finite = believed.as_flattened().iter().all(|x| x.is_finite());
            assert!(finite || !of_the_prior, "change {index}, {value}: {believed:?}");
        }
    }
}

#[test]
fn a_follower_takes_no_prior_with_a_number_out_of_bounds_and_starts_from_the_one_that_it_is_given() {
    let with = |prior: RefinePrior| {
        let mut wanted = settings(PredictorKind::CONSTANT_VELOCITY);
        wanted.refine.prior = prior;
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
    assert_eq!(with(other).unwrap().settings().refine.prior, other);
}
