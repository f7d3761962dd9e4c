//! The learner on made-up handwriting: it beats its start, promotes only what is better, rolls back what is worse.
//! The preset was chosen on real recordings (UNIPEN train writers); the numbers stand in `LearnerSettings::preset`.

use foretrace_control::learn::{
    Leads, LearnError, LearnStep, Learner, LearnerSettings, PromotionCause, Rule, Versus,
};
use foretrace_control::pen::{GridStep, Motion};
use foretrace_control::predict::{
    DybmWeights, InitialWeights, ModelParameters, OnlineWeights, Optimiser, PredictorKind, PreviewSettings,
    Previewer,
};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const STEP_NS: u64 = 10_000_000;

/// Compared over leads of 1 to 10 steps.
fn preset() -> LearnerSettings {
    LearnerSettings::preset(STEP_NS, 0)
}

fn with(dybm: DybmWeights) -> OnlineWeights {
    OnlineWeights { dybm, ..preset().models.initial_weights() }
}

fn previewer(learner: &Learner) -> Previewer {
    Previewer::new(PreviewSettings::default(), &learner.settings().models, learner.weights()).unwrap()
}

/// Candidate against live weights of the linear DyBM.
fn errors_of(learner: &Learner) -> Versus {
    learner.errors(PredictorKind::Dybm).candidate
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
    let mut previewer = previewer(&learner);
    let mut sums = [0.0; 3];
    let mut out = vec![[0.0; 2]; lead];
    for (k, step) in steps.iter().enumerate() {
        let learned = previewer.observe(step);
        if learner.learn(&learned).hand_over {
            previewer.set_weights(learner.weights()).unwrap();
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
        assert!(learner.counters().courses.promotions > 0);
    }
}

#[test]
fn papers_zero_start_learns_as_well_but_later() {
    let steps = handwriting(2, 30);
    let mut zero = preset();
    zero.models.initial = InitialWeights::Zero;
    let ([hold, _, from_zero], _) = errors(&steps, &zero, 10, 700);
    let (_, learner) = errors(&steps, &zero, 10, 700);
    assert!(from_zero < hold, "{from_zero} {hold}");
    assert!(learner.counters().courses.promotions > 0);
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
    let mut previewer = previewer(&learner);
    let mut version = learner.weights().version;
    let (mut promotions, mut rollbacks) = (0, 0);
    for step in &steps {
        let before = *learner.weights();
        let lesson = learner.learn(&previewer.observe(step));
        if !lesson.hand_over {
            assert_eq!(before, *learner.weights(), "the set of weights changes only when it is handed over");
        }
        if lesson.promotions().next().is_none() {
            assert_eq!(before.dybm, learner.weights().dybm, "live weights change only by a promotion");
        }
        for promotion in lesson.promotions() {
            assert!(
                lesson.hand_over && promotion.version > version && promotion.model == PredictorKind::Dybm
            );
            version = promotion.version;
            learner.weights().validate().unwrap();
            assert_eq!(promotion.version, learner.weights().dybm.version());
            match promotion.cause {
                PromotionCause::Improved => {
                    assert!(promotion.error_coming < preset().rule.promote_ratio * promotion.error_leaving);
                    promotions += 1;
                }
                PromotionCause::RolledBack => {
                    assert!(promotion.error_leaving > preset().rule.rollback_ratio * promotion.error_coming);
                    rollbacks += 1;
                }
                PromotionCause::Followed => panic!("the linear DyBM is settled"),
            }
        }
    }
    let counters = learner.counters();
    assert_eq!((counters.courses.promotions, counters.courses.rollbacks), (promotions, rollbacks));
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
            LearnStep { index: first_index + i as u64, x, motion, contact: true, ..LearnStep::default() }
        })
        .collect()
}

/// The preset with a learning rate of zero: a proposed candidate stays what it is.
fn frozen() -> LearnerSettings {
    let mut settings = preset();
    settings.models.dybm.optimiser = Optimiser::ada_grad(0.0);
    settings
}

#[test]
fn weights_that_turn_out_worse_are_rolled_back_to_their_predecessor() {
    let mut learner = Learner::new(frozen()).unwrap();
    let start = learner.weights().dybm;
    // A world that turns back at every step, and a candidate that knows it: promoted.
    learner.propose(&with(DybmWeights::persistent(STEP_NS, start.shape, -0.8))).unwrap();
    let mut promotion = None;
    for step in first_order(-0.8, 4000, 0, 7) {
        promotion = learner.learn(&step).promotions().next().map(|change| (step.index, *change));
        if promotion.is_some() {
            break;
        }
    }
    let (promoted_at, change) = promotion.expect("nothing was promoted");
    assert_eq!(change.cause, PromotionCause::Improved);
    let sabotaged = learner.weights().dybm;
    assert_ne!(start.parameters, sabotaged.parameters);
    // The world is as the predecessor believed: what was promoted is wrong now.
    let mut rollback = None;
    for step in first_order(0.9, 4000, promoted_at + 1, 8) {
        if let Some(change) = learner.learn(&step).promotions().next() {
            rollback = Some(*change);
            break;
        }
    }
    let rollback = rollback.expect("no change followed");
    assert_eq!(rollback.cause, PromotionCause::RolledBack);
    let live = learner.weights().dybm;
    assert_eq!((live.parameters, live.version), (start.parameters, rollback.version));
    assert!(live.version > sabotaged.version);
    assert_eq!(learner.candidates().dybm.parameters, live.parameters);
    assert_eq!((learner.counters().courses.promotions, learner.counters().courses.rollbacks), (1, 1));
}

