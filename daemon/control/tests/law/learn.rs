//! The learner on synthetic handwriting: it beats its start, promotes only what is better, rolls back what is
//! worse. The preset was chosen on real recordings (UNIPEN train writers), see `LearnerSettings::preset`.

use crate::support;

use crate::support::strokes::{first_order, handwriting};
use crate::support::{STEP_NS, learner, models_with_network as models, preset, with_dybm as with};
use foretrace_control::learn::{CourseCounters, Learner, Lesson, Promotion, PromotionCause, Versus};
use foretrace_control::pen::{GridStep, Motion};
use foretrace_control::predict::LearnStep;
use foretrace_control::predict::{
    DybmWeights, InitialWeights, ModelParameters, ModelSettings, Models, Networks, Optimiser, PredictorKind,
    PreviewSettings, Previewer,
};

fn previewer(learner: &Learner) -> Previewer {
    Previewer::new(PreviewSettings::default(), learner.models(), learner.weights()).unwrap()
}

/// Candidate against live weights of the linear DyBM.
fn errors_of(learner: &Learner) -> Versus {
    learner.errors(PredictorKind::DYBM).candidate
}

/// RMS position error \[m\] per predictor (hold, constant velocity, dybm) at `lead` steps, from step `from`
/// on.
fn errors(steps: &[GridStep], models: &Models, lead: usize, from: usize) -> ([f64; 3], Learner) {
    let mut learner = Learner::new(preset(), models).unwrap();
    let mut previewer = previewer(&learner);
    let mut sums = [0.0; 3];
    let mut out = vec![[0.0; 2]; lead];
    for (k, step) in steps.iter().enumerate() {
        let learned = previewer.observe(step);
        if learner.learn(&learned).hand_over {
            previewer.set_weights(learner.weights()).unwrap();
        }
        let Some(real) = steps.get(k + lead).filter(|_| k >= from) else { continue };
        let kinds = [PredictorKind::HOLD, PredictorKind::CONSTANT_VELOCITY, PredictorKind::DYBM];
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
        let ([hold, constant, dybm], learner) = errors(&steps, &models(), lead, 700);
        println!("lead {lead}: hold {hold:.2e} m, constant velocity {constant:.2e} m, dybm {dybm:.2e} m");
        assert!(dybm < 0.95 * constant && dybm < 0.95 * hold, "lead {lead}: {hold} {constant} {dybm}");
        assert!(learner.counters_of(PredictorKind::DYBM).promotions > 0);
    }
}

#[test]
fn papers_zero_start_learns_as_well_but_later() {
    let steps = handwriting(2, 30);
    let zero = ModelSettings { initial: InitialWeights::Zero, ..ModelSettings::preset(STEP_NS) };
    let zero = Models::new(zero, Networks::default()).unwrap();
    let ([hold, _, from_zero], _) = errors(&steps, &zero, 10, 700);
    let (_, learner) = errors(&steps, &zero, 10, 700);
    assert!(from_zero < hold, "{from_zero} {hold}");
    assert!(learner.counters_of(PredictorKind::DYBM).promotions > 0);
    // While nothing is promoted yet, the persistent start is ahead.
    let early = &steps[..100];
    let ([_, _, zero_early], _) = errors(early, &zero, 4, 0);
    let ([_, _, persistent_early], _) = errors(early, &models(), 4, 0);
    assert!(persistent_early < 0.7 * zero_early, "{persistent_early} {zero_early}");
}

