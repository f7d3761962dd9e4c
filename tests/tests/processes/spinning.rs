//! A simulated arm with real-time priority that computes without a pause.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use foretrace_tests::{Process, World, skipped, until};
use foretraced::rt::os::pin_to;

use crate::PROGRAM;

/// How much later a stop may come beside it, in the median.
const LATER: Duration = Duration::from_millis(50);
const TIMEOUT: Duration = Duration::from_secs(2);
/// On more of them nothing else is seen.
const CORES: usize = 4;
const BETWEEN: Duration = Duration::from_millis(5);
/// It is ended after so long.
const SPINS: Duration = Duration::from_millis(200);

/// Whether the main thread of a process is under SCHED_FIFO: field 41 of /proc/PID/stat (proc(5)).
fn is_fifo(process: &Process) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.pid())).unwrap_or_default();
    let after_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    after_name.split_whitespace().nth(38) == Some("1")
}

/// Stops, each when it was asked for and how long that took, from a thread that stays on one core, until
/// `over`. Linux may leave what it does not pin beside the arm until that is ended, whatever it does:
/// `/bin/true` takes 100 ms and more there.
fn stops_from(core: usize, world: &World, over: &AtomicBool) -> Vec<(Instant, Duration)> {
    let mut stops = vec![];
    // There may be fewer.
    while pin_to(core).is_ok() && !over.load(Ordering::Relaxed) {
        std::thread::sleep(BETWEEN);
        let begin = Instant::now();
        let stopped = foretrace_client::stop(&world.instance(0), TIMEOUT);
        assert!(stopped.is_ok(), "{stopped:?}");
        stops.push((begin, begin.elapsed()));
    }
    stops
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
    let over = AtomicBool::new(false);
    let (world, over) = (&world, &over);
    let (ended, at, stops) = std::thread::scope(|scope| {
        let operators: Vec<_> =
            (0..CORES).map(|core| scope.spawn(move || stops_from(core, world, over))).collect();
        let ended = until("it is ended", || arm.ended());
        let at = Instant::now();
        over.store(true, Ordering::Relaxed);
        let stops = operators.into_iter().map(|operator| operator.join().unwrap());
        (ended, at, stops.collect::<Vec<_>>())
    });
    // SIGXCPU.
    assert_eq!(std::os::unix::process::ExitStatusExt::signal(&ended.0), Some(24), "{ended:?}");
    assert!(ended.1.contains("computes without a pause"), "{}", ended.1);
    // The arm is on one core at a time: an operator on another does not wait for it.
    let medians = stops.into_iter().filter_map(|stops| {
        let (beside, before): (Vec<_>, Vec<_>) =
            stops.into_iter().partition(|(begin, took)| *begin + *took > at - SPINS);
        let [beside, before] =
            [beside, before].map(|stops| stops.into_iter().map(|(_, took)| took).collect::<Vec<_>>());
        println!("beside an arm that spins {beside:?}");
        (!beside.is_empty() && before.len() > 5).then(|| (median(beside), median(before)))
    });
    let (beside, before) = medians.min().expect("stops before and beside it");
    assert!(beside <= before + LATER, "{beside:?} beside an arm that spins, {before:?} before");
    drop(daemon);
}
