//! A law that was written out and read back carries on bit for bit, whatever it was doing.

use crate::support::strokes::on_paper;
use crate::support::writing::scribble;
use crate::support::{Bench, HOME, PERIOD_NS, STEP_NS, learner, models_with_network, settings};
use foretrace_clarabel::ClarabelProfile;
use foretrace_control::arm::lag::Following;
use foretrace_control::clearance::ClearanceSettings;
use foretrace_control::follower::{
    Budget, EnableReading, Follower, FollowerSettings, Mode, NoClock, Request, StepInput,
};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::{ExternalPreview, LearnStep, OnlineWeights, PredictorKind};
use foretrace_control::qp::backend::Backend;
use foretrace_control::state::{self, StateError};
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// What one tick is given.
#[derive(Default)]
struct Given {
    pen: Vec<PenReading>,
    request: Option<Request>,
    budget: Budget,
    enable: Option<EnableReading>,
    weights: Option<Box<OnlineWeights>>,
    preview: Option<Box<ExternalPreview>>,
    /// No joint state in this tick.
    silent: bool,
}

/// What a run went through.
struct Seen {
    modes: Vec<Mode>,
    /// Part of another process's predictor in the preview, tick by tick, where one is asked.
    parts: Vec<(u64, f64)>,
}

/// Runs `ticks` of `script`; at each of `cuts` another law starts from the bytes of the first and goes on
/// beside it. Outputs are compared in every tick, states at the end.
fn carried(
    settings: &FollowerSettings<6>,
    start: [f64; 6],
    ticks: u64,
    cuts: &[u64],
    mut script: impl FnMut(u64, &Bench) -> Given,
) -> Seen {
    let mut bench = Bench::new(settings.clone());
    bench.joints.q = start;
    let mut others: Vec<(u64, Follower<10, 6>)> = Vec::new();
    let (mut modes, mut parts) = (Vec::new(), Vec::new());
    for tick in 0..ticks {
        if cuts.contains(&tick) {
            let bytes = state::bytes_of(&bench.follower).unwrap();
            let mut other = Follower::new(settings.clone()).unwrap();
            state::read(&mut other, &bytes).unwrap();
            assert_eq!(state::bytes_of(&other).unwrap(), bytes, "cut at tick {tick}");
            others.push((tick, other));
        }
        let given = script(tick, &bench);
        bench.joints.stamp = bench.now;
        let joints = bench.joints;
        let input = StepInput {
            pen: &given.pen,
            joints: (!given.silent).then_some(&joints),
            enable: given.enable,
            request: given.request,
            weights: given.weights.as_deref(),
            preview: given.preview.as_deref(),
            ..StepInput::nothing(bench.now)
        };
        let twins = others
            .iter_mut()
            .map(|(cut, other)| (*cut, format!("{:?}", other.step(&input, given.budget, &mut NoClock))));
        let twins: Vec<_> = twins.collect();
        let output = bench.step(&input, given.budget);
        modes.push(output.mode);
        parts.extend(output.external.map(|external| (tick, external.weight)));
        let wanted = format!("{output:?}");
        for (cut, got) in twins {
            assert!(got == wanted, "cut at {cut}, tick {tick}:\n{got}\ninstead of\n{wanted}");
        }
    }
    let last = state::bytes_of(&bench.follower).unwrap();
    for (cut, other) in &others {
        assert!(state::bytes_of(other).unwrap() == last, "cut at tick {cut}: another state at the end");
    }
    modes.dedup();
    Seen { modes, parts }
}

fn curve(t: f64) -> [f64; 2] {
    [0.015 * (10.7 * t).sin(), 0.012 * (18.2 * t + 0.4).sin()]
}

/// A pen at about 200 Hz that rests, jumps and falls silent, and repeats itself at times.
fn hand(tick: u64, bench: &Bench) -> Vec<PenReading> {
    let t = tick as f64 * PERIOD_NS as f64 * 1e-9;
    let due =
        (tick.is_multiple_of(5) || tick % 5 == 3) && !(900..1020).contains(&tick) && !tick.is_multiple_of(97);
    let shift = if tick > 1300 { 0.03 } else { 0.0 };
    let [x, y] = if (400..460).contains(&tick) { curve(0.8) } else { curve(t) };
    let copies = if due { 1 + usize::from(tick.is_multiple_of(55)) } else { 0 };
    vec![bench.pen([x + shift, y]); copies]
}

fn with_everything(kind: PredictorKind) -> FollowerSettings<6> {
    let mut settings = settings(kind);
    settings.models = models_with_network();
    settings.weights = settings.models.initial_weights();
    settings.following = Following::Measured { max_ns: 80_000_000, rate: 0.1 };
    settings.dead_time_ns = 12_000_000;
    settings.velocity_lead_ns = 20_000_000;
    settings.mpc.servo_s = 0.03;
    settings.clearance = Some(ClearanceSettings { margin_m: 0.01, itself: true, obstacles: Vec::new() });
    settings
}

