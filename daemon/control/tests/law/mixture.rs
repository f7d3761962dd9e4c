//! `mixture`: guarantees of the mixture, its read-outs and its gate.

use std::sync::Arc;

use foretrace_control::predict::models::lstm::{LstmSpec, LstmTensors, LstmWeights};
use foretrace_control::predict::models::mixture::{EXPERTS, GATE, LEADS, NODE_COUNT, Present};
use foretrace_control::predict::{
    Mixture, MixtureLearner, MixtureParameters, MixtureSettings, ModelParameters, OnlineModel,
    OnlinePredictor, Predictor,
};
use proptest::prelude::*;
use rand_pcg::Pcg64;
use rand_pcg::rand_core::SeedableRng as _;

const STEP_NS: u64 = 10_000_000;

/// An untrained network: small random numbers.
fn network() -> Arc<LstmWeights> {
    let mut rng = Pcg64::seed_from_u64(5);
    let spec = LstmSpec {
        hidden: 32,
        leads: LEADS,
        residual: true,
        input_clip: Some(4.0),
        input_scale: 10.0,
        step_ns: STEP_NS,
    };
    let mut tensors = LstmTensors::zero(32, LEADS);
    for number in tensors.all_mut().into_iter().flatten() {
        *number = rng.random_range(-0.2..0.2);
    }
    Arc::new(LstmWeights::new(spec, tensors).unwrap())
}

fn learner(lstm: Option<Arc<LstmWeights>>) -> MixtureLearner {
    let parameters = MixtureParameters::untrained(STEP_NS, lstm.is_some());
    MixtureLearner::new(MixtureSettings::default(), lstm, parameters).unwrap()
}

/// A hand that loops and slants, RMS about 10, with a little noise.
fn hand(steps: usize, seed: u64) -> Vec<[f64; 2]> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut noise = || rng.random_range(-0.3..0.3);
    (0..steps)
        .map(|t| {
            let t = t as f64;
            let x = 9.0 * (0.31 * t).cos() + 5.0 * (0.11 * t + 1.0).sin() + noise();
            let y = 11.0 * (0.27 * t).sin() + 4.0 * (0.53 * t).cos() + noise();
            [x, y]
        })
        .collect()
}

/// Mean squared position error at `lead` of the mixture and of each expert's share of 1, over the last half.
fn position_error(model: &mut MixtureLearner, hand: &[[f64; 2]], lead: usize) -> (f64, f64) {
    let (mut own, mut constant, mut count) = (0.0, 0.0, 0.0);
    for (t, x) in hand.iter().enumerate() {
        model.learn(*x);
        let future = hand.get(t + 1..t + 1 + lead);
        if let Some(future) = future.filter(|_| t > hand.len() / 2) {
            let real = future.iter().fold([0.0; 2], |[a, b], [x, y]| [a + x, b + y]);
            let mut steps = vec![[0.0; 2]; lead];
            model.preview(&mut steps);
            let own_path = steps.iter().fold([0.0; 2], |[a, b], [x, y]| [a + x, b + y]);
            let held = x.map(|x| x * lead as f64);
            let square = |p: [f64; 2]| (p[0] - real[0]).powi(2) + (p[1] - real[1]).powi(2);
            own += square(own_path);
            constant += square(held);
            count += 1.0;
        }
    }
    (own / count, constant / count)
}

#[test]
fn it_learns_a_hand_online_far_better_than_constant_velocity_at_every_lead() {
    for lstm in [None, Some(network())] {
        let cold = lstm.is_none();
        for lead in [1, 5, 10, 24] {
            let (own, constant) = position_error(&mut learner(lstm.clone()), &hand(3000, 1), lead);
            assert!(own < 0.1 * constant, "cold {cold}, lead {lead}: {own} against {constant}");
        }
    }
}

#[test]
fn a_useless_network_costs_little() {
    let (with, _) = position_error(&mut learner(Some(network())), &hand(3000, 2), 10);
    let (without, _) = position_error(&mut learner(None), &hand(3000, 2), 10);
    assert!(with < 1.3 * without, "{with} against {without}");
}

#[test]
fn trained_experts_outweigh_those_that_have_to_learn_the_hand_first() {
    for lstm in [false, true] {
        for foresight in [false, true] {
            let present = Present { lstm, foresight };
            let parameters = MixtureParameters::untrained(STEP_NS, present);
            for shares in parameters.shares() {
                let (untrained, trained) = shares.split_at(3);
                assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                assert!(untrained.iter().all(|share| *share == untrained[0] && *share > 0.0));
                let largest = trained.iter().copied().fold(0.0, f32::max);
                assert!(largest == 0.0 || untrained.iter().sum::<f32>() < 0.5 * largest, "{shares:?}");
                assert_eq!(largest > 0.0, lstm || foresight);
            }
        }
    }
}

