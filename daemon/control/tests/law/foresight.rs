//! `foresight`: what it sees never depends on what comes later, nor on where and how large the hand writes;
//! as an expert of the mixture it is believed where it is right, and costs little where it is not.

use std::sync::Arc;

use foretrace_control::pen::{
    Motion, PenReading, PenSettings, PenTracker, SpeedScale, SpeedScaleSettings, Touch,
};
use foretrace_control::predict::models::foresight::features::{HISTORY, block_of, kinds};
use foretrace_control::predict::models::foresight::{
    Dense, FEATURES, Foresight, ForesightError, ForesightSpec, ForesightWeights, Look, NAMES, PenHistory,
    SHAPES,
};
use foretrace_control::predict::models::lstm::{LstmSpec, LstmTensors, LstmWeights};
use foretrace_control::predict::models::mixture::{EXPERTS, LEADS, NODES, Present, TrainedNetworks};
use foretrace_control::predict::{
    MixtureLearner, MixtureParameters, MixtureSettings, ModelSettings, Models, Networks, OnlineModel, PenStep,
};
use foretrace_control::units::Stamp;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

const STEP_NS: u64 = 10_000_000;

/// A pen that writes, lifts, rests, jitters in time and jumps.
fn readings(seed: u64) -> Vec<PenReading> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut now = 1_000_000_000_u64;
    let mut at = [0.0_f64; 2];
    (0..600)
        .map(|k| {
            now += rng.random_range(3_000_000..9_000_000);
            let t = f64::from(k) * 0.05;
            let speed = if k % 97 > 80 { 0.0 } else { 1e-3 };
            at = [at[0] + speed * t.cos(), at[1] + speed * (1.7 * t).sin()];
            if k % 211 == 210 {
                at = [-at[0] - 0.2, 0.1];
            }
            PenReading::new(Stamp(now), at, k % 61 < 40)
        })
        .collect()
}

/// What the network sees at every step, by grid index.
fn looks(readings: &[PenReading]) -> Vec<(u64, Look)> {
    let mut tracker = PenTracker::new(PenSettings::default()).unwrap();
    let mut scale = SpeedScale::new(SpeedScaleSettings::default()).unwrap();
    let mut history = PenHistory::EMPTY;
    let mut looks = Vec::new();
    for reading in readings {
        tracker.ingest(reading.stamp, reading);
        while let Some(step) = tracker.next_step() {
            if step.motion == Motion::Continues {
                scale.observe(&step);
                let x = scale.normalise(step.displacement);
                let (half, ahead) = (scale.normalise(step.half), scale.normalise(step.ahead));
                let ahead_s = step.ahead_ns as f64 * 1e-9;
                history.observe(&PenStep { x, half, ahead, ahead_s, touch: step.touch() });
            } else {
                history = PenHistory::EMPTY;
            }
            looks.push((step.index, history.look(0.01, block_of(0.01))));
        }
    }
    looks
}

#[test]
fn no_feature_changes_when_later_samples_are_cut_off() {
    let readings = readings(1);
    let whole = looks(&readings);
    assert!(whole.len() > 200);
    for cut in [1, 2, 50, 211, 212, 333, 500, 599] {
        let part = looks(&readings[..cut]);
        assert_eq!(part, whole[..part.len()], "cut after {cut} readings");
    }
}

fn history(steps: usize, touch: impl Fn(usize) -> Touch, way: impl Fn(f64) -> [f64; 2]) -> PenHistory {
    let mut history = PenHistory::EMPTY;
    for k in 0..steps {
        history.observe(&PenStep { touch: touch(k), ..PenStep::of(way(k as f64)) });
    }
    history
}

fn ink(_: usize) -> Touch {
    Touch::INK
}

#[test]
fn turned_writing_looks_the_same_but_for_its_direction() {
    let way = |k: f64| [10.0 + 3.0 * (0.4 * k).sin(), 6.0 * (0.3 * k).cos()];
    let straight = history(40, ink, way).look(0.01, 2);
    let (s, c) = 1.1_f64.sin_cos();
    let turned = history(40, ink, |k| {
        let [x, y] = way(k);
        [c * x - s * y, s * x + c * y]
    });
    let turned = turned.look(0.01, 2);
    for (place, (a, b)) in straight.features.iter().zip(turned.features).enumerate() {
        if !kinds::DIRECTION.contains(&place) {
            assert!((a - b).abs() < 1e-4, "feature {place}: {a} {b}");
        }
    }
    let [a, b] = [straight.frame, turned.frame];
    let between = (a[0] * b[1] - a[1] * b[0]).atan2(a[0] * b[0] + a[1] * b[1]);
    assert!((between - 1.1).abs() < 1e-6, "{between}");
}

