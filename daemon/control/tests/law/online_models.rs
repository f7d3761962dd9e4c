//! Guarantees of every model that learns online, for DyBM, DyBM+ESN and AR-RLS alike: parameters that
//! validate are finite, hostile ones are refused, roll-outs do not change memory, interruptions clear it.

use std::fmt::Debug;
use std::sync::Arc;

use foretrace_control::predict::models::ar_rls::{ArRlsLearner, ArRlsSettings, ArRlsWeights};
use foretrace_control::predict::models::dybm::{
    DybmLearner, DybmSettings, DybmShape, DybmWeights, TraceInput,
};
use foretrace_control::predict::models::esn::{
    DybmEsn, DybmEsnLearner, DybmEsnSettings, DybmEsnWeights, ReadoutRule, Reservoir, ReservoirSettings,
};
use foretrace_control::predict::{
    ArRls, Dybm, LARGEST_DISPLACEMENT, ModelParameters, OnlineModel, Optimiser, Predictor, WeightsError,
};
use proptest::prelude::*;

const STEP_NS: u64 = 10_000_000;
const OPTIMISERS: [Optimiser; 3] =
    [Optimiser::ada_grad(0.1), Optimiser::rms_prop(0.01), Optimiser::adam(0.01)];

fn settings(optimiser: Optimiser) -> DybmSettings {
    let shape = DybmShape::new(5, &[0.5, 0.9], TraceInput::Newest);
    DybmSettings { shape, optimiser, l1: 0.0, l2: 0.0 }
}

fn start(optimiser: Optimiser) -> DybmWeights {
    DybmWeights::persistent(STEP_NS, settings(optimiser).shape, 0.9)
}

fn dybm(optimiser: Optimiser) -> DybmLearner {
    DybmLearner::new(settings(optimiser), start(optimiser)).unwrap()
}

fn reservoir(seed: u64) -> Arc<Reservoir> {
    Arc::new(Reservoir::seeded(&ReservoirSettings { seed, ..ReservoirSettings::default() }).unwrap())
}

fn esn(optimiser: Optimiser, rule: ReadoutRule) -> DybmEsnLearner {
    let settings = DybmEsnSettings { dybm: settings(optimiser), readout: optimiser, rule };
    DybmEsnLearner::untrained(settings, start(optimiser), reservoir(1)).unwrap()
}

fn ar_rls() -> ArRlsLearner {
    ArRlsLearner::new(ArRlsSettings::default(), ArRlsWeights::constant_velocity(STEP_NS)).unwrap()
}

/// Runs `promise!` on a fresh model of every kind.
macro_rules! for_every_model {
    ($promise:expr) => {{
        for optimiser in OPTIMISERS {
            $promise(dybm(optimiser));
            $promise(esn(optimiser, ReadoutRule::OwnError));
            $promise(esn(optimiser, ReadoutRule::SharedResidual));
        }
        $promise(ar_rls());
    }};
}

/// A curve that never repeats, about 14 units long per step.
fn motion(t: usize) -> [f64; 2] {
    let t = t as f64;
    [11.0 * (0.11 * t).cos() + 3.0 * (0.3 * t).sin(), 11.0 * (0.13 * t).sin()]
}

/// Hostile inputs: any finite number, and non-finite ones.
fn hostile() -> impl Strategy<Value = Vec<[f64; 2]>> {
    let number = prop_oneof![
        6 => -60.0..60.0f64,
        1 => Just(0.0),
        1 => -1e7..1e7f64,
        1 => prop::num::f64::ANY,
    ];
    prop::collection::vec([number.clone(), number], 1..120)
}

fn survives<M: OnlineModel>(mut model: M, inputs: &[[f64; 2]]) {
    for x in inputs {
        model.learn(*x);
    }
    let healthy = model.parameters().validate().is_ok();
    assert!(!healthy || format!("{:?}", model.parameters()).find("NaN").is_none(), "NaN validates");
    // After any input and a clear memory, the next thousand ordinary steps are predicted with finite numbers.
    model.reset_state();
    for t in 0..1000 {
        let predicted = model.learn(motion(t));
        assert!(predicted.iter().all(|p| p.is_finite()), "{predicted:?} at {t}");
    }
    let mut out = [[0.0; 2]; 16];
    model.preview_from(model.parameters(), model.memory(), 100.0, &mut out);
    assert!(out.iter().all(|[x, y]| x.hypot(*y) <= 100.0 * (1.0 + 1e-9)), "{out:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_input_poisons_a_learner_for_good(inputs in hostile()) {
        for_every_model!(|model| survives(model, &inputs));
    }

    #[test]
    fn what_is_no_motion_empties_every_memory_and_teaches_nothing(before in 1..60usize, which in 0..5usize) {
        let poison = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 2.0 * LARGEST_DISPLACEMENT, -1e300][which];
        fn check<M: OnlineModel>(mut model: M, before: usize, poison: f64) {
            let empty = *model.memory();
            (0..before).for_each(|t| { model.learn(motion(t)); });
            let parameters = *model.parameters();
            assert_ne!(*model.memory(), empty);
            model.learn([3.0, poison]);
            assert_eq!((*model.memory(), *model.parameters()), (empty, parameters));
            model.observe(motion(0));
            model.observe([poison, 3.0]);
            assert_eq!(*model.memory(), empty);
        }
        for_every_model!(|model| check(model, before, poison));
    }

    #[test]
    fn rollouts_leave_memory_and_learning_untouched(steps in 1..200usize, limit in 0.1..1e3f64) {
        fn check<M: OnlineModel>(model: M, twin: M, steps: usize, limit: f64) {
            let (mut model, mut twin) = (model, twin);
            let mut out = [[0.0; 2]; 20];
            for t in 0..steps {
                model.learn(motion(t));
                twin.learn(motion(t));
                model.preview_from(model.parameters(), model.memory(), limit, &mut out);
                assert!(out.iter().all(|[x, y]| x.hypot(*y) <= limit * (1.0 + 1e-9)));
                assert_eq!(model.memory(), twin.memory());
                assert_eq!(model.parameters(), twin.parameters());
            }
        }
        check(dybm(OPTIMISERS[0]), dybm(OPTIMISERS[0]), steps, limit);
        let rule = ReadoutRule::SharedResidual;
        check(esn(OPTIMISERS[2], rule), esn(OPTIMISERS[2], rule), steps, limit);
        check(ar_rls(), ar_rls(), steps, limit);
    }
}

