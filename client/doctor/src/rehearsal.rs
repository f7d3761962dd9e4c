//! The loop's clock and thread without its work: the wake-up latency of this machine.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use foretrace_config::{Config, Settings};
use foretraced::Rights;
use foretraced::law_rehearsal::rehearse_law;
use foretraced::rt::os::{Missing, Right};
use foretraced::rt::rehearsal::{Rehearsal, rehearse};
use serde::Serialize;

use crate::finding::{CheckResult, Need};
use foretrace_failure::Failure;
use foretrace_sim::spread::{Bucket, DurationHistogram, Quantiles};

const THREAD: &str = "rt-thread";
const LATENESS: &str = "wake-up-lateness";
const LAW: &str = "law-cost";

/// Why the rehearsal does not take the rights of the loop.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Restraint {
    /// The user said so.
    Asked,
    /// A daemon runs, which a second real-time thread would disturb: instance and process.
    Daemon(u32, u32),
}

/// From release to start of the tick \[us\]; keys are stable.
#[derive(Debug, Clone, Serialize)]
pub struct Lateness {
    pub(crate) ticks: u64,
    /// Whole periods without a tick.
    pub(crate) missed: u64,
    #[serde(flatten)]
    pub(crate) quantiles: Quantiles,
    /// Counts up to each bound, bounds doubling.
    pub(crate) histogram: Vec<Bucket>,
    /// Page faults of the thread meanwhile.
    pub(crate) page_faults: u64,
}

/// The result of the rehearsal.
#[derive(Debug)]
pub(crate) struct RehearsalResult {
    pub(crate) lateness: Lateness,
    pub(crate) missing: Vec<Missing>,
}

