//! Arms behind a socket: the figures of a built-in arm bit for bit, and peers that are not to be trusted.

use std::io::{Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foretrace_control::estimate::LawParameters;
use foretrace_control::follower::JointCommand;
use foretrace_control::stop::{StopCause, StopReason};
use foretrace_control::units::Stamp;
use foretrace_lab::closed_loop::{
    BenchArm, Benchmark, Flaws, Rival, SequenceScore, Trial, TrialError, Tried,
};
use foretrace_lab::experiments::{ArmKind, LawEntrant, Watched};
use foretrace_lab::lockstep::{
    ARM_HELLO, ArmAnswer, ArmEffortUnit, ArmHello, COMMAND, Command, LAW_HELLO, LawHello, STATE, SocketArm,
    begin,
};
use foretrace_sim::arm::{Fault, FaultKind, JOINTS};

use crate::closed_loop::{config, hand};

const TIMEOUT: Duration = Duration::from_secs(20);

/// A peer in a thread, and the socket that it listens at.
fn peer(work: impl FnOnce(UnixStream) + Send + 'static) -> (tempfile::TempDir, PathBuf, JoinHandle<()>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arm");
    let listener = UnixListener::bind(&path).unwrap();
    let thread = std::thread::spawn(move || work(listener.accept().unwrap().0));
    (folder, path, thread)
}

fn heard(stream: &mut UnixStream) -> LawHello {
    let mut bytes = [0; LAW_HELLO];
    stream.read_exact(&mut bytes).unwrap();
    LawHello::decode(&bytes).unwrap()
}

/// Answers as `kind` until the law goes away.
fn answer(mut stream: UnixStream, kind: ArmKind) {
    let hello = heard(&mut stream);
    let mut arm = kind.built(hello.home);
    let group_delay_s = kind.facts().group_delay_s;
    let own = ArmHello { rate_hz: 500.0, group_delay_s, effort: ArmEffortUnit::NewtonMetre, q: hello.home };
    stream.write_all(&own.encode()).unwrap();
    let mut bytes = [0; COMMAND];
    while stream.read_exact(&mut bytes).is_ok() {
        let Command { until, tick, enabled, q, qd } = Command::decode(&bytes).unwrap();
        let command = JointCommand { stamp: until, valid_until: until, q, qd, enabled };
        let is = arm.step(until, Some(&command)).unwrap();
        let effort = [tick as f64; JOINTS];
        let state = ArmAnswer { stamp: is.stamp, tick, motion_allowed: true, q: is.q, qd: is.qd, effort };
        stream.write_all(&state.encode()).unwrap();
    }
}

fn connected(path: &Path, timeout: Duration) -> Result<SocketArm, String> {
    let config = config();
    let period_ns = config.settings().period_ns();
    let hello = LawHello { period_ns, begin: begin(period_ns), home: config.robot().home };
    SocketArm::connect(path, timeout, &hello).map_err(|error| error.to_string())
}

fn trial(path: &Path, timeout: Duration, stop_at_s: Option<f64>) -> Result<Tried, String> {
    let config = config();
    let what = Trial {
        config: &config,
        like: BenchArm::Ur5,
        law: LawEntrant::Mixture,
        hand: &hand(BenchArm::Ur5, &config, &["a", "8"]),
        stop_at_s,
        after_stop_s: 0.5,
    };
    let mut last = 0.0;
    let mut see = |_: usize, tick: &Watched<'_>| {
        assert!(tick.t_s > last, "time goes on");
        last = tick.t_s;
    };
    let text = |error: TrialError| error.to_string();
    what.run(Box::new(connected(path, timeout)?), &mut see).map_err(text)
}

/// Every number of a score as bits.
fn bits(score: &Option<SequenceScore>) -> Vec<u64> {
    let score = score.as_ref().unwrap();
    let floats = [score.mse_m2, score.pen_down_mse_m2, score.max_m, score.lag_ms, score.rms_jerk];
    let counts = [score.limited, score.illegal, score.ticks].map(u64::from);
    floats.map(f64::to_bits).into_iter().chain(counts).collect()
}