#[test]
fn what_is_promoted_was_better_in_the_shadow_and_has_a_new_version() {
    let steps = handwriting(3, 60);
    let mut learner = learner();
    let mut previewer = previewer(&learner);
    let (mut promotions, mut rollbacks) = (0, 0);
    for step in &steps {
        let before = *learner.weights();
        let lesson = learner.learn(&previewer.observe(step));
        if !lesson.hand_over {
            assert_eq!(before, *learner.weights(), "the set of weights changes only when it is handed over");
        }
        let after = *learner.weights();
        let changed = [
            (PredictorKind::DYBM, before.dybm.version(), after.dybm.version()),
            (PredictorKind::DYBM_ESN, before.dybm_esn.version(), after.dybm_esn.version()),
            (PredictorKind::AR_RLS, before.ar_rls.version(), after.ar_rls.version()),
            (PredictorKind::MIXTURE, before.mixture.version(), after.mixture.version()),
        ];
        for (model, was, is) in changed {
            let told = lesson.promotions().find(|promotion| promotion.model == model);
            assert_eq!(told.map_or(was, |promotion| promotion.version), is, "{model:?}");
        }
        for promotion in lesson.promotions() {
            assert!(lesson.hand_over && promotion.version > before.version);
            assert_eq!(promotion.version, learner.weights().version);
            learner.weights().validate().unwrap();
            match promotion.cause {
                PromotionCause::Improved => {
                    assert!(promotion.error_coming < preset().rule.promote_ratio * promotion.error_leaving);
                    promotions += 1;
                }
                PromotionCause::RolledBack => {
                    assert!(promotion.error_leaving > preset().rule.rollback_ratio * promotion.error_coming);
                    rollbacks += 1;
                }
                PromotionCause::Followed => {
                    assert!(matches!(promotion.model, PredictorKind::AR_RLS | PredictorKind::MIXTURE));
                    assert!(promotion.error_coming <= 1.02 * promotion.error_leaving);
                    promotions += 1;
                }
            }
        }
    }
    let counters = learner.counters();
    assert_eq!((counters.courses.promotions, counters.courses.rollbacks), (promotions, rollbacks));
    assert_eq!(counters.received, steps.len() as u64);
    assert!(promotions > 0);
}

/// The change of the linear DyBM's weights, if there was one.
fn of_dybm(lesson: &Lesson) -> Option<Promotion> {
    lesson.promotions().find(|promotion| promotion.model == PredictorKind::DYBM).copied()
}

/// The preset with a learning rate of zero: a proposed candidate stays what it is.
fn frozen() -> Learner {
    let mut settings = ModelSettings::preset(STEP_NS);
    settings.dybm.optimiser = Optimiser::ada_grad(0.0);
    Learner::new(preset(), &Models::new(settings, support::networks(STEP_NS)).unwrap()).unwrap()
}

#[test]
fn weights_that_turn_out_worse_are_rolled_back_to_their_predecessor() {
    let mut learner = frozen();
    let start = learner.weights().dybm;
    // Motion that turns back at every step, and a candidate that knows it: promoted.
    learner.propose(&with(DybmWeights::persistent(STEP_NS, start.shape, -0.8))).unwrap();
    let mut promotion = None;
    for step in first_order(-0.8, 4000, 0, 7) {
        promotion = of_dybm(&learner.learn(&step)).map(|change| (step.index, change));
        if promotion.is_some() {
            break;
        }
    }
    let (promoted_at, change) = promotion.expect("nothing was promoted");
    assert_eq!(change.cause, PromotionCause::Improved);
    let sabotaged = learner.weights().dybm;
    assert_ne!(start.parameters, sabotaged.parameters);
    // Motion as the predecessor predicts: the promoted weights are wrong now.
    let mut rollback = None;
    for step in first_order(0.9, 4000, promoted_at + 1, 8) {
        rollback = of_dybm(&learner.learn(&step));
        if rollback.is_some() {
            break;
        }
    }
    let rollback = rollback.expect("no change followed");
    assert_eq!(rollback.cause, PromotionCause::RolledBack);
    let live = learner.weights().dybm;
    assert_eq!((live.parameters, live.version), (start.parameters, rollback.version));
    assert!(live.version > sabotaged.version);
    assert_eq!(learner.candidates().dybm.parameters, live.parameters);
    let counters = learner.counters_of(PredictorKind::DYBM);
    assert_eq!((counters.promotions, counters.rollbacks), (1, 1));
}

#[test]
fn worse_candidates_are_never_promoted() {
    let mut learner = frozen();
    let start = learner.weights().dybm;
    let bad = DybmWeights::persistent(STEP_NS, start.shape, 0.7);
    learner.propose(&with(bad)).unwrap();
    for step in first_order(0.9, 5000, 0, 9) {
        learner.learn(&step);
        assert_eq!(learner.weights().dybm, start);
    }
    let errors = errors_of(&learner);
    assert!(errors.compared > 1000 && errors.challenger > errors.other, "{errors:?}");
    // A much worse one is discarded.
    let awful = DybmWeights::persistent(STEP_NS, start.shape, -1.0);
    learner.propose(&with(awful)).unwrap();
    for step in first_order(0.9, 1000, 10_000, 9) {
        learner.learn(&step);
        assert_eq!(learner.weights().dybm, start);
    }
    assert_eq!(learner.counters_of(PredictorKind::DYBM).abandoned, 1);
    assert_eq!(learner.candidates().dybm.parameters, start.parameters);
}

