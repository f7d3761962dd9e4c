//! A request for the way home is answered once: when the way has been checked or a stop came before.

use std::sync::Arc;

use foretrace_control::follower::HomeProgress;

use super::*;
use crate::rt::stops::StopFlag;

/// The arm stands with its base turned by a radian, and the way home is requested; not answered yet.
fn asking() -> Bench {
    let mut bench = Bench::new();
    bench.joints.q[0] -= 1.0;
    let (stamp, sent) = (Stamp(bench.release), Stamp(bench.release));
    bench.ipc.requests.push(LoopRequest { token: 5, request: Request::MoveHome, stamp, sent }).unwrap();
    let first = bench.run(0);
    assert_eq!((first.output.mode, first.output.answer), (Mode::Homing, Some(Ok(()))));
    assert_eq!(first.output.home.map(|home: HomeProgress| home.moving), Some(false));
    assert!(bench.ipc.answers.pop().is_err(), "the way is not known yet");
    bench
}

#[test]
fn who_asks_hears_when_the_way_is_known_and_once() {
    let mut bench = asking();
    let mut answers = Vec::new();
    for _ in 0..20_000 {
        let facts = bench.run(0);
        while let Ok(answer) = bench.ipc.answers.pop() {
            assert_eq!(answer.mode, Mode::Homing);
            assert!(facts.output.home.is_some_and(|home| home.moving));
            answers.push((answer.token, answer.outcome));
        }
        if facts.output.mode == Mode::Idle {
            break;
        }
    }
    assert_eq!(answers, [(5, Ok(()))]);
    let home = config().follower_settings().ik.home;
    let off = bench.joints.q.iter().zip(&home).map(|(q, home)| (q - home).abs()).fold(0.0, f64::max);
    assert!(off < 1e-9, "{off}");
    assert_eq!(bench.ask(6, Request::Arm).outcome, Ok(()));
}

#[test]
fn a_stop_before_the_way_is_known_is_the_answer() {
    let mut bench = asking();
    let stopped = bench.ask(6, Request::Stop);
    let both = [stopped, bench.ipc.answers.pop().unwrap()].map(|answer| (answer.token, answer.outcome));
    assert_eq!(both, [(6, Ok(())), (5, Err(Refusal::StopCame))]);
    assert!(bench.ipc.answers.pop().is_err());
}

#[test]
fn a_request_that_was_sent_before_a_stop_moves_nothing() {
    let flag = Arc::new(StopFlag::default());
    let mut bench = Bench::new();
    bench.tick.supervise(Stops::new(flag.clone()), OverrunLimit::NONE);
    flag.ask();
    let (stamp, sent) = (Stamp(bench.release), Stamp(bench.release - 1_000_000));
    bench.ipc.requests.push(LoopRequest { token: 5, request: Request::MoveHome, stamp, sent }).unwrap();
    let facts = bench.run(0);
    assert_eq!((facts.output.mode, facts.output.command), (Mode::Idle, None));
    assert_eq!(bench.ipc.answers.pop().unwrap().outcome, Err(Refusal::StopCame));
}
