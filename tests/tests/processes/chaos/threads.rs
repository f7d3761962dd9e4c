//! A thread of the daemon that stands still, held by the kernel from outside as a hang would be. Recovery:
//! from its release to the first command that follows a newer pen sample.
//!
//! A thread that panics cannot be made from outside: see the tests in `daemon/src/learner.rs` and
//! `daemon/src/supervisor/tests.rs`.

use std::time::Duration;

use foretrace_client::monotonic_now_ns;
use foretrace_tests::frozen::Frozen;
use foretrace_tests::{assert_refused, until};

use super::scene::{Scene, say, say_times};

/// Freezes a thread of the scene's daemon; says so where that is forbidden.
fn frozen(scene: &Scene, name: &str) -> Option<Frozen> {
    let frozen = Frozen::thread_of(scene.daemon.as_ref().expect("a daemon").pid(), name);
    if frozen.is_none() {
        say(name, "skipped: this system does not let a process trace its child");
    }
    frozen
}

#[test]
fn learner_thread_hangs() {
    let scene = Scene::following();
    until("something is learnt", || (scene.count("/learner/updates") > 50).then_some(()));
    let Some(held) = frozen(&scene, "foretrace-learn") else { return drop(scene.end()) };
    let learnt = scene.count("/learner/updates");
    // The loop does not wait; records without room are counted, and the age of the weights shows.
    until("the learner's ring is full", || (scene.count("/dropped/learner_ring") > 0).then_some(()));
    assert!(scene.count("/learner/updates") <= learnt + 256);
    let since = monotonic_now_ns();
    scene.follows_again(since);
    assert_eq!(scene.world.status(0)["mode"], "following");
    drop(held);
    let since = monotonic_now_ns();
    let learnt = scene.count("/learner/updates");
    until("it learns again", || (scene.count("/learner/updates") > learnt).then_some(()));
    let took = (monotonic_now_ns() - since) as f64 * 1e-6;
    say("learner hangs", &format!("the loop went on; learning again {took:.0} ms after the release"));
    let report = scene.end();
    assert_eq!(report["begins"], 1, "{report}");
}

#[test]
fn ipc_thread_hangs() {
    let scene = Scene::following();
    let Some(held) = frozen(&scene, "foretrace-ipc") else { return drop(scene.end()) };
    // A request fails with a timeout, within a bound.
    assert_refused(&scene.world.run(0, &["status"]), 3, &["reports no status"]);
    let asked = scene.world.run(0, &["request", "query", "--timeout", "0.5"]);
    assert_refused(&asked, 1, &["answer"]);
    let since = monotonic_now_ns();
    scene.follows_again(since);
    std::thread::sleep(Duration::from_millis(500));
    drop(held);
    let since = monotonic_now_ns();
    // More records than the ring holds were made meanwhile.
    until("what was lost is counted", || (scene.count("/dropped/telemetry_ring") > 0).then_some(()));
    let took = (monotonic_now_ns() - since) as f64 * 1e-6;
    say("ipc hangs", &format!("the loop went on; status again {took:.0} ms after the release"));
    let report = scene.end();
    assert_eq!(report["begins"], 1, "{report}");
}

#[test]
fn real_time_thread_hangs() {
    let mut scene = Scene::following();
    let Some(held) = frozen(&scene, "foretrace-rt") else { return drop(scene.end()) };
    // The arm brakes by itself; the daemon answers that its loop does not.
    std::thread::sleep(Duration::from_millis(500));
    let asked = scene.world.run(0, &["request", "stop", "--timeout", "1"]);
    assert!(!asked.status.success(), "{}", foretrace_tests::told(&asked));
    drop(held);
    let since = monotonic_now_ns();
    until("a stop is latched", || {
        let status = scene.world.status(0);
        (status["mode"] == "stopped" || status["mode"] == "fault").then_some(())
    });
    assert_eq!(scene.world.status(0)["fault"], "time lost");
    scene.rearm();
    say_times("real-time thread hangs", vec![scene.follows_again(since)]);
    scene.end();
}
