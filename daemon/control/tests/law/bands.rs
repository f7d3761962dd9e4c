//! Error bands: their coverage is as claimed, for every predictor and lead, as the loop sees it.

use crate::support::learner;
use crate::support::strokes::handwriting;
use foretrace_control::learn::Learner;
use foretrace_control::pen::REST;
use foretrace_control::pen::{GridStep, Motion};
use foretrace_control::predict::bands::{BAND_LEADS, COVERAGE};
use foretrace_control::predict::{PredictorKind, PreviewSettings, Previewer};

fn previewer(learner: &Learner) -> Previewer {
    Previewer::new(PreviewSettings::default(), learner.models(), learner.weights()).unwrap()
}

/// Share of the previews from step `from` on for which the pen lay inside the claimed band, per predictor of
/// `PredictorKind::BUILT_IN` at `lead`, without cases in which the pen rests before and after.
fn coverage(steps: &[GridStep], lead: usize, from: usize) -> Vec<f64> {
    let mut learner = learner();
    let mut previewer = previewer(&learner);
    let (mut inside, mut cases) = ([0; PredictorKind::BUILT_IN.len()], 0);
    let mut out = vec![[0.0; 2]; lead];
    for (k, step) in steps.iter().enumerate() {
        let learned = previewer.observe(step);
        if learner.learn(&learned).hand_over {
            previewer.set_weights(learner.weights()).unwrap();
        }
        let Some(real) = steps.get(k + lead).filter(|_| k >= from) else { continue };
        let [x, y] = real.position;
        let resting = learned.level <= REST;
        if resting && (x - step.position[0]).hypot(y - step.position[1]) <= learned.level * learned.scale_m {
            continue;
        }
        cases += 1;
        for (inside, kind) in inside.iter_mut().zip(PredictorKind::BUILT_IN) {
            let report = previewer.preview_of(kind, &mut out).unwrap();
            let band = report.bands.at(lead as f64).unwrap();
            let [px, py] = out[lead - 1];
            *inside += i32::from((px - x).hypot(py - y) <= band);
        }
    }
    assert!(cases > 1000);
    inside.map(|inside| f64::from(inside) / f64::from(cases)).to_vec()
}

#[test]
fn nine_of_ten_cases_lie_inside_the_band_of_every_predictor_and_lead() {
    let steps = handwriting(6, 60);
    for lead in [1, 4, 10, BAND_LEADS] {
        let shares = coverage(&steps, lead, 1000);
        println!("lead {lead}: {shares:.3?}");
        for (share, kind) in shares.iter().zip(PredictorKind::BUILT_IN) {
            // Bands of a predictor that still improves are a little too wide.
            let legal = COVERAGE - 0.04..=COVERAGE + 0.06;
            assert!(legal.contains(share), "{kind:?} at lead {lead}: {share}");
        }
    }
}

#[test]
fn the_share_of_misses_obeys_its_bound_whatever_the_pen_does() {
    // A pen that changes its habits permanently every few seconds, the worst case for a quantile estimate.
    let mut learner = learner();
    let mut previewer = previewer(&learner);
    let mut position = [0.0; 2];
    for index in 0..30_000_u64 {
        let wild = (index / 700) % 3;
        let angle = index as f64 * [0.02, 0.3, 1.9][wild as usize];
        let length = [2e-4, 1.5e-3, 6e-4][wild as usize];
        let displacement = [length * angle.cos(), length * angle.sin()];
        position = [position[0] + displacement[0], position[1] + displacement[1]];
        let motion = if index == 0 { Motion::Start } else { Motion::Continues };
        learner.learn(&previewer.observe(&GridStep {
            index,
            position,
            displacement,
            motion,
            contact: true,
            ..GridStep::default()
        }));
    }
    for kind in PredictorKind::BUILT_IN {
        for lead in [1, 8, BAND_LEADS] {
            let (cases, misses) = learner.calibration().judged(kind, lead);
            let share = f64::from(misses) / f64::from(cases);
            // |ln c_T − ln c_0| / (η T) with ln c within ±7, and the larger steps of the beginning.
            let bound = 14.0 / (0.03 * f64::from(cases)) + 0.02;
            assert!(cases > 5000);
            assert!((share - (1.0 - COVERAGE)).abs() < bound, "{kind:?} at {lead}: {share} of {cases}");
        }
    }
}

#[test]
fn bands_widen_with_the_lead_and_a_better_predictor_has_narrower_ones() {
    let steps = handwriting(7, 60);
    let mut learner = learner();
    let mut previewer = previewer(&learner);
    for step in &steps {
        learner.learn(&previewer.observe(step));
    }
    let table = learner.weights().bands;
    for kind in PredictorKind::BUILT_IN {
        let factors = table.of(kind);
        assert!(
            factors[0] > 0.0 && factors[3] > factors[0] && factors[9] > factors[3],
            "{kind:?} {factors:?}"
        );
    }
    let at_lead_8 = |kind| table.of(kind)[7];
    assert!(at_lead_8(PredictorKind::AR_RLS) < 0.7 * at_lead_8(PredictorKind::CONSTANT_VELOCITY));
    assert!(at_lead_8(PredictorKind::CONSTANT_VELOCITY) < at_lead_8(PredictorKind::HOLD));
    // The oracle has none.
    assert_eq!(*table.of(PredictorKind::ORACLE), [0.0; BAND_LEADS]);
}

#[test]
fn there_is_no_band_before_enough_was_seen_and_none_across_a_jump() {
    let steps = handwriting(8, 6);
    let mut learner = learner();
    let mut previewer = previewer(&learner);
    let mut out = [[0.0; 2]; 4];
    for step in &steps[..40] {
        learner.learn(&previewer.observe(step));
        previewer.set_weights(learner.weights()).unwrap();
        let report = previewer.preview_of(PredictorKind::AR_RLS, &mut out).unwrap();
        assert_eq!(report.bands.at(4.0), None);
    }
    let judged = learner.calibration().judged(PredictorKind::HOLD, 1);
    // Only jumps from here on: no case is judged.
    for step in &steps[40..200] {
        let jump = GridStep { motion: Motion::Jump, displacement: [0.1, 0.1], ..*step };
        learner.learn(&previewer.observe(&jump));
    }
    assert_eq!(learner.calibration().judged(PredictorKind::HOLD, 1), judged);
}
