//! A simulated arm with real-time priority that computes without a pause.

use std::time::{Duration, Instant};

use foretrace_tests::{Process, World, skipped, until};

use crate::PROGRAM;

/// How much later than in the median without it the fastest stop beside it may come.
const LATER: Duration = Duration::from_millis(50);
const TIMEOUT: Duration = Duration::from_secs(2);
const BETWEEN: Duration = Duration::from_millis(5);
/// The kernel ends it after so long.
const SPINS: Duration = Duration::from_millis(200);

/// Whether the main thread of a process is under SCHED_FIFO: field 41 of /proc/PID/stat (proc(5)).
fn is_fifo(process: &Process) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.pid())).unwrap_or_default();
    let after_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    after_name.split_whitespace().nth(38) == Some("1")
}

/// Asks for a stop from a program that runs already: Linux may let a new one wait beside the arm until that
/// is ended, whatever it does (`/bin/true` takes 100 ms and more). When it began, and how long that took.
fn stop(world: &World) -> (Instant, Duration) {
    let begin = Instant::now();
    let stopped = foretrace_client::stop(&world.instance(0), TIMEOUT);
    assert!(stopped.is_ok(), "{stopped:?}");
    (begin, begin.elapsed())
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort();
    times[times.len() / 2]
}

#[test]
fn an_arm_that_spins_keeps_no_stop_away_and_is_ended() {
    let world = World::with_rights_kept(PROGRAM);
    let daemon = world.start(0, &["daemon"]);
    until("the daemon comes up", || world.run(0, &["status"]).status.success().then_some(()));
    let mut arm = world.start(0, &["arm", "sim", "--spin-after", "3"]);
    world.arm(0, &mut arm);
    if !is_fifo(&arm) {
        skipped("no real-time priority for the simulated arm");
        return;
    }
    let mut stops = vec![];
    let ended = until("the kernel ends it", || {
        std::thread::sleep(BETWEEN);
        stops.push(stop(&world));
        arm.ended()
    });
    let at = Instant::now();
    // SIGXCPU.
    assert_eq!(std::os::unix::process::ExitStatusExt::signal(&ended.0), Some(24), "{ended:?}");
    assert!(ended.1.contains("computes without a pause"), "{}", ended.1);
    let (beside, before): (Vec<_>, Vec<_>) =
        stops.into_iter().partition(|(begin, took)| *begin + *took > at - SPINS);
    let [beside, before] =
        [beside, before].map(|stops| stops.into_iter().map(|(_, took)| took).collect::<Vec<_>>());
    assert!(!beside.is_empty() && before.len() > 5, "{beside:?} {before:?}");
    println!("{beside:?} beside");
    let (beside, before) = (beside.into_iter().min().unwrap(), median(before));
    assert!(beside <= before + LATER, "{beside:?} beside an arm that spins, {before:?} before");
    drop(daemon);
}