#[test]
fn every_predictor_carries_on_bit_for_bit() {
    for kind in PredictorKind::LIVE {
        let mut teacher = learner();
        let mut fresh = None;
        let Seen { modes, .. } =
            carried(&with_everything(kind), HOME, 1700, &[0, 3, 137, 421, 950, 1310], |tick, bench| {
                let pen = hand(tick, bench);
                // A learner of its own: what counts is that weights come in at some time.
                if tick.is_multiple_of(5) {
                    let [x, y] = curve(tick as f64 * 0.002);
                    let step = LearnStep {
                        index: tick / 5,
                        motion: foretrace_control::pen::Motion::Continues,
                        pen: on_paper([900.0 * x, 900.0 * y]),
                        ..LearnStep::default()
                    };
                    if teacher.learn(&step).hand_over {
                        fresh = Some(Box::new(*teacher.weights()));
                    }
                }
                let request = match tick {
                    5 => Some(Request::Arm),
                    1100 => Some(Request::SetTrust(0.4)),
                    1200 => Some(Request::TrustAuto),
                    1500 => Some(Request::SwitchPredictor(PredictorKind::DYBM)),
                    _ => None,
                };
                let shed = tick % 61 < 3;
                Given {
                    pen,
                    request,
                    budget: Budget { shed, ..Budget::default() },
                    weights: if tick.is_multiple_of(40) { fresh.take() } else { None },
                    ..Given::default()
                }
            });
        assert!(modes.contains(&Mode::Following) && modes.contains(&Mode::Holding), "{kind:?}: {modes:?}");
    }
}

/// Of a process that knows the pen's path, lies for a while, falls silent, comes back, and is followed by
/// another: cut while its part rises, is whole, falls, is none, and between a step and its preview.
#[test]
fn the_predictor_of_another_process_carries_on_bit_for_bit() {
    let mut settings = with_everything(PredictorKind::AR_RLS);
    settings.preview.fallback = PredictorKind::AR_RLS;
    let path = |s: f64| curve(s);
    let script = |tick: u64, bench: &Bench| {
        let due = tick.is_multiple_of(2);
        let at = |stamp_ns: u64| path(stamp_ns as f64 * 1e-9);
        let closed = bench.now.0 / STEP_NS - 1;
        let request = match tick {
            5 => Some(Request::Arm),
            200 => Some(Request::SwitchPredictor(PredictorKind::EXTERNAL)),
            2400 => Some(Request::SwitchPredictor(PredictorKind::AR_RLS)),
            2500 => Some(Request::SwitchPredictor(PredictorKind::EXTERNAL)),
            _ => None,
        };
        let way = if (900..960).contains(&tick) { -1.0 } else { 1.0 };
        let sender = u64::from(tick >= 2100);
        let mut preview = ExternalPreview { base_index: closed, count: 64, sender, ..ExternalPreview::EMPTY };
        let [x0, y0] = at(closed * STEP_NS);
        for (ahead, slot) in (1..).zip(&mut preview.positions) {
            let [x, y] = at((closed + ahead) * STEP_NS);
            *slot = [x0 + way * (x - x0), y0 + way * (y - y0)];
        }
        let answers = tick % 5 < 2 && !(1500..1800).contains(&tick);
        Given {
            pen: if due { vec![bench.pen(at(bench.now.0))] } else { Vec::new() },
            request,
            preview: answers.then(|| Box::new(preview)),
            ..Given::default()
        }
    };
    let cuts = [
        150, 201, 500, 602, 900, 930, 941, 960, 1400, 1401, 1520, 1700, 1850, 2100, 2101, 2110, 2399, 2510,
        3000,
    ];
    let Seen { modes, parts } = carried(&settings, HOME, 3200, &cuts, script);
    assert!(modes.contains(&Mode::Following), "{modes:?}");
    let within =
        |least: f64, most: f64| parts.iter().filter(|(_, part)| (least..=most).contains(part)).count();
    assert!(within(1.0, 1.0) > 300 && within(0.01, 0.99) > 20 && within(0.0, 0.0) > 300, "{parts:?}");
}