#[test]
fn weights_of_the_mixture_follow_what_was_right_and_sum_to_one() {
    let mut model = learner(Some(network()));
    for x in hand(3000, 3) {
        model.learn(x);
    }
    for shares in model.parameters().shares() {
        assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-4, "{shares:?}");
    }
    // Constant velocity is wrong at long leads, the read-outs are right.
    let [constant, _, plain, untrained, full, ..] = model.parameters().shares()[NODE_COUNT - 1];
    assert!(constant < 0.05 && untrained < 0.05, "{constant} {untrained}");
    assert!(plain + full > 0.5, "{plain} {full}");
    // Where the pen rests, all are right, and fixed share evens out the weights a little; no expert is lost
    // permanently.
    assert!(
        model.parameters().shares().iter().all(|shares| shares[..EXPERTS - 3].iter().all(|s| *s >= 1e-4))
    );
    assert!(model.parameters().shares().iter().all(|shares| shares[EXPERTS - 3..] == [0.0; 3]));
}

#[test]
fn loop_and_learner_predict_the_same_from_the_same_parameters() {
    let lstm = Some(network());
    let mut model = learner(lstm.clone());
    let mut in_loop = Mixture::new(lstm, MixtureParameters::untrained(STEP_NS, true)).unwrap();
    for x in hand(500, 4) {
        model.learn(x);
        in_loop.observe(x);
        in_loop.set_weights(model.parameters()).unwrap();
        let (mut a, mut b) = ([[0.0; 2]; 40], [[0.0; 2]; 40]);
        model.preview(&mut a);
        Predictor::preview(&in_loop, &mut b);
        assert_eq!(a, b);
    }
}

#[test]
fn a_jump_is_not_learned_from_and_leaves_the_pen_at_rest() {
    let mut model = learner(None);
    for x in hand(400, 5) {
        model.learn(x);
    }
    let before = *model.parameters();
    for jump in [[GATE * 1.01, 0.0], [f64::NAN, 0.0], [0.0, f64::NEG_INFINITY], [1e300, 1e300]] {
        assert_eq!(model.learn(jump).map(f64::is_finite), [true; 2]);
        assert!(*model.parameters() == before, "something was learned from {jump:?}");
        let mut steps = [[1.0; 2]; 30];
        model.preview(&mut steps);
        assert_eq!(steps, [[0.0; 2]; 30]);
    }
}

#[test]
fn nothing_is_learned_across_a_jump() {
    // The stroke after the jump ends before its first step could be a target of the stroke before.
    let mut model = learner(None);
    for x in hand(400, 6) {
        model.learn(x);
    }
    model.learn([2.0 * GATE, 0.0]);
    let before = *model.parameters();
    model.learn([3.0, 4.0]);
    assert!(*model.parameters() == before, "the first step of a stroke has no history to be learned from");
}

#[test]
fn a_read_out_that_belongs_to_another_network_kind_is_refused() {
    let mut in_loop = Mixture::new(Some(network()), MixtureParameters::untrained(STEP_NS, true)).unwrap();
    assert!(in_loop.set_weights(&MixtureParameters::untrained(STEP_NS, false)).is_err());
    assert!(in_loop.set_weights(&MixtureParameters::untrained(STEP_NS / 2, true)).is_err());
    let short = {
        let spec = LstmSpec { leads: 1, ..*network().spec() };
        Arc::new(LstmWeights::new(spec, LstmTensors::zero(32, 1)).unwrap())
    };
    let error =
        Mixture::new(Some(short), MixtureParameters::untrained(STEP_NS, true)).unwrap_err().to_string();
    assert_eq!(error, "mixture setting leads of the LSTM is 1, legal are 24 to 24");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn whatever_the_pen_does_parameters_stay_usable_and_previews_finite(
        seed in 0_u64..1000,
        wild in prop::collection::vec((0_usize..600, -1e3..1e3f64, -1e3..1e3f64), 0..40),
        rests in prop::collection::vec((0_usize..600, 1_usize..80), 0..6),
    ) {
        let mut steps = hand(600, seed);
        for (at, x, y) in wild {
            steps[at] = [x, y];
        }
        for (at, length) in rests {
            let end = (at + length).min(steps.len());
            steps[at..end].fill([0.0; 2]);
        }
        let mut model = learner(Some(network()));
        for x in steps {
            model.learn(x);
            let mut ahead = [[0.0; 2]; 40];
            model.preview_from(model.parameters(), model.memory(), 30.0, &mut ahead);
            prop_assert!(ahead.iter().all(|[x, y]| x.hypot(*y) <= 30.0 * (1.0 + 1e-9)), "{:?}", ahead);
        }
        prop_assert!(model.parameters().validate().is_ok());
    }
}
