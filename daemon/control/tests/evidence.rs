//! Evidence: what it learns is what a regression over the same cases gives, and nothing it is fed makes it go wrong.

use foretrace_control::trust::{EVIDENCE_LEADS, Evidence, Record};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Metres per normalised unit: a step of ordinary motion, 1 mm, is 10.
const UNIT_M: f64 = 1e-4;
const FORGETTING: f64 = 0.998;

/// Pen positions of a hand whose velocity wanders, a grid step apart [m].
fn wandering(seed: u64, steps: usize) -> Vec<[f64; 2]> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let (mut position, mut velocity) = ([0.0; 2], [1e-3, 0.5e-3]);
    (0..steps)
        .map(|_| {
            for (x, v) in position.iter_mut().zip(&mut velocity) {
                // It comes back to 1 mm per step, so that no preview is ever called a leap.
                *v += 0.02 * (1e-3 - *v) + rng.random_range(-0.2e-3..0.2e-3);
                *x += *v;
            }
            position
        })
        .collect()
}

fn smooth(steps: usize) -> Vec<[f64; 2]> {
    (0..steps).map(|k| k as f64 * 0.12).map(|t| [0.01 * t.sin(), 0.008 * (1.3 * t).cos()]).collect()
}

fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn between(a: [f64; 2], b: [f64; 2], part: f64) -> [f64; 2] {
    [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1])]
}

/// The preview made at a grid point.
#[derive(Clone, Copy)]
enum Preview {
    Hold,
    Steady,
    /// The pen's own way, times this.
    Truth(f64),
}

impl Preview {
    fn at(self, path: &[[f64; 2]], k: usize) -> Vec<[f64; 2]> {
        let here = path[k];
        let velocity = minus(here, path[k - 1]);
        let ahead = |j: usize| match self {
            Self::Hold => here,
            Self::Steady => [here[0] + j as f64 * velocity[0], here[1] + j as f64 * velocity[1]],
            Self::Truth(factor) => between(here, path[(k + j).min(path.len() - 1)], factor),
        };
        (1..=EVIDENCE_LEADS).map(ahead).collect()
    }
}

/// Grid steps of `path`, `batch` of them closing at once, each batch followed by a preview and, if `phase` is given, by a
/// sample that far on the straight line to the next grid point.
fn live(evidence: &mut Evidence, path: &[[f64; 2]], preview: Preview, phase: Option<f64>, batch: usize) {
    for k in 1..path.len() - 1 {
        evidence.realise(path[k], UNIT_M);
        if k % batch != 0 {
            continue;
        }
        let predicted = preview.at(path, k);
        evidence.shoot(path[k], minus(path[k], path[k - 1]), &predicted);
        if let Some(phase) = phase {
            let position = between(path[k], path[k + 1], phase);
            evidence.sample(position, phase, between(path[k], predicted[0], phase));
        }
    }
}

#[test]
fn learned_gain_is_the_regression_of_the_error_on_the_innovation() {
    const PHASE: f64 = 0.6;
    const WEIGHT_OF_PRIOR: f64 = 300.0;
    let path = wandering(1, 1500);
    let mut evidence = Evidence::new(true);
    live(&mut evidence, &path, Preview::Steady, Some(PHASE), 1);
    for lead in [1, 2, 5, 12, EVIDENCE_LEADS] {
        let prior = Evidence::new(true).gain(PHASE, lead);
        let (mut cross, mut power) = (0.0, 0.0);
        for k in 1..path.len() - 1 - lead {
            let predicted = Preview::Steady.at(&path, k);
            let sample = between(path[k], path[k + 1], PHASE);
            let e = minus(sample, between(path[k], predicted[0], PHASE)).map(|e| e / UNIT_M);
            let r = minus(path[k + lead], predicted[lead - 1]).map(|r| r / UNIT_M);
            cross = FORGETTING * cross + e[0] * r[0] + e[1] * r[1];
            power = FORGETTING * power + e[0] * e[0] + e[1] * e[1];
        }
        let expected = ((cross + WEIGHT_OF_PRIOR * prior) / (power + WEIGHT_OF_PRIOR)).clamp(0.0, 8.0);
        let got = evidence.gain(PHASE, lead);
        assert!((got - expected).abs() < 1e-9, "lead {lead}: {got}, directly {expected}");
        assert!((got - prior).abs() > 0.02 * prior, "lead {lead}: nothing was learned, {got} from {prior}");
    }
}