/// Rehearses for `seconds`; Ctrl-C ends it.
pub(crate) fn run(
    settings: &Settings,
    restraint: Option<&Restraint>,
    seconds: f64,
    interrupted: &dyn Fn() -> bool,
) -> Result<RehearsalResult, Failure> {
    let rights = if restraint.is_none() { Rights::Ask } else { Rights::Leave };
    let lock = rights == Rights::Ask && settings.control_loop.lock_memory;
    let quit = Arc::new(AtomicBool::new(false));
    let thread = rehearse(rights.rt_settings(settings), lock, seconds, quit.clone()).map_err(|error| {
        Failure::failed(format_args!("the rehearsal cannot start: {error}"), "free some memory")
    })?;
    while !thread.is_finished() {
        if interrupted() {
            quit.store(true, Ordering::Release);
            let _ = thread.join();
            return Err(Failure::interrupted("interrupted", ""));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let rehearsal =
        thread.join().map_err(|_| Failure::failed("the rehearsal ended by a fault", "report it"))?;
    Ok(shown(rehearsal))
}

fn shown(rehearsal: Rehearsal) -> RehearsalResult {
    let Rehearsal { lateness, missed, page_faults, allocations: _, missing } = rehearsal;
    let ticks = lateness.len();
    let spread = DurationHistogram::from(lateness);
    let lateness = Lateness {
        ticks,
        missed,
        quantiles: spread.quantiles(),
        histogram: spread.doublings(),
        page_faults: page_faults.0 + page_faults.1,
    };
    RehearsalResult { lateness, missing }
}

/// Whether a thread got what the loop will ask for.
pub(crate) fn thread(need: &Need, restraint: Option<&Restraint>, missing: &[Missing]) -> CheckResult {
    let on = need.cpu.map_or_else(|| "any CPU".to_owned(), |cpu| format!("CPU {cpu}"));
    match restraint {
        Some(Restraint::Asked) => {
            return CheckResult::bad(
                THREAD,
                "not tried (--no-rights)",
                "run `foretrace doctor` without --no-rights",
            );
        }
        Some(Restraint::Daemon(number, pid)) => {
            return CheckResult::skipped(
                THREAD,
                format!(
                    "not tried: a daemon runs (instance {number}, process {pid}), and would be disturbed"
                ),
                format!(
                    "stop it (`kill {pid}`) and run again; its own latencies: `foretrace status --instance \
                     {number}`"
                ),
            );
        }
        None => {}
    }
    let relevant: Vec<&Missing> =
        missing.iter().filter(|missing| missing.right != Right::MemoryLock).collect();
    if relevant.is_empty() {
        return CheckResult::ok(
            THREAD,
            format!("SCHED_FIFO {} on {on}, as the settings want", need.priority),
        );
    }
    let names: Vec<&str> = relevant.iter().map(|missing| named(missing.right)).collect();
    let fixes: Vec<&str> = relevant.iter().map(|missing| missing.text.as_str()).collect();
    let value = format!("refused: {}", names.join(", "));
    if relevant.iter().all(|missing| missing.right == Right::TimerSlack) {
        CheckResult::warning(THREAD, value, fixes.join("; "))
    } else {
        CheckResult::bad(THREAD, value, fixes.join("; "))
    }
}

const fn named(right: Right) -> &'static str {
    match right {
        Right::Fifo => "SCHED_FIFO",
        Right::Affinity => "the CPU",
        Right::MemoryLock => "locked memory",
        Right::TimerSlack => "punctual timers",
        Right::SharedMemory => "shared memory",
    }
}

/// What a tick of these settings costs against the period, as the daemon measures it when it starts.
pub(crate) fn law(config: &Config) -> Result<CheckResult, Failure> {
    let cost = rehearse_law(config).map_err(|error| Failure::failed(error, ""))?;
    let us = |ns: u64| ns as f64 / 1000.0;
    let value = format!(
        "p50 {:.0}, p99 {:.0} us of {:.0} ({} ticks, processor time)",
        us(cost.p50_ns),
        us(cost.p99_ns),
        us(cost.period_ns),
        cost.ticks
    );
    Ok(match cost.complaint(config) {
        None => CheckResult::ok(LAW, value),
        Some(complaint) => CheckResult::bad(LAW, value, complaint),
    })
}

/// Lateness against the period. A late start shortens the time for the tick's work; a missed period is a
/// missing command.
pub(crate) fn lateness(need: &Need, seen: &Lateness, beside_a_daemon: bool) -> CheckResult {
    let Quantiles { p50, p99, p99_9, max } = seen.quantiles;
    let period = need.period_us as f64;
    let value = format!(
        "p50 {p50:.1}, p99 {p99:.1}, p99.9 {p99_9:.1}, max {max:.0} µs of {period:.0}; {} of {} periods \
         missed",
        seen.missed,
        seen.ticks + seen.missed
    );
    let fix = format!(
        "first the remedies above; then find what holds the CPU: `sudo cyclictest -m -p{} -i{} -l10000` \
         beside \
         your other \
         programs, `sudo trace-cmd record -e sched_switch -e irq`; or a slower loop: --set loop.rate_hz={}",
        need.priority,
        need.period_us,
        (need.rate_hz / 2).max(125)
    );
    if seen.ticks == 0 {
        return CheckResult::bad(LATENESS, "no tick came at all", fix);
    }
    if seen.missed > 0 || p99_9 > period / 4.0 {
        // Without the priority that the daemon beside it has, this says little of the loop.
        if beside_a_daemon {
            let value = format!("{value}, without real-time priority beside the daemon");
            return CheckResult::skipped(LATENESS, value, "stop the daemon and run again");
        }
        CheckResult::bad(LATENESS, value, fix)
    } else if max > period / 4.0 || p99 > period / 10.0 {
        CheckResult::warning(LATENESS, value, fix)
    } else {
        CheckResult::ok(LATENESS, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Level;

    fn seen(missed: u64, p99: f64, p99_9: f64, max: f64) -> Lateness {
        let quantiles = Quantiles { p50: 5.0, p99, p99_9, max };
        Lateness { ticks: 1000, missed, quantiles, histogram: Vec::new(), page_faults: 0 }
    }

    #[test]
    fn lateness_is_judged_by_the_period() {
        let judged = |seen: &Lateness| lateness(&Need::USUAL, seen, false).level;
        assert_eq!(judged(&seen(0, 20.0, 80.0, 400.0)), Level::Ok);
        assert_eq!(judged(&seen(0, 20.0, 80.0, 600.0)), Level::Warning);
        assert_eq!(judged(&seen(0, 210.0, 300.0, 400.0)), Level::Warning);
        assert_eq!(judged(&seen(0, 20.0, 501.0, 600.0)), Level::Bad);
        assert_eq!(judged(&seen(1, 20.0, 80.0, 400.0)), Level::Bad);
        assert_eq!(judged(&Lateness { ticks: 0, ..seen(0, 0.0, 0.0, 0.0) }), Level::Bad);
        // What is late for 1000 Hz is not for 125 Hz.
        let slow = Need { rate_hz: 125, period_us: 8000, ..Need::USUAL };
        assert!(lateness(&slow, &seen(0, 210.0, 501.0, 600.0), false).ok);
        assert_eq!(lateness(&Need::USUAL, &seen(1, 20.0, 80.0, 400.0), true).level, Level::Skipped);
        let found = lateness(&Need::USUAL, &seen(3, 20.0, 80.0, 400.0), false);
        assert!(
            found.value.contains("3 of 1003 periods missed") && found.fix.contains("loop.rate_hz=250"),
            "{found:?}"
        );
    }

    #[test]
    fn rights_that_were_refused_or_not_tried_make_the_machine_unfit() {
        let missing = |right| vec![Missing { right, text: "do this".to_owned() }];
        let judged = |missing: &[Missing]| thread(&Need::USUAL, None, missing);
        assert!(judged(&[]).ok && judged(&missing(Right::MemoryLock)).ok);
        let found = judged(&missing(Right::Fifo));
        assert!(
            found.level == Level::Bad && found.value.contains("SCHED_FIFO") && found.fix.contains("do this"),
            "{found:?}"
        );
        assert_eq!(judged(&missing(Right::TimerSlack)).level, Level::Warning);
        let tried = |restraint| thread(&Need::USUAL, Some(&restraint), &[]);
        assert_eq!(tried(Restraint::Asked).level, Level::Bad);
        let beside = tried(Restraint::Daemon(3, 77));
        assert!(beside.level == Level::Skipped && !beside.fix.is_empty(), "{beside:?}");
    }
}