#[test]
fn an_arm_behind_a_socket_that_answers_as_a_built_in_one_gives_its_figures_to_the_bit() {
    let config = config();
    let (_folder, path, thread) = peer(move |stream| answer(stream, BenchArm::Ur5.kind(&self::config())));
    let tried = trial(&path, TIMEOUT, None).unwrap();
    thread.join().unwrap();
    let benchmark = Benchmark {
        config: &config,
        arms: vec![(BenchArm::Ur5, vec![hand(BenchArm::Ur5, &config, &["a", "8"])])],
        rivals: vec![Rival::AS_SHIPPED],
        flaws: Flaws::default(),
        law: LawParameters::SHIPPED,
    };
    let outcomes = benchmark.run(|| {}).unwrap();
    let [outcome] = outcomes.as_slice() else { panic!("one outcome") };
    assert_eq!(tried.scores.len(), 2);
    for (there, here) in tried.scores.iter().zip(&outcome.scores) {
        assert_eq!(bits(there), bits(here));
    }
    assert_eq!((tried.stop, tried.illegal), (None, 0));
}

#[test]
fn a_stop_that_is_asked_for_is_reported_with_the_time_to_rest() {
    let (_folder, path, thread) = peer(move |stream| answer(stream, BenchArm::Ur5.kind(&config())));
    let tried = trial(&path, TIMEOUT, Some(1.5)).unwrap();
    thread.join().unwrap();
    let stop = tried.stop.unwrap();
    assert_eq!((stop.reason, stop.sequence), (StopReason::Requested, 0));
    assert!((stop.t_s - 1.502).abs() < 1e-9, "{stop:?}");
    assert!(stop.rest_after_s.is_some_and(|rest_s| rest_s < 0.2), "{stop:?}");
    assert!((tried.seconds - stop.t_s - 0.5).abs() < 3e-3, "{tried:?}");
    assert!(tried.scores.len() == 1 && tried.scores[0].is_some_and(|score| score.ticks > 0));
}

#[test]
fn a_stop_of_the_law_is_reported_with_its_cause() {
    let fault = Some(Fault { kind: FaultKind::Runaway(0.5), at_s: 1.5 });
    let kind = move || match BenchArm::Ur5.kind(&config()) {
        ArmKind::Ur5(arm) => ArmKind::Ur5(foretrace_sim::arm::ArmSettings { fault, ..arm }),
        kind => kind,
    };
    let (_folder, path, thread) = peer(move |stream| answer(stream, kind()));
    let tried = trial(&path, TIMEOUT, None).unwrap();
    thread.join().unwrap();
    let stop = tried.stop.unwrap();
    assert_eq!(stop.reason, StopReason::TrackingError);
    assert!(stop.detail.cause != StopCause::None && stop.detail.amount > stop.detail.limit, "{stop:?}");
    assert!((1.5..2.0).contains(&stop.t_s), "{stop:?}");
}

/// A peer that says hello and then answers the command of tick 3 with `bytes` of `change`.
fn answered(change: impl Fn(ArmAnswer, Stamp) -> Vec<u8> + Send + 'static) -> String {
    let (_folder, path, thread) = peer(move |mut stream| {
        let hello = heard(&mut stream);
        let own = ArmHello {
            rate_hz: 500.0,
            group_delay_s: None,
            effort: ArmEffortUnit::NewtonMetre,
            q: hello.home,
        };
        stream.write_all(&own.encode()).unwrap();
        let mut bytes = [0; COMMAND];
        while stream.read_exact(&mut bytes).is_ok() {
            let Command { until, tick, q, .. } = Command::decode(&bytes).unwrap();
            let zero = [0.0; JOINTS];
            let state = ArmAnswer { stamp: until, tick, motion_allowed: true, q, qd: zero, effort: zero };
            let sent = if tick == 3 { change(state, until) } else { state.encode().to_vec() };
            if stream.write_all(&sent).is_err() {
                return;
            }
        }
    });
    let error = trial(&path, Duration::from_millis(300), None).unwrap_err();
    thread.join().unwrap();
    assert!(error.contains("tick 3") && error.contains("arm"), "{error}");
    error
}