/// Whatever `spoil` does to valid parameters is refused, and the old ones stay.
fn refuses<M: OnlineModel + Debug>(mut model: M, spoil: &[fn(&mut M::Parameters)]) {
    (0..50).for_each(|t| {
        model.learn(motion(t));
    });
    let good = *model.parameters();
    for (which, spoil) in spoil.iter().enumerate() {
        let mut bad = good;
        spoil(&mut bad);
        assert!(model.continue_from(&bad).is_err(), "spoilt {which} continued from");
        assert!(model.restart_from(&bad).is_err(), "spoilt {which} restarted from");
        assert_eq!(*model.parameters(), good);
    }
    let memory = *model.memory();
    let renamed = good.with_version(7);
    model.continue_from(&renamed).unwrap();
    assert_eq!((model.parameters().version(), *model.memory()), (7, memory));
    model.restart_from(&good).unwrap();
    assert_eq!((*model.parameters(), *model.memory()), (good, memory));
    assert!(good.fits(STEP_NS).is_ok());
    assert!(matches!(good.fits(STEP_NS / 2), Err(WeightsError::Step { .. })));
}

#[test]
fn poisoned_or_foreign_parameters_are_refused() {
    refuses::<DybmLearner>(
        dybm(OPTIMISERS[0]),
        &[
            |p| p.parameters.bias[1] = f64::NAN,
            |p| p.parameters.fifo[3][0][1] = f64::INFINITY,
            |p| p.parameters.traces[0][0][0] = -101.0,
            |p| p.shape.delay = 4,
            |p| p.step_ns += 1,
            |p| p.input_scale = 1.0,
        ],
    );
    refuses::<DybmEsnLearner>(
        esn(OPTIMISERS[0], ReadoutRule::OwnError),
        &[
            |p| p.readout[49][1] = f64::NAN,
            |p| p.readout[0][0] = 2.0 * DybmEsnWeights::MAX_READOUT,
            |p| p.dybm.parameters.bias[0] = f64::NEG_INFINITY,
            |p| p.reservoir ^= 1,
            |p| p.dybm.step_ns = 5_000_000,
        ],
    );
    refuses::<ArRlsLearner>(
        ar_rls(),
        &[
            |p| p.coefficients[7][1][1] = f64::NAN,
            |p| p.coefficients[0][0][0] = 2.0 * ArRlsWeights::MAX_MAGNITUDE,
            |p| p.step_ns = 0,
            |p| p.input_scale = f64::NAN,
        ],
    );
    let untrained = *esn(OPTIMISERS[0], ReadoutRule::OwnError).parameters();
    assert!(matches!(DybmEsn::new(untrained, reservoir(2)), Err(WeightsError::Reservoir { .. })));
}

/// Predictor and learner are one model: the same memory and, from the same parameters, the same preview.
fn agree<M: OnlineModel, P: Predictor>(
    mut model: M,
    predictor: impl Fn(&M::Parameters) -> P,
    tolerance: f64,
) {
    (0..400).for_each(|t| {
        model.learn(motion(t));
    });
    model.reset_state();
    let mut predictor = predictor(model.parameters());
    for t in 0..100 {
        model.observe(motion(t));
        predictor.observe(motion(t));
        let (mut of_model, mut of_predictor) = ([[0.0; 2]; 10], [[0.0; 2]; 10]);
        model.preview(&mut of_model);
        predictor.preview(&mut of_predictor);
        for (a, b) in of_model.as_flattened().iter().zip(of_predictor.as_flattened()) {
            assert!((a - b).abs() <= tolerance, "{a} and {b} at {t}");
        }
    }
}

#[test]
fn predictors_preview_what_their_learners_would() {
    agree(dybm(OPTIMISERS[0]), |weights| Dybm::new(*weights).unwrap(), 0.0);
    let gate = ArRlsSettings::default().gate;
    agree(ar_rls(), |weights| ArRls::new(*weights, gate).unwrap(), 0.0);
    // Rolled out in single precision; the typical displacement is 14.
    let rule = ReadoutRule::SharedResidual;
    agree(esn(OPTIMISERS[0], rule), |weights| DybmEsn::new(*weights, reservoir(1)).unwrap(), 14.0 * 1e-4);
}
