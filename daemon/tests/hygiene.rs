//! The real-time thread allocates nothing, over real shared memory, while peers come and go.

mod support;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use foretrace_control::contact::{EffortReading, EffortUnit};
use foretrace_control::follower::{Budget, Follower, JointReading, NoClock, Request, Rung, StepInput};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::PredictorKind;
use foretrace_control::units::Stamp;
use foretrace_shm::{ControlOp, ControlStatus, Mode, Stage};
use foretraced::alloc_count::{self, CountingAllocator};
use foretraced::rt::rehearsal::rehearse;
use foretraced::{Rights, Source};
use support::{Operator, Running, Site, arm, pen, turn};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn the_allocator_counts_per_thread() {
    assert!(alloc_count::is_installed());
    let before = alloc_count::allocations();
    std::thread::spawn(|| drop(std::hint::black_box(vec![0_u8; 100]))).join().unwrap();
    let spawning = alloc_count::allocations();
    let kept = std::hint::black_box(vec![0_u8; 100]);
    assert_eq!(alloc_count::allocations(), spawning + 1);
    assert!(spawning > before);
    drop(kept);
}

#[test]
fn a_rehearsal_allocates_nothing_while_it_measures() {
    let settings = Rights::Leave.rt_settings(Source::preset("ur5").load().unwrap().settings());
    let quit = Arc::new(AtomicBool::new(false));
    let seen = rehearse(settings, false, 0.2, quit).unwrap().join().unwrap();
    assert!(!seen.lateness.is_empty());
    assert_eq!(seen.allocations, 0);
}

#[test]
fn no_tick_of_the_way_home_allocates() {
    let settings = Source::preset("ur5").load().unwrap().follower_settings();
    let mut q = settings.ik.home;
    q[0] += 0.4;
    let mut follower = Follower::<20, 6>::new(settings).unwrap();
    let (mut now, mut moved) = (Stamp(1_000_000_000), false);
    let before = alloc_count::allocations();
    for tick in 0..5000 {
        let joints = JointReading { stamp: now, q, qd: [0.0; 6], motion_allowed: true };
        let request = (tick == 0).then_some(Request::MoveHome);
        let effort = EffortReading { stamp: now, effort: [3.0; 6], unit: EffortUnit::NewtonMetres };
        let input =
            StepInput { joints: Some(&joints), effort: Some(&effort), request, ..StepInput::nothing(now) };
        let output = follower.step(&input, Budget::default(), &mut NoClock);
        moved |= output.home.is_some_and(|home| home.share > 0.9);
        let Some(command) = output.command else { break };
        q = command.q;
        now = now.plus_ns(2_000_000);
    }
    assert_eq!(alloc_count::allocations(), before);
    assert!(moved, "the arm went home");
}

/// In mid stroke, where rows hold the tip on the paper.
#[test]
fn no_tick_of_a_stop_allocates() {
    let settings = Source::preset("ur5").load().unwrap().follower_settings();
    let mut q = settings.ik.home;
    let mut follower = Follower::<20, 6>::new(settings).unwrap();
    let (mut now, mut stopping, mut before) = (Stamp(1_000_000_000), 0, 0);
    for tick in 0..1500_u64 {
        let joints = JointReading { stamp: now, q, qd: [0.0; 6], motion_allowed: true };
        let angle = 12.0 * tick as f64 * 0.002;
        let pen = [PenReading::new(now, [0.03 * angle.cos(), 0.03 * angle.sin()], true)];
        let request = match tick {
            1 => Some(Request::Arm),
            1000 => Some(Request::Stop),
            _ => None,
        };
        let input = StepInput { pen: &pen, joints: Some(&joints), request, ..StepInput::nothing(now) };
        if tick == 1000 {
            before = alloc_count::allocations();
        }
        let output = follower.step(&input, Budget::default(), &mut NoClock);
        stopping += u32::from(output.rung == Rung::Stop && tick > 1000);
        q = output.command.map_or(q, |command| command.q);
        now = now.plus_ns(2_000_000);
    }
    assert_eq!(alloc_count::allocations(), before);
    assert!(stopping > 5, "a stop in motion takes some ticks: {stopping}");
}

