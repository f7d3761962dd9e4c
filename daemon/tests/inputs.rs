//! What a running daemon sends of its inputs is enough to run its ticks again, bit for bit.

mod support;

use std::collections::BTreeMap;
use std::time::Duration;

use foretrace_config::Config;
use foretrace_control::follower::{Follower, NoClock};
use foretrace_control::predict::{ExternalPreview, OnlineWeights};
use foretrace_control::state;
use foretrace_shm::{
    Assembly, ControlOp, HeaderBounds, Message, Mode, Piece, PieceKind, Services, Session, Thing, TickInput,
};
use foretraced::rt::tick::STATE_BYTES;
use foretraced::wire;
use support::{Operator, Running, Site, arm, pen, predictor, turn};

/// Everything that came, in order.
#[derive(Default)]
struct Captured {
    inputs: Vec<TickInput>,
    snapshots: Vec<Thing>,
    modes: std::collections::BTreeSet<u32>,
}

impl Captured {
    fn snapshot(&self, kind: PieceKind) -> &Thing {
        self.snapshots.iter().find(|snapshot| snapshot.kind == kind).expect("it was sent")
    }
}

/// Listens until `enough`, while `during` acts.
fn listen(site: &Site, mut enough: impl FnMut(&Captured) -> bool) -> Captured {
    let session = Session::open(&site.instance(), "recorder").unwrap();
    let services = Services::open(&session).unwrap();
    let mut inputs = services.inputs.subscriber(TickInput::QOS.buffer, HeaderBounds::DEFAULT).unwrap();
    let mut pieces = services.pieces.subscriber(Piece::QOS.buffer, HeaderBounds::DEFAULT).unwrap();
    let (mut captured, mut assembly) = (Captured::default(), Assembly::default());
    let since = std::time::Instant::now();
    while !enough(&captured) {
        assert!(since.elapsed() < Duration::from_secs(60), "{} inputs", captured.inputs.len());
        inputs.drain(|input| {
            captured.modes.insert(input.mode);
            captured.inputs.push(input);
        });
        pieces.drain(|piece| captured.snapshots.extend(assembly.add(&piece)));
        std::thread::sleep(Duration::from_millis(2));
    }
    // A set of weights may still be on its way in pieces when the tick that was offered it is here.
    for _ in 0..150 {
        pieces.drain(|piece| captured.snapshots.extend(assembly.add(&piece)));
        std::thread::sleep(Duration::from_millis(2));
    }
    assert_eq!((inputs.rejections().total(), pieces.rejections().total()), (0, 0));
    captured
}

/// Runs the ticks after the state again; returns how many, up to the first gap.
fn again(captured: &Captured) -> usize {
    let toml = String::from_utf8(captured.snapshot(PieceKind::Settings).bytes.clone()).unwrap();
    let config = Config::parse(&toml, "recorded", ".").unwrap();
    let start = captured.snapshot(PieceKind::State);
    assert!(start.bytes.len() < STATE_BYTES / 2, "{} bytes", start.bytes.len());
    println!("state of {} bytes", start.bytes.len());
    let mut sets: BTreeMap<u64, OnlineWeights> = BTreeMap::new();
    for set in captured.snapshots.iter().filter(|snapshot| snapshot.kind == PieceKind::Weights) {
        let mut weights = config.follower_settings().weights;
        state::read(&mut weights, &set.bytes).unwrap();
        assert_eq!(weights.version, set.number);
        sets.insert(set.number, weights);
    }
    assert_eq!(config.settings().mpc.horizon, 20);
    let mut follower = Follower::<20, 6>::new(config.follower_settings()).unwrap();
    state::read(&mut follower, &start.bytes).unwrap();
    let (mut next, mut ticks, mut pen) = (start.number + 1, 0, Vec::new());
    for input in captured.inputs.iter().filter(|input| input.tick > start.number) {
        if input.tick != next {
            break;
        }
        pen.extend(input.pen().iter().map(wire::pen_of));
        if input.part + 1 < input.parts {
            continue;
        }
        let given = wire::given(input).unwrap();
        assert!(given.complete);
        let weights = given.weights.map(|version| &sets[&version]);
        let preview = given.preview.then(|| {
            let mut preview = ExternalPreview::EMPTY;
            let kept = captured
                .snapshots
                .iter()
                .find(|kept| (kept.kind, kept.number) == (PieceKind::Preview, input.tick));
            state::read(&mut preview, &kept.expect("a preview is missing").bytes).unwrap();
            preview
        });
        let input_of = given.step_input(&pen, weights, preview.as_ref());
        let output = follower.step(&input_of, given.budget, &mut NoClock);
        let mut wanted = wire::tick_input(input.tick, input.daemon_id, &given, &output);
        wanted.header = input.header;
        (wanted.part, wanted.pen) = (input.part, input.pen);
        assert_eq!(format!("{input:?}"), format!("{wanted:?}"));
        pen.clear();
        next += 1;
        ticks += 1;
    }
    ticks
}

