//! The learner on made-up handwriting: it beats its start, promotes only what is better, rolls back what is worse.
//! The preset was chosen on real recordings (UNIPEN train writers); the numbers stand in `LearnerSettings::preset`.

use foretrace_control::learn::{
    InitialWeights, LearnError, LearnStep, Learner, LearnerSettings, MAX_LEAD, PromotionCause,
};
use foretrace_control::pen::{GridStep, Motion};
use foretrace_control::predict::{
    DybmWeights, ModelParameters, Optimiser, PredictorKind, PreviewSettings, Previewer,
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const STEP_NS: u64 = 10_000_000;

fn preset() -> LearnerSettings {
    LearnerSettings::preset(STEP_NS)
}

/// Strokes made of overlapping bell-shaped speed pulses in changing directions (the kinematic view of handwriting),
/// each followed by a rest; `strokes` of them at 10 ms.
fn handwriting(seed: u64, strokes: usize) -> Vec<GridStep> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut velocity = Vec::new();
    for _ in 0..strokes {
        let pulses = rng.random_range(3..8);
        let begin = velocity.len();
        velocity.resize(begin + 12 * pulses + 45, [0.0_f64; 2]);
        for pulse in 0..pulses {
            let (angle, width) =
                (rng.random_range(0.0..std::f64::consts::TAU), rng.random_range(4.0..8.0_f64));
            let centre = 20.0 + 12.0 * pulse as f64 + rng.random_range(-3.0..3.0_f64);
            let speed = rng.random_range(0.5e-3..2.5e-3_f64);
            for (k, v) in velocity[begin..].iter_mut().enumerate() {
                let bell = speed * (-0.5 * ((k as f64 - centre) / width).powi(2)).exp();
                *v = [v[0] + bell * angle.cos(), v[1] + bell * angle.sin()];
            }
        }
    }
    path(&velocity)
}

fn path(displacements: &[[f64; 2]]) -> Vec<GridStep> {
    let mut position = [0.0; 2];
    (0..)
        .zip(displacements)
        .map(|(index, displacement)| {
            position = [position[0] + displacement[0], position[1] + displacement[1]];
            let motion = if index == 0 { Motion::Start } else { Motion::Continues };
            GridStep { index, position, displacement: *displacement, motion, contact: true }
        })
        .collect()
}

/// RMS position error [m] per predictor (hold, constant velocity, dybm) at `lead` steps, from step `from` on.
fn errors(steps: &[GridStep], settings: &LearnerSettings, lead: usize, from: usize) -> ([f64; 3], Learner) {
    let mut learner = Learner::new(*settings).unwrap();
    let mut previewer = Previewer::new(PreviewSettings::default(), *learner.live()).unwrap();
    let mut sums = [0.0; 3];
    let mut out = vec![[0.0; 2]; lead];
    for (k, step) in steps.iter().enumerate() {
        let learned = previewer.observe(step);
        if let Some(promotion) = learner.learn(&learned) {
            previewer.set_weights(&promotion.weights).unwrap();
        }
        let Some(real) = steps.get(k + lead).filter(|_| k >= from) else { continue };
        let kinds = [PredictorKind::Hold, PredictorKind::ConstantVelocity, PredictorKind::Dybm];
        for (sum, kind) in sums.iter_mut().zip(kinds) {
            previewer.preview_of(kind, &mut out).unwrap();
            let [x, y] = out[lead - 1];
            *sum += (x - real.position[0]).powi(2) + (y - real.position[1]).powi(2);
        }
    }
    let count = (steps.len() - lead - from) as f64;
    (sums.map(|sum: f64| (sum / count).sqrt()), learner)
}

#[test]
fn learned_dybm_beats_hold_and_constant_velocity_on_every_lead() {
    let steps = handwriting(1, 60);
    // Scored after the first six strokes.
    for lead in [1, 4, 10, 16] {
        let ([hold, constant, dybm], learner) = errors(&steps, &preset(), lead, 700);
        println!("lead {lead}: hold {hold:.2e} m, constant velocity {constant:.2e} m, dybm {dybm:.2e} m");
        assert!(dybm < 0.95 * constant && dybm < 0.95 * hold, "lead {lead}: {hold} {constant} {dybm}");
        assert!(learner.counters().promotions > 0);
    }
}

#[test]
fn papers_zero_start_learns_as_well_but_later() {
    let steps = handwriting(2, 30);
    let zero = LearnerSettings { initial: InitialWeights::Zero, ..preset() };
    let ([hold, _, from_zero], _) = errors(&steps, &zero, 10, 700);
    let (_, learner) = errors(&steps, &zero, 10, 700);
    assert!(from_zero < hold, "{from_zero} {hold}");
    assert!(learner.counters().promotions > 0);
    // While nothing is promoted yet, the persistent start is ahead.
    let early = &steps[..100];
    let ([_, _, zero_early], _) = errors(early, &zero, 4, 0);
    let ([_, _, persistent_early], _) = errors(early, &preset(), 4, 0);
    assert!(persistent_early < 0.7 * zero_early, "{persistent_early} {zero_early}");
}