#[test]
fn contact_age_and_rest_are_told() {
    let steps = |contact| move |k: usize| Touch { contact, steps: k as u32 };
    let way = |k: f64| [10.0 + k % 3.0, 2.0];
    let (down, up) =
        (history(20, steps(true), way).look(0.01, 2), history(20, steps(false), way).look(0.01, 2));
    let differ: Vec<usize> = (0..FEATURES).filter(|f| down.features[*f] != up.features[*f]).collect();
    assert_eq!(differ, [kinds::CONTACT.start], "only the contact differs");
    let longer = history(HISTORY * 2, steps(true), way).look(0.01, 2);
    assert!(kinds::TIME.clone().filter(|f| *f != 48).all(|f| longer.features[f] >= down.features[f]));
    let rest = history(HISTORY, ink, |_| [0.0; 2]).look(0.01, 2);
    assert!(rest.frame == [1.0, 0.0] && rest.features.iter().all(|f| f.is_finite()));
    // A jump begins a new history, as in the mixture.
    let mut jumped = history(20, ink, way);
    jumped.observe(&PenStep::of([500.0, 0.0]));
    assert_eq!(jumped.steps(), 1);
}

/// A network that says: straight on in the frame of motion, at `speed` times ordinary motion, as long as the
/// pen touches the paper, and `hover` times without touch.
fn straight_on(speed: f64, hover: f64) -> Arc<ForesightWeights> {
    let spec = ForesightSpec { step_ns: STEP_NS, input_scale: 10.0, block: 2 };
    let mut layers = SHAPES
        .map(|(inputs, outputs)| Dense { weight: vec![0.0; inputs * outputs], bias: vec![0.0; outputs] });
    // The first unit of each layer is 6 with touch, which the activation leaves alone, and 0 without.
    layers[0].weight[kinds::CONTACT.start] = 3.0;
    layers[0].bias[0] = 3.0;
    (layers[1].weight[0], layers[2].weight[0]) = (1.0, 1.0);
    let (_, width) = SHAPES[2];
    for (node, bias) in layers[3].bias.iter_mut().enumerate().step_by(2) {
        *bias = hover;
        layers[3].weight[node * width] = (speed - hover) / 6.0;
    }
    Arc::new(ForesightWeights::new(spec, layers).unwrap())
}

#[test]
fn the_answer_is_turned_back_into_the_plane() {
    let foresight = Foresight::new(&straight_on(1.5, 0.0));
    let seen = foresight.foresee(&history(30, ink, |_| [6.0, 8.0]));
    for (node, [x, y]) in NODES.iter().zip(seen.path()) {
        let way = 15.0 * *node as f64;
        assert!((x - 0.6 * way).abs() < 1e-4 && (y - 0.8 * way).abs() < 1e-4, "{node}: {x} {y}");
    }
}

/// Squared error of the mixture with the networks of `trained` six steps ahead, over the last half of a hand
/// whose touch tells whether it moves in the next steps; and its parameters at the end.
fn error_with(trained: TrainedNetworks) -> (f64, MixtureParameters) {
    let parameters = MixtureParameters::untrained(STEP_NS, &trained);
    let mut learner = MixtureLearner::new(MixtureSettings::default(), trained, parameters).unwrap();
    let mut rng = Pcg64::seed_from_u64(8);
    let (mut angle, mut touch, mut moves) = (0.0_f64, true, true);
    let hand: Vec<([f64; 2], bool)> = (0..4000)
        .map(|k| {
            angle += rng.random_range(-0.02..0.02);
            let length = if moves { 12.0 } else { 0.1 };
            if k % 6 == 0 {
                touch = rng.random_range(0..2) == 0;
            }
            moves = touch;
            ([length * angle.cos(), length * angle.sin()], touch)
        })
        .collect();
    let (mut error, mut count) = (0.0, 0.0);
    for (k, (x, contact)) in hand.iter().enumerate() {
        let touch = Touch { contact: *contact, steps: 0 };
        learner.learn_pen(&PenStep { touch, ..PenStep::of(*x) });
        if k > hand.len() / 2 && k + 6 < hand.len() {
            let mut steps = [[0.0; 2]; 6];
            learner.preview(&mut steps);
            let ahead = hand[k + 1..k + 7].iter().map(|(x, _)| *x);
            let sum = |[a, b]: [f64; 2], [x, y]: [f64; 2]| [a + x, b + y];
            let ([px, py], [x, y]) = (steps.into_iter().fold([0.0; 2], sum), ahead.fold([0.0; 2], sum));
            error += (px - x).powi(2) + (py - y).powi(2);
            count += 1.0;
        }
    }
    (error / count, *learner.parameters())
}