/// The fallback is Hold, which it beats: the previews are used.
#[test]
fn ticks_with_a_predictor_of_another_process_can_be_run_again_with_its_previews() {
    let _turn = turn();
    let site = Site::new();
    let source = site.source().with("predictor.kind", "\"external\"");
    let daemon = Running::start(&site, source.with("predictor.external.fallback", "\"hold\""));
    let mut operator = Operator::attach(&site);
    let (_arm, _log) = arm(&site);
    let (_pen, first) = (pen(&site), predictor(&site));
    operator.status_when("joint states arrive", |status| status.joint_state_age_ns != u64::MAX);
    assert!(operator.ask(ControlOp::Arm, 0.0).is_success());
    operator.status_when("its part is whole", |status| status.external.weight == 1.0);
    drop(first);
    let _next = predictor(&site);
    operator.status_when("the next process has no part yet", |status| status.external.weight == 0.0);
    operator.status_when("its part is whole", |status| status.external.weight == 1.0);
    let captured = listen(&site, |captured| captured.inputs.len() > 1500);
    let kept = captured.snapshots.iter().filter(|snapshot| snapshot.kind == PieceKind::Preview);
    let senders = kept.map(|snapshot| {
        let mut preview = ExternalPreview::EMPTY;
        state::read(&mut preview, &snapshot.bytes).unwrap();
        preview.sender
    });
    let senders: Vec<u64> = senders.collect();
    assert!(senders.len() > 100 && senders.iter().all(|sender| *sender == 1), "{senders:?}");
    let ticks = again(&captured);
    assert!(ticks > 300, "{ticks} ticks until a gap");
    let status = daemon.end().unwrap().status;
    let external = status.external;
    assert!(external.taken > 200 && external.latency.p50_ns > 0 && external.hits > 200, "{external:?}");
    assert_eq!((status.counters.telemetry_failed, status.counters.allocations), (0, 0));
}

#[test]
fn ticks_of_a_running_daemon_can_be_run_again_from_a_state_in_the_middle() {
    let _turn = turn();
    let site = Site::new();
    let daemon = Running::start(&site, site.source());
    let mut operator = Operator::attach(&site);
    let (_arm, _log) = arm(&site);
    let _pen = pen(&site);
    operator.status_when("joint states arrive", |status| status.joint_state_age_ns != u64::MAX);
    assert!(operator.ask(ControlOp::Arm, 0.0).is_success());
    // Not from the beginning: the learner has taught something by then.
    operator.status_when("weights came", |status| status.learner_version > 0);

    let mut asked = 0;
    let captured = listen(&site, |captured| {
        let came = captured.inputs.len();
        if came > 600 && asked == 0 {
            asked = 1;
            assert!(operator.ask(ControlOp::SetTrust, 0.3).is_success());
        }
        if came > 1000 && asked == 1 {
            asked = 2;
            assert!(operator.ask(ControlOp::Stop, 0.0).is_success());
        }
        came > 1500
    });
    let offered = captured.inputs.iter().filter(|input| input.weights_version > 0).count();
    assert!(offered > 0, "no weights were offered");
    assert!(captured.modes.contains(&u32::from(Mode::Following)), "{:?}", captured.modes);
    assert!(captured.modes.contains(&u32::from(Mode::Stopped)), "{:?}", captured.modes);
    let ticks = again(&captured);
    assert!(ticks > 300, "{ticks} ticks until a gap");

    // A second listener gets a start of its own.
    let later = listen(&site, |captured| {
        captured.inputs.len() > 300
            && captured.snapshots.iter().any(|snapshot| snapshot.kind == PieceKind::State)
    });
    assert!(later.snapshot(PieceKind::State).number > captured.snapshot(PieceKind::State).number);
    assert!(again(&later) > 20);
    let status = daemon.end().unwrap().status;
    assert_eq!(status.counters.telemetry_failed, 0);
}