#[test]
fn states_that_may_not_be_are_refused_with_what_and_where() {
    let with = |change: fn(&mut ArmAnswer, Stamp)| {
        answered(move |mut state, until| {
            change(&mut state, until);
            state.encode().to_vec()
        })
    };
    for (error, wanted) in [
        (with(|state, _| state.q[2] = f64::NAN), "q [rad] of joint 2 is NaN"),
        (with(|state, _| state.q[5] = 13.0), "q [rad] of joint 5 is 13"),
        (with(|state, _| state.qd[0] = f64::INFINITY), "of joint 0 is inf"),
        (with(|state, _| state.effort[1] = f64::NAN), "the effort of joint 1 is NaN"),
        (with(|state, until| state.stamp = Stamp(until.0 - 7_000_000)), "before the one before it"),
        (with(|state, until| state.stamp = Stamp(until.0 + 1)), "after the instant"),
        (with(|state, _| state.tick = 2), "answers command 2, 3 is due"),
        (with(|state, _| state.tick = 4), "answers command 4, 3 is due"),
    ] {
        assert!(error.contains(wanted), "{error}: {wanted}");
    }
}

#[test]
fn messages_of_another_size_kind_or_version_are_refused() {
    let with = |at: usize, byte: u8| {
        answered(move |state, _| {
            let mut bytes = state.encode().to_vec();
            bytes[at] = byte;
            bytes
        })
    };
    for (error, wanted) in [
        (with(0, b'X'), "instead of \"FTLS\""),
        (with(4, 9), "version 9"),
        (with(6, 1), "kind 1, expected 4"),
        (with(8, 7), "7 bytes, it must have 184"),
        (with(12, 7), "7 joints"),
        (with(32, 2), "the flags is 2"),
    ] {
        assert!(error.contains(wanted), "{error}: {wanted}");
    }
    assert_eq!(
        (LAW_HELLO, ARM_HELLO, COMMAND, STATE),
        (80, 88, 136, 184),
        "as docs/extend/judge.md has them"
    );
}

#[test]
fn a_peer_that_is_silent_drips_or_goes_away_ends_the_run() {
    let began = Instant::now();
    assert!(answered(|_, _| Vec::new()).contains("says nothing for 0.3 s"));
    assert!(answered(|state, _| state.encode()[..100].to_vec()).contains("says nothing for 0.3 s"));
    assert!(began.elapsed() < Duration::from_secs(30));
    let (_folder, path, thread) = peer(|mut stream| {
        let hello = heard(&mut stream);
        let (effort, q) = (ArmEffortUnit::None, hello.home);
        stream.write_all(&ArmHello { rate_hz: 500.0, group_delay_s: None, effort, q }.encode()).unwrap();
        let mut bytes = [0; COMMAND];
        stream.read_exact(&mut bytes).unwrap();
    });
    let error = trial(&path, TIMEOUT, None).unwrap_err();
    thread.join().unwrap();
    assert!(error.contains("closed the connection"), "{error}");
    // One byte every 100 ms: never silent, never whole.
    let (_folder, path, thread) = peer(|mut stream| {
        heard(&mut stream);
        while stream.write_all(b"F").is_ok() {
            std::thread::sleep(Duration::from_millis(100));
        }
    });
    let error = connected(&path, Duration::from_millis(300)).unwrap_err();
    thread.join().unwrap();
    assert!(error.contains("says nothing") || error.contains("instead of"), "{error}");
}

#[test]
fn a_hello_that_may_not_be_is_refused() {
    let with = |change: fn(&mut ArmHello)| {
        let (_folder, path, thread) = peer(move |mut stream| {
            let q = heard(&mut stream).home;
            let mut own =
                ArmHello { rate_hz: 500.0, group_delay_s: Some(0.03), effort: ArmEffortUnit::None, q };
            change(&mut own);
            let _ = stream.write_all(&own.encode());
        });
        let error = connected(&path, TIMEOUT).unwrap_err();
        thread.join().unwrap();
        error
    };
    assert!(with(|own| own.rate_hz = f64::NAN).contains("the rate [Hz] is NaN"));
    assert!(with(|own| own.group_delay_s = Some(2.0)).contains("legal is 0 to 1"));
    assert!(with(|own| own.q[3] = f64::INFINITY).contains("of joint 3 is inf"));
    let nobody = connected(Path::new("/nonexistent/arm"), TIMEOUT).unwrap_err();
    assert!(nobody.contains("start the simulator"), "{nobody}");
}