#[test]
fn with_every_predictor_no_tick_allocates_while_peers_come_and_go() {
    let _turn = turn();
    let site = Site::new();
    let daemon = Running::start(&site, site.source());
    let mut operator = Operator::attach(&site);
    let (arm, log) = arm(&site);
    operator.status_when("joint states arrive", |status| status.joint_state_age_ns != u64::MAX);
    assert_eq!(operator.ask(ControlOp::Arm, 0.0).outcome(), ControlStatus::Ok);
    // Each predictor writes for a while, with weights arriving from the learner.
    for predictor in PredictorKind::LIVE.map(PredictorKind::name) {
        let answer = operator.switch_predictor(predictor);
        assert_eq!(answer.outcome(), ControlStatus::Ok, "{predictor}");
        let pen = pen(&site);
        let process = (predictor == PredictorKind::EXTERNAL.name()).then(|| support::predictor(&site));
        // Trusted as far as the record allows, which for some is not at all; then fully, by an operator.
        let followed = operator.status_when("it follows with the predictor that was asked for", |status| {
            status.mode == u32::from(Mode::Following) && status.predictor.as_str() == Some(predictor)
        });
        operator.status_when("previews are judged", |status| status.tick > followed.tick + 300);
        assert_eq!(operator.ask(ControlOp::SetTrust, 1.0).outcome(), ControlStatus::Ok);
        let taken = operator.status_when("it is trusted", |status| status.trust > 0.9);
        operator
            .status_when("new weights come in", |status| status.learner_version > taken.learner_version + 2);
        assert_eq!(operator.ask(ControlOp::TrustAuto, 0.0).outcome(), ControlStatus::Ok);
        if process.is_some() {
            operator.status_when("its previews are taken", |status| status.external.taken > 100);
        }
        drop((pen, process));
    }
    let learned = operator.status_when("it learns", |status| status.learner_updates > 20);
    assert!(learned.tick > 500);
    // Allocations at the ports may be explained by a peer up to a second later.
    std::thread::sleep(Duration::from_millis(1500));
    let status = operator.status_when("it is judged", |_| true);
    let counters = status.counters;
    println!(
        "{} ticks, {} allocations, {} in {} ticks with a connection; {} commands",
        counters.ticks,
        counters.allocations,
        counters.connection_allocations,
        counters.connection_ticks,
        log.commands.load(Ordering::Relaxed),
    );
    for (stage, spread) in Stage::ALL.iter().zip(status.stages) {
        let [p50, p99, p99_9, max] =
            [spread.p50_ns, spread.p99_ns, spread.p99_9_ns, spread.max_ns].map(|ns| f64::from(ns) * 1e-3);
        println!("{stage:>8} [us]: p50 {p50:8.2}  p99 {p99:8.2}  p99.9 {p99_9:8.2}  max {max:8.2}");
    }
    println!(
        "{} overruns, {} periods lost, {} minor and {} major page faults, missing rights {:#b}",
        counters.overruns,
        counters.skipped_ticks,
        counters.page_faults_minor,
        counters.page_faults_major,
        status.missing_rights,
    );
    assert_eq!(counters.allocations, 0);
    assert_eq!(status.allocations_per_tick, 0.0);
    assert!(counters.connection_allocations > 0, "three pens came and went unnoticed");
    assert_eq!(counters.telemetry_ring_dropped + counters.learner_ring_dropped, 0);
    assert_eq!(log.illegal.load(Ordering::Relaxed), 0);
    assert!(log.commands.load(Ordering::Relaxed) > 500);
    drop(arm);
    daemon.end().unwrap();
}