#[test]
fn change_of_velocity_that_lasts_is_worth_its_lead_over_the_phase() {
    // Seen half a step after it happened, a change of velocity moves lead j by j/0.5 times the innovation.
    // Strong enough that the prior weighs little.
    let path: Vec<_> = wandering(2, 3000).iter().map(|point| point.map(|x| 5.0 * x)).collect();
    let mut evidence = Evidence::new(true);
    live(&mut evidence, &path, Preview::Steady, Some(0.5), 1);
    for lead in 1..4 {
        let (got, wanted) = (evidence.gain(0.5, lead), lead as f64 / 0.5);
        assert!((got / wanted - 1.0).abs() < 0.15, "lead {lead}: {got}, wanted {wanted}");
    }
}

#[test]
fn predictor_that_goes_too_far_is_shortened_by_as_much() {
    let path = smooth(3000);
    for factor in [1.25, 2.0, 3.0] {
        let mut evidence = Evidence::new(true);
        live(&mut evidence, &path, Preview::Truth(factor), None, 1);
        for lead in [2, 4, 8] {
            let share = evidence.share(lead);
            assert!((share * factor - 1.0).abs() < 0.05, "factor {factor}, lead {lead}: {share}");
        }
    }
}

#[test]
fn predictor_that_is_right_or_too_careful_is_believed_in_full() {
    for factor in [1.0, 0.7] {
        let mut evidence = Evidence::new(true);
        live(&mut evidence, &smooth(800), Preview::Truth(factor), None, 1);
        for lead in 1..=EVIDENCE_LEADS {
            let share = evidence.share(lead);
            assert!((share - 1.0).abs() < 1e-12, "factor {factor}, lead {lead}: {share}");
        }
    }
}

fn record_of(preview: Preview, per_step: bool) -> Record {
    let mut evidence = Evidence::new(per_step);
    live(&mut evidence, &smooth(1500), preview, None, 1);
    evidence.record(3, 6)
}

#[test]
fn record_orders_perfect_constant_velocity_and_hold() {
    for per_step in [false, true] {
        let [perfect, steady, hold] =
            [Preview::Truth(1.0), Preview::Steady, Preview::Hold].map(|preview| record_of(preview, per_step));
        assert!(perfect.preview < 1e-12 * steady.preview, "{perfect:?}");
        assert!(steady.preview < 0.5 * hold.preview, "{steady:?}, {hold:?}");
        // Each is judged beside the same two yardsticks, and is one of them itself.
        assert_eq!((perfect.hold, perfect.steady), (hold.hold, hold.steady));
        assert!((hold.preview / hold.hold - 1.0).abs() < 1e-9, "{hold:?}");
        if !per_step {
            assert!((steady.preview / steady.steady - 1.0).abs() < 1e-9, "{steady:?}");
        }
    }
}

#[test]
fn leap_counts_nothing() {
    let path = smooth(400);
    let mut evidence = Evidence::new(true);
    live(&mut evidence, &path, Preview::Steady, Some(0.3), 1);
    let told = |evidence: &Evidence| {
        let leads = 1..=EVIDENCE_LEADS;
        let gains: Vec<_> = leads.clone().map(|lead| evidence.gain(0.3, lead).to_bits()).collect();
        let shares: Vec<_> = leads.map(|lead| evidence.share(lead).to_bits()).collect();
        (gains, shares, evidence.record(1, EVIDENCE_LEADS))
    };
    let before = told(&evidence);
    // One that the tracker saw, ...
    let mut interrupted = evidence.clone();
    interrupted.interrupt();
    interrupted.realise([0.02, 0.02], UNIT_M);
    assert_eq!(told(&interrupted), before);
    // ... and one that it did not see.
    evidence.realise([0.5, 0.5], UNIT_M);
    assert_eq!(told(&evidence), before);
    // Previews made afterwards are judged again, and only they.
    interrupted.shoot([0.02, 0.02], [0.0; 2], &[[0.021, 0.021]; EVIDENCE_LEADS]);
    interrupted.realise([0.0205, 0.0205], UNIT_M);
    assert!(interrupted.record(1, 1).cases > before.2.cases.min(1.0));
    assert_eq!(interrupted.share(2).to_bits(), before.1[1], "lead 2 has not been judged again yet");
    assert!(interrupted.share(1) < f64::from_bits(before.1[0]));
}

