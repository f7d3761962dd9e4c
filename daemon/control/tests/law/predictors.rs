//! Every predictor in the whole step, with the learner beside it: replay, switching, pen-up.

use crate::support::{Bench, PERIOD_NS, models, preset, settings};
use foretrace_control::follower::{Budget, Health, Mode, Request, StepInput, StepOutput};
use foretrace_control::learn::Learner;
use foretrace_control::pen::PenReading;
use foretrace_control::predict::{OnlineWeights, PredictorKind};
use foretrace_control::trust::TrustReason;

/// A smooth written-like curve of about 3 cm.
fn curve(t: f64) -> [f64; 2] {
    [0.015 * (10.7 * t).sin(), 0.012 * (18.2 * t + 0.4).sin()]
}

/// A loop and its learner, which hands its weights over for the next tick.
struct Pair {
    bench: Bench,
    learner: Option<Learner>,
    weights: Option<OnlineWeights>,
    /// Every set of weights and the tick that took it.
    recorded: Vec<(u64, OnlineWeights)>,
    tick: u64,
}

impl Pair {
    fn new(kind: PredictorKind) -> Self {
        let learner = Some(Learner::new(preset(), &models()).unwrap());
        Self { bench: Bench::armed(settings(kind)), learner, weights: None, recorded: Vec::new(), tick: 0 }
    }

    fn tick(&mut self, pen: &[PenReading], request: Option<Request>) -> StepOutput<6> {
        let weights = self.weights.take();
        self.recorded.extend(weights.map(|weights| (self.tick, weights)));
        self.bench.joints.stamp = self.bench.now;
        let joints = self.bench.joints;
        let input = StepInput {
            pen,
            joints: Some(&joints),
            request,
            weights: weights.as_ref(),
            ..StepInput::nothing(self.bench.now)
        };
        let output = self.bench.step(&input, Budget::default());
        assert!(!output.health.has(Health::WEIGHTS_REFUSED));
        assert!(weights.is_none_or(|weights| weights.version == output.weights_version));
        for step in output.learn.iter().take(output.learn_count) {
            if let Some(learner) = &mut self.learner
                && learner.learn(step).hand_over
            {
                self.weights = Some(*learner.weights());
            }
        }
        self.tick += 1;
        output
    }

    /// The curve at 200 Hz for this many ticks; the output, bit for bit.
    fn follow(&mut self, ticks: u64) -> Vec<u64> {
        let mut bits = Vec::new();
        for _ in 0..ticks {
            let t = (self.tick * PERIOD_NS) as f64 * 1e-9;
            let due = matches!(self.tick % 5, 0 | 3);
            let samples = [self.bench.pen(curve(t))];
            let output = self.tick(if due { &samples } else { &[] }, None);
            bits.extend(output.command.iter().flat_map(|command| command.q).map(f64::to_bits));
            bits.push(output.weights_version);
            bits.push(output.predictor_band.map_or(0, f64::to_bits));
        }
        bits
    }
}

#[test]
fn with_every_predictor_the_same_inputs_give_the_same_bits() {
    for kind in PredictorKind::LIVE {
        let mut first = Pair::new(kind);
        let bits = first.follow(2500);
        assert!(first.recorded.len() > 20, "{kind:?}: weights hardly ever changed");
        assert_eq!(bits, Pair::new(kind).follow(2500), "{kind:?}: learning and following again");
        // Replay: the recorded weights replace the learner.
        let mut replay = Pair::new(kind);
        replay.learner = None;
        let mut recorded = first.recorded.iter().peekable();
        let mut again = Vec::new();
        for tick in 0..2500 {
            replay.weights = recorded.next_if(|(at, _)| *at == tick).map(|(_, weights)| *weights);
            again.extend(replay.follow(1));
        }
        assert_eq!(bits, again, "{kind:?}: replay");
    }
}

#[test]
fn the_band_of_every_predictor_is_known_after_a_while_and_of_the_order_of_its_error() {
    // With manual trust the preview is followed as it is: the band's own claim. Corrections by newer samples
    // only make errors smaller.
    for (request, kind) in [Request::SetTrust(1.0), Request::TrustAuto]
        .into_iter()
        .flat_map(|request| PredictorKind::LIVE.map(|kind| (request, kind)))
    {
        let mut pair = Pair::new(kind);
        pair.tick(&[], Some(request));
        pair.follow(3999);
        let (mut inside, mut cases) = (0, 0);
        let mut claimed: Option<([f64; 2], f64)> = None;
        for _ in 0..4000 {
            // The last tick's prediction of the pen one grid step later, in a loop without dead time.
            let t = (pair.tick * PERIOD_NS) as f64 * 1e-9;
            if pair.tick.is_multiple_of(5)
                && let Some(([x, y], band)) = claimed.take()
            {
                let [real_x, real_y] = curve(t);
                cases += 1;
                inside += i32::from((x - real_x).hypot(y - real_y) <= band);
            }
            let samples = [pair.bench.pen(curve(t))];
            let output = pair.tick(&samples, None);
            if pair.tick % 5 == 1 {
                let [x, y, _] = output.reference;
                claimed = Some(([x, y], output.predictor_band.expect("no band after 8 s")));
            }
        }
        let share = f64::from(inside) / f64::from(cases);
        println!("{request:?} {kind:?}: {share}");
        assert!((0.8..=1.0).contains(&share), "{request:?} {kind:?}: {share} of {cases} inside the band");
    }
}

