//! The arm can be stopped whatever else is broken: `foretrace_client::stop`, from its call to the first
//! braking command as the recorder sees it, under each fault. FORETRACE_STOP_ROUNDS (default 3) is how often
//! each. Only hangs are asserted, never speed.

use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::time::{Duration, Instant};

use foretrace_client::{Mode, StopError, monotonic_now_ns};
use foretrace_tests::frozen::Frozen;
use foretrace_tests::{Process, World, assert_refused, told, until};

use super::scene::{Scene, say};
use crate::PROGRAM;

const TIMEOUT: Duration = Duration::from_secs(5);

fn rounds() -> usize {
    std::env::var("FORETRACE_STOP_ROUNDS").ok().and_then(|text| text.parse().ok()).unwrap_or(3)
}

/// Stops while the value of `fault` lives; then, without it, arms and follows again.
pub(crate) fn stops_under<T>(what: &str, scene: &mut Scene, mut fault: impl FnMut(&Scene) -> T) {
    let mut times = Vec::new();
    for _ in 0..rounds() {
        let lasting = fault(scene);
        let (since, begin) = (monotonic_now_ns(), Instant::now());
        let stopped = foretrace_client::stop(&scene.world.instance(0), TIMEOUT);
        assert!(begin.elapsed() < TIMEOUT + Duration::from_secs(5), "{what}: it outlives its time");
        let stopped = stopped.unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_eq!(stopped.mode, Mode::Stopped, "{what}");
        times.push(until("a braking command", || scene.stopped_at(since)));
        drop(lasting);
        scene.rearm();
        let since = monotonic_now_ns();
        scene.follows_again(since);
    }
    say_quantiles(what, times);
}

fn say_quantiles(what: &str, mut times: Vec<f64>) {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share).ceil() as usize];
    let (p50, p99, max) = (at(0.5), at(0.99), at(1.0));
    say(
        "stop",
        &format!(
            "{what}: first braking command after {p50:.1} ms (p50), {p99:.1} (p99), {max:.1} (max) of {}",
            times.len()
        ),
    );
}

fn hold(scene: &Scene, name: &str) -> Option<Frozen> {
    Frozen::thread_of(scene.daemon.as_ref().expect("a daemon").pid(), name)
}

#[test]
fn stop_with_nothing_else_wrong() {
    let mut scene = Scene::following();
    stops_under("no fault", &mut scene, |_| ());
    scene.end();
}

#[test]
fn stop_while_every_other_thread_hangs() {
    let mut scene = Scene::following();
    if hold(&scene, "foretrace-ipc").is_none() {
        say("stop", "skipped: this system does not let a process trace its child");
        return drop(scene.end());
    }
    let threads = ["foretrace-ipc", "foretrace-learn", "foretrace-log", "foretrace-under"];
    stops_under("ipc, learner, log and supervisor hang", &mut scene, |scene| {
        threads.map(|name| hold(scene, name).expect("traced before"))
    });
    scene.end();
}

#[test]
fn stop_while_even_the_stop_thread_hangs_goes_by_signal() {
    let mut scene = Scene::following();
    let Some(held) = hold(&scene, "foretrace-stop") else { return drop(scene.end()) };
    let since = monotonic_now_ns();
    // The signal has been sent and cannot be confirmed: the call reports it, in time.
    let asked = scene.world.run(0, &["request", "stop", "--timeout", "1"]);
    assert_refused(&asked, 1, &["SIGUSR1", "stop button"]);
    let ms = until("a braking command", || scene.stopped_at(since));
    say(
        "stop",
        &format!(
            "the stop thread hangs: by signal, first braking command after {ms:.1} ms, program included"
        ),
    );
    drop(held);
    scene.rearm();
    let since = monotonic_now_ns();
    scene.follows_again(since);
    scene.end();
}

#[test]
fn stop_without_descriptors_in_the_daemon() {
    let mut scene = Scene::following();
    let pid = scene.daemon.as_ref().expect("a daemon").pid();
    let user = scene.world.user();
    // As the daemon's user, who may lower what is its own.
    let limit = |soft: &str| {
        let words = [format!("--pid={pid}"), format!("--nofile={soft}:")];
        Command::new("prlimit").uid(user).gid(user).args(words).status().is_ok_and(|status| status.success())
    };
    if !limit("1024") {
        say("stop", "skipped: no prlimit here");
        return drop(scene.end());
    }
    struct Scarce<F: Fn(&str) -> bool>(F);
    impl<F: Fn(&str) -> bool> Drop for Scarce<F> {
        fn drop(&mut self) {
            assert!((self.0)("1024"));
        }
    }
    stops_under("the daemon has no descriptor left", &mut scene, |_| {
        assert!(limit("3"));
        Scarce(limit)
    });
    scene.end();
}