#[test]
fn what_is_promoted_was_better_in_the_shadow_and_has_a_new_version() {
    let steps = handwriting(3, 60);
    let mut learner = Learner::new(preset()).unwrap();
    let mut previewer = Previewer::new(PreviewSettings::default(), *learner.live()).unwrap();
    let mut version = learner.live().version;
    let (mut promotions, mut rollbacks) = (0, 0);
    for step in &steps {
        let before = *learner.live();
        let Some(promotion) = learner.learn(&previewer.observe(step)) else {
            assert_eq!(before, *learner.live(), "live weights change only by a promotion");
            continue;
        };
        assert!(promotion.weights.version > version);
        version = promotion.weights.version;
        promotion.weights.validate().unwrap();
        assert_eq!(promotion.weights, *learner.live());
        match promotion.cause {
            PromotionCause::Improved => {
                assert!(promotion.error_coming < preset().promote_ratio * promotion.error_leaving);
                promotions += 1;
            }
            PromotionCause::RolledBack => {
                assert!(promotion.error_leaving > preset().rollback_ratio * promotion.error_coming);
                rollbacks += 1;
            }
        }
    }
    let counters = learner.counters();
    assert_eq!((counters.promotions, counters.rollbacks), (promotions, rollbacks));
    assert_eq!(counters.received, steps.len() as u64);
    assert!(promotions > 0);
}

/// Steps of a signal whose next displacement is `factor` times the last, kicked every 12 steps; normalised.
fn first_order(factor: f64, count: usize, first_index: u64, seed: u64) -> Vec<LearnStep> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut x = [0.0_f64; 2];
    (0..count)
        .map(|i| {
            x = x.map(|x| factor * x);
            if i % 12 == 0 {
                x = [rng.random_range(-20.0..20.0), rng.random_range(-20.0..20.0)];
            }
            let motion = if i == 0 { Motion::Start } else { Motion::Continues };
            LearnStep { index: first_index + i as u64, x, motion, contact: true, scale_m: 1e-4 }
        })
        .collect()
}

/// The preset with a learning rate of zero: a proposed candidate stays what it is.
fn frozen() -> LearnerSettings {
    let mut settings = preset();
    settings.dybm.optimiser = Optimiser::ada_grad(0.0);
    settings
}

#[test]
fn weights_that_turn_out_worse_are_rolled_back_to_their_predecessor() {
    let mut learner = Learner::new(frozen()).unwrap();
    let start = *learner.live();
    // A world that turns back at every step, and a candidate that knows it: promoted.
    learner.propose(&DybmWeights::persistent(STEP_NS, start.shape, -0.8)).unwrap();
    let mut promotion = None;
    for step in first_order(-0.8, 4000, 0, 7) {
        promotion = learner.learn(&step).map(|change| (step.index, change));
        if promotion.is_some() {
            break;
        }
    }
    let (promoted_at, change) = promotion.expect("nothing was promoted");
    assert_eq!(change.cause, PromotionCause::Improved);
    let sabotaged = *learner.live();
    assert_ne!(start.parameters, sabotaged.parameters);
    // The world is as the predecessor believed: what was promoted is wrong now.
    let mut rollback = None;
    for step in first_order(0.9, 4000, promoted_at + 1, 8) {
        if let Some(change) = learner.learn(&step) {
            rollback = Some(change);
            break;
        }
    }
    let rollback = rollback.expect("no change followed");
    assert_eq!(rollback.cause, PromotionCause::RolledBack);
    assert_eq!(rollback.weights.parameters, start.parameters);
    assert!(rollback.weights.version > sabotaged.version);
    assert_eq!(*learner.candidate(), rollback.weights);
    assert_eq!((learner.counters().promotions, learner.counters().rollbacks), (1, 1));
}

#[test]
fn worse_candidates_are_never_promoted() {
    let settings = frozen();
    let mut learner = Learner::new(settings).unwrap();
    let bad = DybmWeights::persistent(STEP_NS, settings.dybm.shape, 0.7);
    learner.propose(&bad).unwrap();
    for step in first_order(0.9, 5000, 0, 9) {
        assert_eq!(learner.learn(&step), None);
    }
    assert!(learner.errors().compared > 1000 && learner.errors().candidate > learner.errors().live);
    // A much worse one is thrown away.
    let awful = DybmWeights::persistent(STEP_NS, settings.dybm.shape, -1.0);
    learner.propose(&awful).unwrap();
    for step in first_order(0.9, 1000, 10_000, 9) {
        assert_eq!(learner.learn(&step), None);
    }
    assert_eq!(learner.counters().abandoned, 1);
    assert_eq!(learner.candidate().parameters, learner.live().parameters);
}