#[test]
fn pauses_are_no_evidence() {
    let mut learner = learner();
    for step in first_order(0.9, 100, 0, 12) {
        learner.learn(&step);
    }
    let compared = errors_of(&learner).compared;
    let judged = learner.calibration().judged(PredictorKind::DYBM, 1).0;
    for index in 100..2000 {
        let still = LearnStep { index, motion: Motion::Continues, ..LearnStep::default() };
        assert!(learner.learn(&still).promotions().all(|change| change.cause == PromotionCause::Followed));
    }
    assert!(errors_of(&learner).compared <= compared + preset().leads.last() as u32);
    assert!(learner.calibration().judged(PredictorKind::DYBM, 1).0 <= judged + 1);
}

#[test]
fn same_steps_make_the_same_weights() {
    let steps = handwriting(4, 10);
    let (_, one) = errors(&steps, &models(), 4, 0);
    let (_, other) = errors(&steps, &models(), 10, 0);
    assert_eq!(one.weights(), other.weights());
    assert_eq!(one.candidates(), other.candidates());
}

#[test]
fn least_squares_follows_its_candidate_and_beats_constant_velocity() {
    let steps = handwriting(5, 40);
    let mut learner = learner();
    let mut previewer = previewer(&learner);
    let (mut sums, mut out) = ([0.0; 2], [[0.0; 2]; 8]);
    for (k, step) in steps.iter().enumerate() {
        if learner.learn(&previewer.observe(step)).hand_over {
            previewer.set_weights(learner.weights()).unwrap();
        }
        let Some(real) = steps.get(k + 8).filter(|_| k >= 300) else { continue };
        for (sum, kind) in sums.iter_mut().zip([PredictorKind::CONSTANT_VELOCITY, PredictorKind::AR_RLS]) {
            previewer.preview_of(kind, &mut out).unwrap();
            *sum += (out[7][0] - real.position[0]).powi(2) + (out[7][1] - real.position[1]).powi(2);
        }
    }
    println!("RMS ratio of AR-RLS to constant velocity {}", (sums[1] / sums[0]).sqrt());
    assert!(sums[1] < 0.5 * sums[0], "{sums:?}");
    let counters = learner.counters_of(PredictorKind::AR_RLS);
    assert!(counters.promotions > 100 && counters.rollbacks == 0, "{counters:?}");
    assert!(learner.counters_of(PredictorKind::DYBM).promotions < 20);
}

#[test]
fn a_wrong_candidate_of_least_squares_is_not_followed() {
    let mut learner = learner();
    for step in first_order(0.9, 3000, 0, 20) {
        learner.learn(&step);
    }
    let counters = learner.counters_of(PredictorKind::AR_RLS);
    assert!(counters.promotions > 100, "{counters:?}");
    let good = learner.weights().ar_rls.coefficients[0][0][0];
    assert!((good - 0.9).abs() < 0.1, "{good}");
    let mut wrong = *learner.weights();
    wrong.ar_rls.coefficients[0] = [[-0.9, 0.0], [0.0, -0.9]];
    let before = learner.weights().ar_rls;
    learner.propose(&wrong).unwrap();
    for step in first_order(0.9, 25, 3000, 99) {
        learner.learn(&step);
    }
    let live = learner.weights().ar_rls;
    assert!((live.coefficients[0][0][0] - before.coefficients[0][0][0]).abs() < 0.1, "{live:?}");
}

#[test]
fn counters_of_several_models_add_up_each_for_itself() {
    let each =
        |n| CourseCounters { promotions: n, rollbacks: 10 * n, poisoned: 100 * n, abandoned: 1000 * n };
    assert_eq!([1, 2, 4].map(each).into_iter().sum::<CourseCounters>(), each(7));
    assert_eq!([].into_iter().sum::<CourseCounters>(), each(0));
}