#[test]
fn the_way_home_stops_and_a_held_switch_carry_on_bit_for_bit() {
    let mut kept = with_everything(PredictorKind::MIXTURE);
    kept.safety.enable_required = true;
    let away = {
        let mut away = HOME;
        away[0] += 0.4;
        away[2] += 0.3;
        away
    };
    let cuts = [20, 100, 260, 500, 800, 1500, 1610, 1700, 1900];
    let Seen { modes, .. } = carried(&kept, away, 2100, &cuts, |tick, bench| {
        let request = match tick {
            2 => Some(Request::MoveHome),
            700 => Some(Request::Stop),
            780 => Some(Request::MoveHome),
            1600 => Some(Request::Arm),
            1800 => Some(Request::Disarm),
            _ => None,
        };
        Given {
            pen: if tick > 1550 { hand(tick, bench) } else { Vec::new() },
            request,
            enable: (tick.is_multiple_of(10))
                .then_some(EnableReading { stamp: bench.now, stop: tick == 1700 }),
            // One lost joint state now and then.
            silent: tick.is_multiple_of(83),
            ..Given::default()
        }
    });
    assert!(modes.contains(&Mode::Homing) && modes.contains(&Mode::Stopped), "{modes:?}");
}

/// Cut where the arm is asked to go half of the way to the preview.
#[test]
fn an_arm_at_its_limits_carries_on_bit_for_bit() {
    let mut weak = settings(PredictorKind::CONSTANT_VELOCITY);
    weak.dead_time_ns = 30_000_000;
    weak.mpc.axes.iter_mut().for_each(|axis| axis.acceleration_mps2 = 3.0);
    let begin = Bench::new(weak.clone()).now;
    let script = |tick: u64, bench: &Bench| {
        let due = matches!(tick % 5, 0 | 3);
        let pen = due.then(|| bench.pen(scribble(bench.now.seconds_since(begin))));
        Given {
            pen: pen.into_iter().collect(),
            request: (tick == 2).then_some(Request::Arm),
            ..Given::default()
        }
    };
    let mut bench = Bench::new(weak.clone());
    let half = (0..10_000).find(|&tick| {
        let given = script(tick, &bench);
        bench.tick_with(&given.pen, given.request, given.budget).governor < 0.5
    });
    let half = half.expect("never held back");
    let Seen { modes, .. } = carried(&weak, HOME, half + 300, &[half / 2, half + 1], script);
    assert!(modes.contains(&Mode::Following), "{modes:?}");
}

fn running() -> (FollowerSettings<6>, Vec<u8>) {
    let settings = with_everything(PredictorKind::MIXTURE);
    let mut bench = Bench::armed(settings.clone());
    for tick in 0..600 {
        let pen = hand(tick, &bench);
        bench.tick(&pen);
    }
    (settings, state::bytes_of(&bench.follower).unwrap())
}

#[test]
fn bytes_that_are_no_state_are_refused_and_never_panic() {
    let (settings, bytes) = running();
    let load = |bytes: &[u8]| {
        let mut other = Follower::<10, 6>::new(settings.clone()).unwrap();
        state::read(&mut other, bytes).map(|()| other)
    };
    assert!(load(&bytes).is_ok());
    for cut in [0, 1, bytes.len() / 2, bytes.len() - 1] {
        assert_eq!(load(&bytes[..cut]).unwrap_err(), StateError::Short { have: cut });
    }
    let longer = [&bytes[..], &[0, 0]].concat();
    assert_eq!(load(&longer).unwrap_err(), StateError::Long { left: 2 });
    let of_others = Follower::<10, 6>::new(self::settings(PredictorKind::HOLD)).unwrap();
    let of_others = state::bytes_of(&of_others).unwrap();
    assert!(load(&of_others).is_err(), "a law without clearance");

    // Whatever a flipped byte means, the law stays total with it.
    let mut rng = Pcg64::seed_from_u64(32);
    for _ in 0..120 {
        let mut flipped = bytes.clone();
        for _ in 0..rng.random_range(1..6) {
            let at = rng.random_range(0..flipped.len());
            flipped[at] = rng.random();
        }
        let Ok(mut other) = load(&flipped) else { continue };
        let mut now = Stamp(11_300_000_000);
        for tick in 0..40 {
            let pen = PenReading::new(now, curve(f64::from(tick) * 0.002), true);
            let input = StepInput { pen: &[pen], ..StepInput::nothing(now) };
            other.step(&input, Budget::default(), &mut NoClock);
            now = now + PERIOD_NS;
        }
    }
}

#[test]
fn a_state_needs_room_and_the_exact_solver() {
    let (settings, bytes) = running();
    let follower = Follower::<10, 6>::new(settings.clone()).unwrap();
    let mut room = vec![0; 2 * bytes.len()];
    let taken = state::write(&follower, &mut room).unwrap();
    assert!(state::write(&follower, &mut room[..taken - 1]).is_none());

    let mut other = settings;
    other.mpc.backend = Backend::Other(&ClarabelProfile::Tuned);
    assert!(state::bytes_of(&Follower::<10, 6>::new(other).unwrap()).is_none());
}