/// Takes a place for operators, and stands still.
fn frozen_holder(world: &World) -> Process {
    let mut holder = world.start(0, &["hold-place"]);
    let mut line = String::new();
    let _ = BufReader::new(holder.take_stdout().expect("a pipe")).read_line(&mut line);
    holder.expect_alive();
    assert_eq!(line.trim(), "held");
    holder.signal("-STOP");
    holder
}

#[test]
fn stop_while_frozen_programs_hold_all_places() {
    let mut scene = Scene::following();
    stops_under("four frozen programs hold all places for operators", &mut scene, |scene| {
        let holders: Vec<Process> = (0..4).map(|_| frozen_holder(&scene.world)).collect();
        // Other requests are refused with the holders' names.
        let pids: Vec<String> = holders.iter().map(|holder| holder.pid().to_string()).collect();
        let mut words: Vec<&str> = pids.iter().map(String::as_str).collect();
        words.push("4 places for operators");
        assert_refused(&scene.world.run(0, &["request", "query", "--timeout", "10"]), 1, &words);
        holders
    });
    scene.end();
}

#[test]
fn stop_while_sixteen_programs_are_attached() {
    let mut scene = Scene::following();
    let mut watchers = Vec::new();
    stops_under("no room for another program", &mut scene, |scene| {
        let filled = until("the house is full", || {
            watchers.push(scene.world.start(0, &["hold-node"]));
            std::thread::sleep(Duration::from_millis(100));
            let refused = scene.world.run(0, &["request", "query"]);
            (!refused.status.success()).then(|| told(&refused))
        });
        assert!(filled.contains("places for processes"), "{filled}");
        std::mem::take(&mut watchers)
    });
    scene.end();
}

#[test]
fn nobody_to_stop_is_said_in_time() {
    let world = World::new(PROGRAM);
    let asked = world.run(0, &["request", "stop", "--timeout", "1"]);
    assert_refused(&asked, 3, &["no daemon running"]);
    let error = foretrace_client::stop(&world.instance(0), TIMEOUT).unwrap_err();
    assert!(matches!(error, StopError::NoDaemon { .. }), "{error}");
}

/// The slowest solver at the highest rate, solving for both plan and joints: late on every machine there is.
const TOO_SLOW: [&str; 8] = [
    "--rate",
    "1000",
    "--set",
    "mpc.backend=\"clarabel\"",
    "--set",
    "ik.backend=\"clarabel\"",
    "--set",
    "mpc.horizon=30",
];

/// As many late ticks allowed as there are ticks: the overruns go on. The test does not wait for such a loop
/// to follow again.
#[test]
fn stop_under_persistent_overruns() {
    let lasting = [&TOO_SLOW[..], &["--set", "safety.late_ticks_max=1.0"]].concat();
    let mut times = Vec::new();
    for _ in 0..rounds() {
        let scene = Scene::following_with(World::new(PROGRAM), &lasting);
        let since = monotonic_now_ns();
        let stopped = foretrace_client::stop(&scene.world.instance(0), TIMEOUT);
        assert_eq!(stopped.unwrap_or_else(|error| panic!("{error}")).mode, Mode::Stopped);
        times.push(until("a braking command", || scene.stopped_at(since)));
    }
    say_quantiles("persistent overruns", times);
}

#[test]
fn a_loop_that_cannot_keep_its_rate_is_stopped_and_answers() {
    let mut scene = Scene::idle_with(World::new(PROGRAM), &TOO_SLOW);
    scene.start_arm();
    let since = monotonic_now_ns();
    scene.player = Some(scene.world.start(0, &super::scene::PLAY));
    let mut seen = serde_json::Value::Null;
    until("too many late ticks stop the arm", || {
        seen = scene.world.status(0);
        (seen["mode"] == "stopped").then_some(())
    });
    assert_eq!(seen["fault"], "overruns", "{seen}");
    let ms = (monotonic_now_ns() - since) as f64 * 1e-6;
    say(
        "overruns",
        &format!("latched {ms:.0} ms after the start of the pen; {} overruns", seen["loop"]["overruns"]),
    );
    // Requests are still answered.
    for words in [&["request", "query"][..], &["request", "stop"], &["request", "disarm"]] {
        let asked = scene.world.run(0, words);
        assert!(asked.status.success(), "{}", told(&asked));
    }
    scene.end();
}