#[test]
fn every_switch_goes_through_no_trust_and_only_then_takes_over() {
    let mut pair = Pair::new(PredictorKind::HOLD);
    pair.follow(1500);
    for to in PredictorKind::LIVE.into_iter().cycle().skip(1).take(2 * PredictorKind::LIVE.len()) {
        let mut before = None;
        let mut ticks = 0;
        loop {
            let t = (pair.tick * PERIOD_NS) as f64 * 1e-9;
            let samples = [pair.bench.pen(curve(t))];
            let request = (ticks == 0).then_some(Request::SwitchPredictor(to));
            let output = pair.tick(&samples, request);
            if let Some(from) = before.filter(|before| *before != output.predictor) {
                assert_eq!(output.predictor, to);
                assert_eq!(output.trust.alpha.alpha(), 0.0, "{from:?} to {to:?}");
            }
            before = Some(output.predictor);
            ticks += 1;
            // Ten grid steps down, as many up, and a margin.
            if output.predictor == to && output.trust.alpha.alpha() >= 1.0 {
                break;
            }
            assert!(ticks < 300, "{to:?} never took over");
        }
    }
}

/// Writes a stroke, lifts the pen for a part of the same curve if the device sees it hover, writes on.
fn lift(kind: PredictorKind) -> (Vec<StepOutput<6>>, Pair) {
    let mut pair = Pair::new(kind);
    let mut outputs = Vec::new();
    for _ in 0..2500 {
        let t = (pair.tick * PERIOD_NS) as f64 * 1e-9;
        let contact = !(1250..1750).contains(&pair.tick);
        let samples = [PenReading { contact, ..pair.bench.pen(curve(t)) }];
        outputs.push(pair.tick(&samples, None));
    }
    (outputs, pair)
}

#[test]
fn a_hover_path_is_predicted_through_and_learned_from() {
    for kind in PredictorKind::LIVE {
        let (outputs, pair) = lift(kind);
        for (tick, output) in outputs.iter().enumerate().skip(800) {
            assert_eq!(
                (output.mode, output.trust.reason),
                (Mode::Following, TrustReason::Auto),
                "{kind:?} {tick}"
            );
            assert_eq!(output.trust.alpha.alpha(), 1.0, "{kind:?}, tick {tick}");
            assert!(!output.health.has(Health::PEN_JUMP), "{kind:?}, tick {tick}");
        }
        assert!(outputs.iter().any(|output| output.learn_count > 0 && !output.learn[0].pen.touch.contact));
        let counters = pair.learner.as_ref().unwrap().counters();
        // The very first step is a start; lifting and lowering interrupt nothing.
        assert_eq!(counters.interruptions, 1, "{kind:?}: {counters:?}");
    }
}

#[test]
fn a_jump_empties_memory_and_teaches_nothing_whatever_predicts() {
    for kind in PredictorKind::LIVE {
        let mut pair = Pair::new(kind);
        pair.follow(1500);
        let candidates = pair.learner.as_ref().unwrap().candidates();
        let updates = pair.learner.as_ref().unwrap().counters().updates;
        // The device sees nothing while the pen travels: the next sample is 6 cm away.
        let samples = [pair.bench.pen([0.07, 0.05])];
        let mut jumped = None;
        for _ in 0..12 {
            let output = pair.tick(&[PenReading { stamp: pair.bench.now, ..samples[0] }], None);
            if output.health.has(Health::PEN_JUMP) {
                jumped = Some(output);
                break;
            }
        }
        let output = jumped.expect("the jump was not seen");
        assert_eq!(output.trust.reason, TrustReason::Warmup, "{kind:?}");
        let learner = pair.learner.as_ref().unwrap();
        let learned = learner.counters().updates - updates;
        assert!(learned <= 1, "{kind:?}: learned from {learned} steps around the jump");
        if learned == 0 {
            assert!(
                learner.candidates().dybm == candidates.dybm
                    && learner.candidates().mixture == candidates.mixture
            );
        }
    }
}

#[test]
fn who_asks_by_an_old_name_is_told_the_new_one() {
    let dybm =
        ["dybm-online", "dybm-esn-online"].into_iter().zip([PredictorKind::DYBM, PredictorKind::DYBM_ESN]);
    let others = [("zero", PredictorKind::HOLD), ("lstm10", PredictorKind::LSTM)];
    let ours = ["ours", "ours-plus"].map(|old| (old, PredictorKind::MIXTURE));
    for (old, now) in ours.into_iter().chain(others).chain(dybm) {
        assert_eq!(PredictorKind::from_name(old), None);
        assert_eq!(PredictorKind::current_name(old), Some(now.name()));
        assert!(PredictorKind::renamed(old).ends_with(&format!("is called {})", now.name())), "{old}");
    }
    for name in PredictorKind::ALL.map(PredictorKind::name).into_iter().chain(["", "our", "hours-"]) {
        assert_eq!(PredictorKind::renamed(name), "", "{name}");
    }
}