#[test]
fn worse_candidates_are_never_promoted() {
    let settings = frozen();
    let mut learner = Learner::new(settings).unwrap();
    let start = learner.weights().dybm;
    let bad = DybmWeights::persistent(STEP_NS, start.shape, 0.7);
    learner.propose(&with(bad)).unwrap();
    for step in first_order(0.9, 5000, 0, 9) {
        learner.learn(&step);
        assert_eq!(learner.weights().dybm, start);
    }
    let errors = errors_of(&learner);
    assert!(errors.compared > 1000 && errors.challenger > errors.other, "{errors:?}");
    // A much worse one is thrown away.
    let awful = DybmWeights::persistent(STEP_NS, start.shape, -1.0);
    learner.propose(&with(awful)).unwrap();
    for step in first_order(0.9, 1000, 10_000, 9) {
        learner.learn(&step);
        assert_eq!(learner.weights().dybm, start);
    }
    assert_eq!(learner.counters().courses.abandoned, 1);
    assert_eq!(learner.candidates().dybm.parameters, start.parameters);
}

#[test]
fn poisoned_candidates_are_thrown_away_and_never_promoted() {
    // A rate of 10 per parameter makes the candidate leave its bounds by itself.
    let mut settings = preset();
    settings.models.dybm.optimiser = Optimiser::rms_prop(10.0);
    let mut learner = Learner::new(settings).unwrap();
    for step in first_order(0.9, 20_000, 0, 10) {
        learner.learn(&step);
        learner.weights().validate().unwrap();
        learner.candidates().validate().unwrap();
    }
    assert!(learner.counters().courses.poisoned > 0, "{:?}", learner.counters());
}

#[test]
fn poison_from_outside_is_not_even_proposed() {
    let mut learner = Learner::new(preset()).unwrap();
    let (good, candidates) = (*learner.weights(), learner.candidates());
    for value in [f64::NAN, f64::INFINITY, 1e9, -1e300] {
        for poison in poisoned(&good, value) {
            assert!(learner.propose(&poison).is_err(), "{value}");
            assert!(Learner::from_weights(preset(), poison).is_err(), "{value}");
            assert_eq!(learner.candidates(), candidates);
        }
    }
    let other_loop = with(DybmWeights::zero(5_000_000, good.dybm.shape));
    assert!(learner.propose(&other_loop).is_err());
    assert_eq!(learner.candidates(), candidates);
}

/// `good` with one number replaced, once per part.
fn poisoned(good: &OnlineWeights, value: f64) -> [OnlineWeights; 2] {
    let mut sets = [*good; 2];
    sets[0].dybm.parameters.bias[0] = value;
    sets[1].bands.factors[1][4] = value as f32;
    sets
}

#[test]
fn jumps_starts_and_wild_steps_teach_nothing() {
    let mut learner = Learner::new(preset()).unwrap();
    for step in first_order(0.9, 200, 0, 11) {
        learner.learn(&step);
    }
    let before = learner.candidates();
    let updates = learner.counters().updates;
    let step = |index, x, motion| LearnStep { index, x, motion, contact: true, ..LearnStep::default() };
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
        assert_eq!(before.dybm, learner.candidates().dybm, "{lesson:?}");
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
    let compared = errors_of(&learner).compared;
    let judged = learner.calibration().judged(PredictorKind::Dybm, 1).0;
    for index in 100..2000 {
        let still = LearnStep { index, motion: Motion::Continues, ..LearnStep::default() };
        assert_eq!(learner.learn(&still).promotions().next(), None);
    }
    assert!(errors_of(&learner).compared <= compared + preset().leads.last() as u32);
    assert!(learner.calibration().judged(PredictorKind::Dybm, 1).0 <= judged + 1);
}

#[test]
fn same_steps_make_the_same_weights() {
    let steps = handwriting(4, 10);
    let (_, one) = errors(&steps, &preset(), 4, 0);
    let (_, other) = errors(&steps, &preset(), 10, 0);
    assert_eq!(one.weights(), other.weights());
    assert_eq!(one.candidates(), other.candidates());
}

#[test]
fn settings_out_of_bounds_are_refused() {
    let good = preset();
    let rule = good.rule;
    for bad in [
        LearnerSettings { rule: Rule { memory_steps: f64::NAN, ..rule }, ..good },
        LearnerSettings { rule: Rule { min_evidence: 0, ..rule }, ..good },
        LearnerSettings { rule: Rule { promote_ratio: 1.5, ..rule }, ..good },
        LearnerSettings { rule: Rule { rollback_ratio: 0.5, ..rule }, ..good },
        LearnerSettings { rule: Rule { follow_steps: 0, ..rule }, ..good },
        LearnerSettings { max_learned: 0.0, ..good },
    ] {
        assert!(Learner::new(bad).is_err(), "{bad:?}");
    }
    let mut bad = good;
    bad.models.initial = InitialWeights::Persistent(f64::NAN);
    assert!(Learner::new(bad).is_err());
    assert!(Leads::new(0, 10).is_err());
    let other_loop = with(DybmWeights::zero(5_000_000, good.models.dybm.shape));
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
            learner.learn(&LearnStep { index, x: [x, y], motion, ..LearnStep::default() });
            prop_assert!(learner.candidates().validate().is_ok() && learner.weights().validate().is_ok());
            let counters = learner.counters();
            prop_assert_eq!(
                counters.received,
                counters.updates + counters.unlearned + counters.interruptions + counters.refused
            );
        }
    }
}
