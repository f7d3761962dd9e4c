//! Evidence: what it learns is what a regression over the same cases gives, and nothing it is fed makes it go wrong.

use foretrace_control::trust::{EVIDENCE_LEADS, Evidence, Record};
use foretrace_control::units::Stamp;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Metres per normalised unit: a step of ordinary motion, 1 mm, is 10.
const UNIT_M: f64 = 1e-4;
const STEP_S: f64 = 0.01;

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

/// The instant `steps` grid steps after the beginning.
fn at(steps: f64) -> Stamp {
    Stamp(1_000_000_000 + (steps * STEP_S * 1e9) as u64)
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
            evidence.sample(at(k as f64 + phase), position, phase, between(path[k], predicted[0], phase));
        }
    }
}

#[test]
fn what_a_newer_sample_says_takes_most_of_the_error_of_a_hand_that_wanders() {
    // Constant velocity from the grid knows nothing of a change within the step; half a step later it shows.
    let path = wandering(2, 3000);
    let mut evidence = Evidence::new(STEP_S, true);
    live(&mut evidence, &path[..2000], Preview::Steady, Some(0.5), 1);
    let (mut raw, mut believed) = ([0.0; 4], [0.0; 4]);
    for k in 2000..2900 {
        evidence.realise(path[k], UNIT_M);
        let predicted = Preview::Steady.at(&path, k);
        evidence.shoot(path[k], minus(path[k], path[k - 1]), &predicted);
        let expected = between(path[k], predicted[0], 0.5);
        evidence.sample(at(k as f64 + 0.5), between(path[k], path[k + 1], 0.5), 0.5, expected);
        for (lead, (raw, believed)) in (1..).zip(raw.iter_mut().zip(&mut believed)) {
            let missed = |from: [f64; 2]| minus(path[k + lead], from).iter().map(|x| x * x).sum::<f64>();
            *raw += missed(predicted[lead - 1]);
            *believed += missed(evidence.believed(0.5, lead, predicted[lead - 1]));
        }
    }
    let left: Vec<_> = believed.iter().zip(raw).map(|(believed, raw)| believed / raw).collect();
    println!("squared error left at leads 1 to 4: {left:.3?}");
    assert!(left.iter().zip([0.1, 0.45, 0.6, 0.75]).all(|(left, most)| *left < most), "{left:?}");
}

#[test]
fn predictor_that_goes_too_far_is_shortened_by_as_much() {
    let path = smooth(3000);
    for factor in [1.25, 2.0, 3.0] {
        let mut evidence = Evidence::new(STEP_S, true);
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
        let mut evidence = Evidence::new(STEP_S, true);
        live(&mut evidence, &smooth(800), Preview::Truth(factor), None, 1);
        for lead in 1..=EVIDENCE_LEADS {
            let share = evidence.share(lead);
            assert!((share - 1.0).abs() < 1e-12, "factor {factor}, lead {lead}: {share}");
        }
    }
}

fn record_of(preview: Preview, per_step: bool) -> Record {
    let mut evidence = Evidence::new(STEP_S, per_step);
    live(&mut evidence, &smooth(1500), preview, None, 1);
    evidence.record(3, 6)
}

#[test]
fn record_orders_perfect_constant_velocity_and_hold() {
    for per_step in [false, true] {
        let [perfect, steady, hold] =
            [Preview::Truth(1.0), Preview::Steady, Preview::Hold].map(|preview| record_of(preview, per_step));
        // What is left is the cases of doubt that every record begins with.
        assert!(perfect.preview < 0.1 * steady.preview, "{perfect:?}, {steady:?}");
        assert!(steady.preview < 0.5 * hold.preview, "{steady:?}, {hold:?}");
        // Each is judged beside the same two yardsticks, and is one of them itself.
        assert_eq!((perfect.hold, perfect.steady), (hold.hold, hold.steady));
        assert!((hold.preview / hold.hold - 1.0).abs() < 0.03, "{hold:?}");
        if !per_step {
            assert!((steady.preview / steady.steady - 1.0).abs() < 0.1, "{steady:?}");
        }
    }
}

#[test]
fn leap_counts_nothing() {
    let path = smooth(400);
    let mut evidence = Evidence::new(STEP_S, true);
    live(&mut evidence, &path, Preview::Steady, Some(0.3), 1);
    let told = |evidence: &Evidence| {
        let leads = 1..=EVIDENCE_LEADS;
        let points = leads.clone().map(|lead| evidence.believed(0.3, lead, [0.01, 0.01]).map(f64::to_bits));
        let points: Vec<_> = points.collect();
        let shares: Vec<_> = leads.map(|lead| evidence.share(lead).to_bits()).collect();
        (points, shares, evidence.record(1, EVIDENCE_LEADS))
    };
    let before = told(&evidence);
    // One that the tracker saw, ...
    let mut interrupted = evidence.clone();
    interrupted.interrupt();
    interrupted.realise([0.02, 0.02], UNIT_M);
    let (_, shares, record) = told(&interrupted);
    assert_eq!((&shares, record), (&before.1, before.2));
    // ... and one that it did not see.
    evidence.realise([0.5, 0.5], UNIT_M);
    assert_eq!(told(&evidence), before);
    // Previews made afterwards are judged again, and only they.
    interrupted.shoot([0.02, 0.02], [0.0; 2], &[[0.03, 0.03]; EVIDENCE_LEADS]);
    interrupted.realise([0.0205, 0.0205], UNIT_M);
    assert!(interrupted.record(1, 1).cases > before.2.cases.min(1.0));
    assert_eq!(interrupted.share(2).to_bits(), before.1[1], "lead 2 has not been judged again yet");
    assert!(interrupted.share(1) < f64::from_bits(before.1[0]));
}