#[test]
fn poisoned_candidates_are_thrown_away_and_never_promoted() {
    // A rate of 10 per parameter makes the candidate leave its bounds by itself.
    let mut settings = preset();
    settings.dybm.optimiser = Optimiser::rms_prop(10.0);
    let mut learner = Learner::new(settings).unwrap();
    for step in first_order(0.9, 20_000, 0, 10) {
        if let Some(promotion) = learner.learn(&step) {
            promotion.weights.validate().unwrap();
        }
        learner.candidate().validate().unwrap();
    }
    assert!(learner.counters().poisoned > 0, "{:?}", learner.counters());
    // Poison from outside is not even proposed.
    let mut poison = *learner.live();
    poison.parameters.bias[0] = f64::NAN;
    assert!(learner.propose(&poison).is_err());
    assert!(Learner::from_weights(settings, poison).is_err());
}

#[test]
fn jumps_starts_and_wild_steps_teach_nothing() {
    let mut learner = Learner::new(preset()).unwrap();
    for step in first_order(0.9, 200, 0, 11) {
        learner.learn(&step);
    }
    let before = *learner.candidate();
    let updates = learner.counters().updates;
    let step = |index, x, motion| LearnStep { index, x, motion, contact: true, scale_m: 1e-4 };
    for lesson in [
        step(200, [5.0, 5.0], Motion::Jump),
        step(201, [5.0, 5.0], Motion::Start),
        step(202, [f64::NAN, 5.0], Motion::Continues),
        step(203, [5.0, f64::INFINITY], Motion::Continues),
        step(204, [1000.0, 0.0], Motion::Continues),
        step(300, [5.0, 5.0], Motion::Continues),
        step(u64::MAX, [5.0, 5.0], Motion::Continues),
        step(0, [5.0, 5.0], Motion::Continues),
    ] {
        learner.learn(&lesson);
        assert_eq!(before.parameters, learner.candidate().parameters, "{lesson:?}");
    }
    let counters = learner.counters();
    assert_eq!(counters.updates, updates);
    assert_eq!((counters.refused, counters.unlearned), (2, 1));
    assert_eq!(
        counters.received,
        counters.updates + counters.unlearned + counters.interruptions + counters.refused
    );
}

#[test]
fn pauses_are_no_evidence() {
    let mut learner = Learner::new(preset()).unwrap();
    for step in first_order(0.9, 100, 0, 12) {
        learner.learn(&step);
    }
    let compared = learner.errors().compared;
    for index in 100..2000 {
        let still = LearnStep { index, x: [0.0; 2], motion: Motion::Continues, contact: true, scale_m: 1e-4 };
        assert_eq!(learner.learn(&still), None);
    }
    assert!(learner.errors().compared <= compared + preset().lead_steps as u32);
}

#[test]
fn same_steps_make_the_same_weights() {
    let steps = handwriting(4, 10);
    let (_, one) = errors(&steps, &preset(), 4, 0);
    let (_, other) = errors(&steps, &preset(), 10, 0);
    assert_eq!(one.live(), other.live());
    assert_eq!(one.candidate(), other.candidate());
}

#[test]
fn settings_out_of_bounds_are_refused() {
    let good = preset();
    for bad in [
        LearnerSettings { lead_steps: 0, ..good },
        LearnerSettings { lead_steps: MAX_LEAD + 1, ..good },
        LearnerSettings { memory_steps: f64::NAN, ..good },
        LearnerSettings { min_evidence: 0, ..good },
        LearnerSettings { promote_ratio: 1.5, ..good },
        LearnerSettings { rollback_ratio: 0.5, ..good },
        LearnerSettings { max_learned: 0.0, ..good },
        LearnerSettings { initial: InitialWeights::Persistent(f64::NAN), ..good },
    ] {
        assert!(Learner::new(bad).is_err(), "{bad:?}");
    }
    let other_loop = DybmWeights::zero(5_000_000, good.dybm.shape);
    assert!(matches!(Learner::from_weights(good, other_loop), Err(LearnError::Weights(_))));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn hostile_steps_never_make_bad_weights(
        steps in proptest::collection::vec(
            (0..3_u64, prop_oneof![8 => -100.0..100.0_f64, 1 => any::<f64>()], any::<f64>(), 0..10_u8), 1..500)
    ) {
        let mut learner = Learner::new(preset()).unwrap();
        let mut index = 0;
        for (advance, x, wild, kind) in steps {
            index += if kind < 8 { 1 } else { advance };
            let motion = match kind { 0 => Motion::Start, 1 => Motion::Jump, _ => Motion::Continues };
            let y = if kind == 9 { wild } else { -x };
            learner.learn(&LearnStep { index, x: [x, y], motion, contact: false, scale_m: 1e-4 });
            prop_assert!(learner.candidate().validate().is_ok() && learner.live().validate().is_ok());
            let counters = learner.counters();
            prop_assert_eq!(
                counters.received,
                counters.updates + counters.unlearned + counters.interruptions + counters.refused
            );
        }
    }
}
