//! Shares and records of the skill against sums over all cases, recomputed at every step.

use crate::support::judging::Judge;
use foretrace_control::estimate::refine::Refiner;
use foretrace_control::estimate::skill::{NewPreview, SKILL_LEADS, Skill, SkillParameters};
use foretrace_control::pen::{Motion, TARGET_RMS};
use foretrace_control::predict::LearnStep;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const UNIT_M: f64 = 1e-4;

/// One judged case: the pen's real displacement, the predicted one, and that of constant velocity
/// \[normalised\].
struct Case {
    real: [f64; 2],
    predicted: [f64; 2],
    steady: [f64; 2],
    /// The share in force then.
    believed: f64,
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn missed(case: &Case, by: [f64; 2], share: f64) -> f64 {
    let left = [case.real[0] - share * by[0], case.real[1] - share * by[1]];
    dot(left, left)
}

/// w of the module's description, the newest case last: the slope of the regression plus three standard
/// deviations; errors `lead` steps ahead are correlated over that many steps.
fn share(cases: &[Case], lead: usize, parameters: &SkillParameters) -> f64 {
    let age = |i: usize| parameters.forgetting.powi((cases.len() - 1 - i) as i32);
    let sum = |of: &dyn Fn(&Case) -> f64| cases.iter().enumerate().map(|(i, c)| age(i) * of(c)).sum::<f64>();
    let way = sum(&|c| dot(c.predicted, c.predicted));
    if way == 0.0 {
        return 1.0;
    }
    let slope = sum(&|c| dot(c.real, c.predicted)) / way;
    let unexplained = (sum(&|c| dot(c.real, c.real)) / way - slope * slope).max(0.0);
    let independent = 2.0 * sum(&|_| 1.0) / lead as f64;
    (slope + parameters.doubt * (unexplained / independent).sqrt()).clamp(0.0, 1.0)
}

#[test]
fn shares_and_records_are_those_of_all_cases() {
    let parameters = SkillParameters::SHIPPED;
    let mut rng = Pcg64::seed_from_u64(4);
    let mut skill = Judge::new(0.01, true);
    let mut cases: Vec<Vec<Case>> = (0..SKILL_LEADS).map(|_| Vec::new()).collect();
    // A hand of ordinary speed, and noisy previews that overshoot by half.
    let mut pen = vec![[0.0, 0.0]];
    for k in 0..460 {
        let angle = 0.07 * f64::from(k);
        let [x, y] = pen[pen.len() - 1];
        let step = 1e-3 * (1.0 + rng.random_range(-0.3..0.3));
        pen.push([x + step * angle.cos(), y + step * angle.sin()]);
    }
    let mut shots: Vec<Vec<[f64; 2]>> = Vec::new();
    let normalised = |to: [f64; 2], from: [f64; 2]| [(to[0] - from[0]) / UNIT_M, (to[1] - from[1]) / UNIT_M];
    let mut partly = 0;
    for k in 1..430_usize {
        for (lead, cases) in (1..).zip(&mut cases) {
            let Some(made) = k.checked_sub(lead).filter(|made| *made >= 1) else { continue };
            let predicted = normalised(shots[made - 1][lead - 1], pen[made]);
            let steady = normalised(pen[made], pen[made - 1]).map(|v| v * lead as f64);
            let believed = skill.share(lead);
            cases.push(Case { real: normalised(pen[k], pen[made]), predicted, steady, believed });
        }
        skill.realise(pen[k], UNIT_M);
        let velocity = [pen[k][0] - pen[k - 1][0], pen[k][1] - pen[k - 1][1]];
        let mut noisy = |lead: usize, axis: usize| {
            let way = pen[k + lead][axis] - pen[k][axis];
            pen[k][axis] + 1.5 * way + rng.random_range(-4e-4..4e-4) * lead as f64
        };
        let path: Vec<_> = (1..=SKILL_LEADS).map(|lead| [noisy(lead, 0), noisy(lead, 1)]).collect();
        skill.preview(pen[k], velocity, &path);
        shots.push(path);
        if k % 7 != 0 {
            continue;
        }
        for (lead, cases) in (1..).zip(&cases) {
            let expected = share(cases, lead, &parameters);
            assert!(
                (skill.share(lead) - expected).abs() < 1e-9,
                "{k}, lead {lead}: {} {expected}",
                skill.share(lead)
            );
            partly += u32::from(expected > 0.01 && expected < 0.99);
            // The record begins with cases of ordinary motion, in which the preview was better than Hold.
            let ordinary = parameters.head_start_cases * (TARGET_RMS * lead as f64).powi(2);
            let sum = |begin: f64, of: &dyn Fn(&Case) -> f64| {
                cases.iter().fold(begin, |sum, case| parameters.forgetting * sum + of(case))
            };
            let record = skill.record(lead, lead);
            for (found, expected) in [
                (record.preview, sum(0.7 * ordinary, &|c| missed(c, c.predicted, c.believed))),
                (record.hold, sum(ordinary, &|c| missed(c, [0.0; 2], 1.0))),
                (record.steady, sum(ordinary, &|c| missed(c, c.steady, 1.0))),
                (record.cases, sum(0.0, &|_| 1.0)),
            ] {
                assert!(
                    (found / expected.max(1e-9) - 1.0).abs() < 1e-9 || found == expected,
                    "{found} {expected}"
                );
            }
        }
    }
    assert!(partly > 200, "{partly} shares between nothing and all");
}

/// The share of wrong claims after `cases` claims of `radius_m`, `lead` steps ahead, for a pen 0.5 mm beside
/// every preview.
fn surprise(lead: usize, radius_m: f64, cases: usize) -> f64 {
    let (mut skill, mut refiner) = (Skill::new(0.01, false), Refiner::new(0.01));
    for k in 0..cases + lead {
        let base = [1e-3 * k as f64, 0.0];
        let path: Vec<_> = (1..=SKILL_LEADS).map(|ahead| [base[0] + 1e-3 * ahead as f64, 5e-4]).collect();
        let claim = Some((lead, radius_m));
        skill.record_preview(&NewPreview { base, velocity: [1e-3, 0.0], path: &path, claim });
        let (motion, position) = (Motion::Continues, [base[0] + 1e-3, 0.0]);
        let closed = LearnStep { motion, position, scale_m: UNIT_M, ..LearnStep::default() };
        skill.judge(&mut refiner, &[closed]);
    }
    // The first claim is judged when its step closes, `lead` steps later.
    skill.report(1, 1).record.surprise
}

#[test]
fn surprises_are_the_claims_that_the_pen_left() {
    let memory = SkillParameters::SHIPPED.surprise_cases;
    for lead in [1, 3, 9] {
        for cases in [1, 40, 300] {
            assert_eq!(surprise(lead, 5.1e-4, cases), 0.0, "lead {lead}");
            let all = 1.0 - (1.0 - 1.0 / memory).powi(cases as i32 + 1);
            let found = surprise(lead, 4.9e-4, cases);
            assert!((found - all).abs() < 1e-12, "lead {lead}, {cases} cases: {found} {all}");
        }
    }
    assert_eq!(surprise(0, 1e-4, 100), 0.0, "a claim about the base says nothing");
}
