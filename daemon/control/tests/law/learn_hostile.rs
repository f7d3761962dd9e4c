//! The learner with hostile inputs: nothing that is non-finite, too large or made for another loop ever
//! becomes live.

use crate::support;

use crate::support::strokes::{first_order, on_paper};
use crate::support::{STEP_NS, learner, models_with_network as models, preset, with_dybm as with};
use foretrace_control::learn::{Leads, LearnError, Learner, LearnerSettings, Rule};
use foretrace_control::pen::Motion;
use foretrace_control::predict::{
    DybmWeights, InitialWeights, LearnStep, ModelSettings, Models, Networks, OnlineWeights, Optimiser,
    PenStep, PredictorKind,
};
use proptest::prelude::*;

#[test]
fn poisoned_candidates_are_thrown_away_and_never_promoted() {
    // A rate of 10 per parameter makes the candidate leave its bounds by itself.
    let mut settings = ModelSettings::preset(STEP_NS);
    settings.dybm.optimiser = Optimiser::rms_prop(10.0);
    let mut learner = Learner::new(preset(), &Models::new(settings, Networks::default()).unwrap()).unwrap();
    for step in first_order(0.9, 20_000, 0, 10) {
        learner.learn(&step);
        learner.weights().validate().unwrap();
        learner.candidates().validate().unwrap();
    }
    for model in [PredictorKind::DYBM, PredictorKind::DYBM_ESN] {
        assert!(learner.counters_of(model).poisoned > 0, "{model:?}: {:?}", learner.counters_of(model));
    }
}

#[test]
fn poison_from_outside_is_not_even_proposed() {
    let mut learner = learner();
    let (good, candidates) = (*learner.weights(), learner.candidates());
    for value in [f64::NAN, f64::INFINITY, 1e9, -1e300] {
        for poison in poisoned(&good, value) {
            assert!(learner.propose(&poison).is_err(), "{value}");
            assert!(Learner::from_weights(preset(), learner.models(), poison).is_err(), "{value}");
            assert_eq!(learner.candidates(), candidates);
        }
    }
    let other_loop = with(DybmWeights::zero(5_000_000, good.dybm.shape));
    assert!(learner.propose(&other_loop).is_err());
    assert_eq!(learner.candidates(), candidates);
}

/// `good` with one number replaced, once per part.
fn poisoned(good: &OnlineWeights, value: f64) -> [OnlineWeights; 5] {
    let mut sets = [*good; 5];
    sets[0].dybm.parameters.bias[0] = value;
    sets[1].bands.factors[1][4] = value as f32;
    sets[2].dybm_esn.readout[49][1] = value;
    sets[3].ar_rls.coefficients[7][1][0] = value;
    sets[4].mixture.ar.coefficients[0][1][0] = value;
    sets
}

#[test]
fn jumps_starts_and_wild_steps_teach_nothing() {
    let mut learner = learner();
    for step in first_order(0.9, 200, 0, 11) {
        learner.learn(&step);
    }
    let before = learner.candidates();
    let updates = learner.counters().updates;
    let step = |index, x, motion| LearnStep { index, motion, pen: on_paper(x), ..LearnStep::default() };
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
        let after = learner.candidates();
        assert_eq!((before.dybm, before.dybm_esn), (after.dybm, after.dybm_esn), "{lesson:?}");
        assert_eq!((before.ar_rls, before.mixture), (after.ar_rls, after.mixture), "{lesson:?}");
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
        assert!(Learner::new(bad, &models()).is_err(), "{bad:?}");
    }
    let models = models();
    let other_loop = with(DybmWeights::zero(5_000_000, models.settings().dybm.shape));
    assert!(matches!(Learner::from_weights(good, &models, other_loop), Err(LearnError::Weights(_))));
    assert!(Leads::new(0, 10).is_err());
}

#[test]
fn models_that_cannot_be_built_are_refused() {
    let good = ModelSettings::preset(STEP_NS);
    let mut bad = [good; 4];
    bad[0].initial = InitialWeights::Persistent(f64::NAN);
    bad[1].dybm.shape.delay = 1;
    bad[2].reservoir.leak = 2.0;
    bad[3].ar_rls.forgetting = 0.5;
    for bad in bad {
        assert!(Models::new(bad, Networks::default()).is_err(), "{bad:?}");
    }
    let error = Models::new(good, support::networks(5_000_000)).unwrap_err().to_string();
    assert!(error.contains("5000000") && error.contains("10000000"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn hostile_steps_never_make_bad_weights(
        steps in proptest::collection::vec(
            (0..3_u64, prop_oneof![8 => -100.0..100.0_f64, 1 => any::<f64>()], any::<f64>(), 0..10_u8),
                1..500)
    ) {
        let mut learner = learner();
        let mut index = 0;
        for (advance, x, wild, kind) in steps {
            index += if kind < 8 { 1 } else { advance };
            let motion = match kind { 0 => Motion::Start, 1 => Motion::Jump, _ => Motion::Continues };
            let y = if kind == 9 { wild } else { -x };
            let pen = PenStep { x: [x, y], ..PenStep::default() };
            learner.learn(&LearnStep { index, motion, pen, ..LearnStep::default() });
            prop_assert!(learner.candidates().validate().is_ok() && learner.weights().validate().is_ok());
            let counters = learner.counters();
            prop_assert_eq!(
                counters.received,
                counters.updates + counters.unlearned + counters.interruptions + counters.refused
            );
        }
    }
}