#[test]
fn the_mixture_believes_foresight_where_it_is_right_and_loses_little_where_it_is_not() {
    let with = |weights| TrainedNetworks { foresight: Some(weights), ..TrainedNetworks::default() };
    let (without, _) = error_with(TrainedNetworks::default());
    let (right, parameters) = error_with(with(straight_on(1.2, 0.0)));
    let believed: f32 = parameters.shares()[5][EXPERTS - 3..].iter().sum();
    assert!(believed > 0.5, "{believed}");
    assert!(right < 0.8 * without, "{right} with, {without} without");
    let (wrong, _) = error_with(with(straight_on(-3.0, -3.0)));
    assert!(wrong < 1.1 * without, "{wrong} with a wrong network, {without} without");
}

#[test]
fn the_last_expert_is_the_mean_of_both_corrected_networks_and_needs_both() {
    let spec = LstmSpec {
        hidden: 10,
        leads: LEADS,
        residual: true,
        input_clip: Some(4.0),
        input_scale: 10.0,
        step_ns: STEP_NS,
    };
    let mut rng = Pcg64::seed_from_u64(9);
    let mut tensors = LstmTensors::zero(10, LEADS);
    tensors.all_mut().into_iter().flatten().for_each(|number| *number = rng.random_range(-0.2..0.2));
    let lstm = Some(Arc::new(LstmWeights::new(spec, tensors).unwrap()));
    let foresight = Some(straight_on(1.2, 0.3));
    for (lstm, foresight) in [(lstm.clone(), foresight.clone()), (lstm, None), (None, foresight)] {
        let both = lstm.is_some() && foresight.is_some();
        let trained = TrainedNetworks { lstm, foresight };
        let parameters = MixtureParameters::untrained(STEP_NS, &trained);
        let mut learner = MixtureLearner::new(MixtureSettings::default(), trained, parameters).unwrap();
        for k in 0..300 {
            let t = f64::from(k) * 0.1;
            learner.learn([10.0 * t.cos(), 8.0 * (1.3 * t).sin()]);
            let [.., lstm, _, foresight, mean] = learner.experts();
            for ((mean, a), b) in
                mean.as_flattened().iter().zip(lstm.as_flattened()).zip(foresight.as_flattened())
            {
                assert!(!both || (mean - 0.5 * (a + b)).abs() < 1e-9, "{mean} of {a} and {b}");
            }
        }
        let believed = learner.parameters().shares().iter().map(|shares| shares[EXPERTS - 1]);
        assert!(believed.into_iter().all(|share| (share > 0.0) == both), "both there: {both}");
    }
}

#[test]
fn parameters_of_another_set_of_experts_are_refused() {
    let bare = MixtureParameters::untrained(STEP_NS, Present::default());
    let with = Present { foresight: true, ..Present::default() };
    let mut learner =
        MixtureLearner::new(MixtureSettings::default(), TrainedNetworks::default(), bare).unwrap();
    let error = learner.continue_from(&MixtureParameters::untrained(STEP_NS, with)).unwrap_err();
    assert!(error.to_string().contains("foresight"), "{error}");
    // Without a network its experts have no weight.
    assert!(bare.shares().iter().all(|shares| shares[EXPERTS - 3..] == [0.0; 3]));
}

#[test]
fn a_network_that_does_not_fit_is_refused_with_its_reason() {
    let (spec, layers) = (*straight_on(1.0, 0.0).spec(), straight_on(1.0, 0.0).layers().clone());
    let refused = |spec, layers: [Dense; 4]| ForesightWeights::new(spec, layers).unwrap_err();
    let mut short = layers.clone();
    short[1].weight.pop();
    let [[_, _], [tensor, _], ..] = NAMES;
    assert!(matches!(refused(spec, short), ForesightError::Length { tensor: t, .. } if t == tensor));
    for wrong in [f64::NAN, f64::INFINITY, 1e6] {
        let mut damaged = layers.clone();
        damaged[2].bias[7] = wrong;
        assert!(matches!(refused(spec, damaged), ForesightError::Magnitude { index: 7, .. }), "{wrong}");
    }
    for block in [0, 13] {
        let spec = ForesightSpec { block, ..spec };
        assert!(matches!(refused(spec, layers.clone()), ForesightError::Range { name: "block", .. }));
    }
    // A loop with another step refuses it.
    let networks = Networks { foresight: Some(straight_on(1.0, 0.0)), ..Networks::default() };
    let error = Models::new(ModelSettings::preset(STEP_NS / 2), networks).unwrap_err();
    assert!(error.to_string().contains("10000000 ns"), "{error}");
}