#[test]
fn after_a_leap_of_the_newest_sample_nothing_is_foreseen_until_the_grid_has_seen_it() {
    let path = smooth(600);
    let mut evidence = Evidence::new(STEP_S, true);
    live(&mut evidence, &path, Preview::Steady, Some(0.5), 1);
    let [x, y] = path[599];
    let leapt = [x + 0.05, y - 0.03];
    evidence.sample(at(599.5), leapt, 0.5, [x, y]);
    for lead in 1..=EVIDENCE_LEADS {
        assert_eq!(evidence.believed(0.5, lead, [x + 0.001, y]), leapt);
    }
    // A step that a pen can make is news like any other.
    evidence.interrupt();
    evidence.sample(at(600.5), [x + 0.001, y], 0.5, [x, y]);
    assert!(evidence.believed(0.5, 2, [x, y]) != [x + 0.001, y]);
}

#[test]
fn steps_that_close_together_are_told_apart() {
    // A preview that is right is right at every lead only if each step is compared with the lead that meant it.
    for batch in [2, 3, 7] {
        let mut evidence = Evidence::new(STEP_S, true);
        live(&mut evidence, &smooth(1200), Preview::Truth(1.0), None, batch);
        for lead in 1..=EVIDENCE_LEADS {
            let record = evidence.record(lead, lead);
            assert!(record.cases > 100.0, "batch {batch}, lead {lead}: {record:?}");
            // The cases of doubt that every record begins with, and nothing else.
            let doubt = Evidence::new(STEP_S, true).record(lead, lead).preview;
            assert!(record.preview <= doubt, "batch {batch}, lead {lead}: {record:?}");
        }
    }
}

#[test]
fn another_predictor_starts_from_nothing() {
    let mut evidence = Evidence::new(STEP_S, true);
    live(&mut evidence, &smooth(500), Preview::Truth(2.0), Some(0.4), 1);
    evidence.forget();
    let new = Evidence::new(STEP_S, true);
    assert_eq!(evidence.record(1, EVIDENCE_LEADS), new.record(1, EVIDENCE_LEADS));
    for lead in 1..=EVIDENCE_LEADS {
        assert_eq!(evidence.share(lead), 1.0);
    }
}

#[test]
fn without_belief_per_step_previews_are_taken_as_they_are() {
    let mut evidence = Evidence::new(STEP_S, false);
    live(&mut evidence, &wandering(3, 800), Preview::Truth(2.0), Some(0.4), 1);
    for lead in 0..=EVIDENCE_LEADS + 5 {
        assert_eq!(evidence.share(lead), 1.0);
        let [x, y] = evidence.believed(0.4, lead, [0.3, -0.2]);
        assert!((x - 0.3).abs() < 1e-15 && (y + 0.2).abs() < 1e-15, "{x} {y}");
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
        let mut evidence = Evidence::new(STEP_S, seed % 4 != 0);
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
            let stamp = Stamp(if rng.random_bool(0.9) {
                10_000_000 * rng.random_range(0..900)
            } else {
                rng.random()
            });
            evidence.sample(stamp, sample, phase, expected);
            if rng.random_bool(0.01) {
                evidence.interrupt();
            }
            for lead in [0, 1, 7, EVIDENCE_LEADS, usize::MAX] {
                let share = evidence.share(lead);
                assert!((0.0..=1.0).contains(&share), "seed {seed}: share {share}");
            }
            let mut told = evidence.clone();
            told.sample(Stamp(stamp.0 / 2 + 5), [1e-3, 2e-3], 0.5, [1.1e-3, 2e-3]);
            let point = told.believed(0.5, 3, [2e-3, 1e-3]);
            assert!(point.iter().all(|x| x.is_finite()), "seed {seed}: {point:?}");
            let record = evidence.record(rng.random_range(0..30), rng.random_range(0..30));
            let sums = [record.preview, record.hold, record.steady, record.cases];
            assert!(sums.iter().all(|sum| sum.is_finite() && *sum >= 0.0), "seed {seed}: {record:?}");
            judged = judged.max(record.cases);
        }
    }
    assert!(judged > 50.0, "a test that judges nothing proves nothing: {judged}");
}
