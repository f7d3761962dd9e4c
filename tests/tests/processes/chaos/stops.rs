//! The arm can be stopped whatever else is broken: `foretrace_client::stop`, from its call to the first
//! braking command as the recorder sees it, under each fault. FORETRACE_STOP_ROUNDS (default 3) is how often
//! each. Only hangs are asserted, never speed.

use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::time::{Duration, Instant};

use foretrace_client::{Mode, StopError, monotonic_now_ns};
use foretrace_shm::LOOP;
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
        assert_eq!(stopped.mode, Some(Mode::Stopped), "{what}");
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
    by_signal(&scene, "the stop thread hangs");
    drop(held);
    scene.rearm();
    let since = monotonic_now_ns();
    scene.follows_again(since);
    scene.end();
}

/// Stops with nobody at the socket: what the program says must be true.
fn by_signal(scene: &Scene, what: &str) {
    let since = monotonic_now_ns();
    let asked = scene.world.run(0, &["request", "stop", "--timeout", "10"]);
    assert!(asked.status.success(), "{}", told(&asked));
    assert!(told(&asked).contains("taken as a signal"), "{}", told(&asked));
    // The program has ended: what it said has happened already.
    let ms = scene.stopped_at(since);
    let ms = ms.unwrap_or_else(|| until("the recorder shows it", || scene.stopped_at(since)));
    say("stop", &format!("{what}: by signal, first braking command after {ms:.1} ms, program included"));
}

#[test]
fn stop_while_every_thread_but_the_loop_is_held() {
    let mut scene = Scene::following();
    let pid = scene.daemon.as_ref().expect("a daemon").pid();
    for _ in 0..rounds() {
        let Some(held) = Frozen::all_but(pid, LOOP) else {
            say("stop", "skipped: this system does not let a process trace its child");
            return drop(scene.end());
        };
        assert!(held.len() > 4, "{held:?}");
        by_signal(&scene, "every thread but the loop is held");
        drop(held);
        scene.rearm();
        let since = monotonic_now_ns();
        scene.follows_again(since);
    }
    scene.end();
}

#[test]
fn a_stop_that_no_tick_takes_is_not_said_to_be_taken() {
    let mut scene = Scene::following();
    let held: Option<Vec<Frozen>> =
        ["foretrace-stop", LOOP].map(|name| hold(&scene, name)).into_iter().collect();
    let Some(held) = held else { return drop(scene.end()) };
    let asked = scene.world.run(0, &["request", "stop", "--timeout", "1"]);
    assert_refused(&asked, 1, &["was sent SIGUSR1", "no such tick was seen", "stop button"]);
    drop(held);
    // It takes it as soon as it runs again.
    until("a stop is latched", || {
        let mode = scene.world.status(0)["mode"].clone();
        (mode == "stopped" || mode == "fault").then_some(())
    });
    scene.rearm();
    let since = monotonic_now_ns();
    scene.follows_again(since);
    scene.end();
}

#[test]
fn a_storm_of_signals_neither_shortens_nor_loses_a_period() {
    let scene = Scene::armed_in(World::new(PROGRAM));
    let pid = scene.daemon.as_ref().expect("a daemon").pid();
    // Only the loop takes SIGUSR1; the others mean nothing to the daemon.
    let kill = format!("kill -USR1 {pid}; kill -WINCH {pid}; kill -URG {pid}");
    let storm = format!("n=0; while [ $n -lt 20000 ]; do {kill}; n=$((n+1)); done");
    let mut storm = Command::new("sh").args(["-c", &storm]).spawn().expect("sh");
    let output = scene.world.run(0, &["observe", "2"]);
    assert!(storm.wait().expect("sh ends").success());
    let seen: serde_json::Value = serde_json::from_slice(&output.stdout).expect("the observer reports");
    let of = |tick: &serde_json::Value| {
        ["tick", "release_ns", "skipped"].map(|key| tick[key].as_u64().expect("a number"))
    };
    let ticks: Vec<[u64; 3]> = seen["ticks"].as_array().expect("ticks").iter().map(of).collect();
    let rate = scene.world.status(0)["loop"]["rate_hz"].as_f64().expect("a rate");
    let period_ns = (1e9 / rate) as u64;
    let (mut pairs, mut skipped) = (0, 0);
    for pair in ticks.windows(2) {
        let [[tick, release_ns, _], [next, next_ns, lost]] = [pair[0], pair[1]];
        // The observer may have missed some.
        if next == tick + 1 {
            // What the clock says, and what the loop counts.
            assert_eq!(next_ns - release_ns, (lost + 1) * period_ns, "tick {next}: {pair:?}");
            (pairs, skipped) = (pairs + 1, skipped + lost);
        }
    }
    say("storm", &format!("60000 signals: {pairs} ticks, {skipped} periods skipped, all of them counted"));
    assert!(pairs > 200 && skipped < pairs, "{pairs} ticks, {skipped} skipped");
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
        words.push("4 operator slots");
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
        assert!(filled.contains("process slots"), "{filled}");
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
/// That a busy machine takes the processor away for long is another reason to stop, and not meant here.
const TOO_SLOW: [&str; 10] = [
    "--rate",
    "1000",
    "--set",
    "mpc.backend=\"clarabel\"",
    "--set",
    "ik.backend=\"clarabel\"",
    "--set",
    "mpc.horizon=30",
    "--set",
    "safety.latch_after_ms=5000",
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
        assert_eq!(stopped.unwrap_or_else(|error| panic!("{error}")).mode, Some(Mode::Stopped));
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