#[test]
fn steps_that_close_together_are_told_apart() {
    // A preview that is right is right at every lead only if each step is compared with the lead that meant it.
    for batch in [2, 3, 7] {
        let mut evidence = Evidence::new(true);
        live(&mut evidence, &smooth(1200), Preview::Truth(1.0), None, batch);
        for lead in 1..=EVIDENCE_LEADS {
            let record = evidence.record(lead, lead);
            assert!(record.cases > 100.0, "batch {batch}, lead {lead}: {record:?}");
            assert!(record.preview < 1e-12 * record.hold, "batch {batch}, lead {lead}: {record:?}");
        }
    }
}

#[test]
fn another_predictor_starts_from_nothing() {
    let mut evidence = Evidence::new(true);
    live(&mut evidence, &smooth(500), Preview::Truth(2.0), Some(0.4), 1);
    evidence.forget();
    assert_eq!(evidence.record(1, EVIDENCE_LEADS), Record::default());
    for lead in 1..=EVIDENCE_LEADS {
        assert_eq!(evidence.share(lead), 1.0);
        assert_eq!(evidence.gain(0.4, lead), Evidence::new(true).gain(0.4, lead));
    }
}

#[test]
fn without_belief_per_step_there_is_no_gain_and_no_share() {
    let mut evidence = Evidence::new(false);
    live(&mut evidence, &wandering(3, 800), Preview::Truth(2.0), Some(0.4), 1);
    for lead in 0..=EVIDENCE_LEADS + 5 {
        assert_eq!((evidence.gain(0.4, lead), evidence.share(lead)), (0.0, 1.0));
    }
    assert!(evidence.record(3, 6).preview > 0.0, "previews are judged all the same");
}

/// Mostly of ordinary size, sometimes not a number, or not an ordinary one.
fn nasty(rng: &mut Pcg64, scale: f64) -> f64 {
    match rng.random_range(0..40) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => f64::NEG_INFINITY,
        3 => f64::MAX,
        4 => -1e200,
        5 => f64::MIN_POSITIVE,
        6 => f64::from_bits(rng.next_u64()),
        _ => rng.random_range(-scale..scale),
    }
}

#[test]
fn nothing_that_comes_in_leaves_its_range_or_turns_to_nan() {
    let mut judged = 0.0_f64;
    for seed in 0..40 {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut evidence = Evidence::new(seed % 4 != 0);
        for _ in 0..800 {
            let mut point = |scale| [nasty(&mut rng, scale), nasty(&mut rng, scale)];
            let (position, base, velocity, sample) = (point(2e-3), point(2e-3), point(1e-3), point(2e-3));
            let expected = point(2e-3);
            let count = rng.random_range(0..2 * EVIDENCE_LEADS);
            let path: Vec<_> = (0..count).map(|_| [nasty(&mut rng, 2e-3), nasty(&mut rng, 2e-3)]).collect();
            let phase = if rng.random_bool(0.8) { rng.random() } else { nasty(&mut rng, 3.0) };
            let unit = if rng.random_bool(0.8) { UNIT_M } else { nasty(&mut rng, 1e-3) };
            evidence.realise(position, unit);
            evidence.shoot(base, velocity, &path);
            evidence.sample(sample, phase, expected);
            if rng.random_bool(0.01) {
                evidence.interrupt();
            }
            for lead in [0, 1, 7, EVIDENCE_LEADS, usize::MAX] {
                let (gain, share) = (evidence.gain(phase, lead), evidence.share(lead));
                assert!((0.0..=8.0).contains(&gain), "seed {seed}: gain {gain}");
                assert!((0.0..=1.0).contains(&share), "seed {seed}: share {share}");
            }
            let record = evidence.record(rng.random_range(0..30), rng.random_range(0..30));
            let sums = [record.preview, record.hold, record.steady, record.cases];
            assert!(sums.iter().all(|sum| sum.is_finite() && *sum >= 0.0), "seed {seed}: {record:?}");
            judged = judged.max(record.cases);
        }
    }
    assert!(judged > 50.0, "a test that judges nothing proves nothing: {judged}");
}
