//! Shares and records of past previews against sums over all cases, recomputed at every step.

use crate::support::judging::Judge;
use foretrace_control::estimate::{LEADS, LawParameters};
use foretrace_control::pen::TARGET_RMS;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const UNIT_M: f64 = 1e-4;

/// One judged case: the pen's real displacement and the predicted one \[normalised\].
struct Case {
    real: [f64; 2],
    predicted: [f64; 2],
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
fn share(cases: &[Case], lead: usize, parameters: &LawParameters) -> f64 {
    let age = |i: usize| parameters.forgetting().powi((cases.len() - 1 - i) as i32);
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

/// Λ of the module's description: each case against the variance of Hold's error in the cases before it.
fn evidence(cases: &[Case], lead: usize, parameters: &LawParameters) -> f64 {
    let ordinary = parameters.first_cases;
    let (mut held, mut weight, mut evidence) =
        (ordinary * (TARGET_RMS * lead as f64).powi(2), ordinary, 20.0);
    for case in cases {
        let hold = missed(case, [0.0; 2], 1.0);
        let gain = (hold - missed(case, case.predicted, case.believed)) / (2.0 * held / weight);
        evidence = (evidence + f64::clamp(gain, -4.0, 4.0)).clamp(-20.0, 20.0);
        held = parameters.forgetting() * held + hold;
        weight = parameters.forgetting() * weight + 1.0;
    }
    evidence
}

#[test]
fn shares_and_records_are_those_of_all_cases() {
    let parameters = LawParameters::SHIPPED;
    let mut rng = Pcg64::seed_from_u64(4);
    let mut judge = Judge::new(0.01, true);
    let mut cases: Vec<Vec<Case>> = (0..LEADS).map(|_| Vec::new()).collect();
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
    let (mut partly, mut argued) = (0, 0);
    for k in 1..430_usize {
        for (lead, cases) in (1..).zip(&mut cases) {
            let Some(made) = k.checked_sub(lead).filter(|made| *made >= 1) else { continue };
            let predicted = normalised(shots[made - 1][lead - 1], pen[made]);
            let believed = judge.share(lead);
            cases.push(Case { real: normalised(pen[k], pen[made]), predicted, believed });
        }
        judge.realise(pen[k], UNIT_M);
        // For a while the wrong way, beyond doubt.
        let factor = if (200..240).contains(&k) { -1.5 } else { 1.5 };
        let mut noisy = |lead: usize, axis: usize| {
            let way = pen[k + lead][axis] - pen[k][axis];
            pen[k][axis] + factor * way + rng.random_range(-4e-4..4e-4) * lead as f64
        };
        let path: Vec<_> = (1..=LEADS).map(|lead| [noisy(lead, 0), noisy(lead, 1)]).collect();
        judge.preview(pen[k], &path);
        shots.push(path);
        if k % 7 != 0 {
            continue;
        }
        for (lead, cases) in (1..).zip(&cases) {
            let expected = share(cases, lead, &parameters);
            assert!(
                (judge.share(lead) - expected).abs() < 1e-9,
                "{k}, lead {lead}: {} {expected}",
                judge.share(lead)
            );
            partly += u32::from(expected > 0.01 && expected < 0.99);
            // The record begins with cases of ordinary motion, in which the preview was as good as Hold.
            let ordinary = parameters.first_cases * (TARGET_RMS * lead as f64).powi(2);
            let sum = |begin: f64, of: &dyn Fn(&Case) -> f64| {
                cases.iter().fold(begin, |sum, case| parameters.forgetting() * sum + of(case))
            };
            let record = judge.record(lead, lead);
            for (found, expected) in [
                (record.preview, sum(ordinary, &|c| missed(c, c.predicted, c.believed))),
                (record.hold, sum(ordinary, &|c| missed(c, [0.0; 2], 1.0))),
            ] {
                assert!(
                    (found / expected.max(1e-9) - 1.0).abs() < 1e-9 || found == expected,
                    "{found} {expected}"
                );
            }
            let expected = evidence(cases, lead, &parameters);
            assert!((record.evidence - expected).abs() < 1e-9, "{k}, lead {lead}: {record:?} {expected}");
            argued += u32::from(expected.abs() < 20.0);
        }
        let least = (3..=6).map(|lead| judge.record(lead, lead).evidence).fold(20.0, f64::min);
        assert_eq!(judge.record(3, 6).evidence, least);
    }
    assert!(argued > 50, "{argued} between the bounds of the evidence");
    assert!(partly > 200, "{partly} shares between nothing and all");
}
