//! Real-time priority for commands that keep the cycle of a controller, and whether they get the CPU for it.

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::time::Duration;

use foretrace_config::Settings;
use foretraced::rt::os::set_fifo;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use foretrace_report::Tell;

use crate::spin_watch;

/// So far below the loop, whose commands they take.
const BELOW_THE_LOOP: u32 = 10;
/// Longest that a thread with priority may compute without a pause: then its process is ended (SIGXCPU),
/// because on its CPU nothing but the loop runs until then. Its cycles take less than 10 ms.
const SPINS: Duration = Duration::from_millis(200);

/// SCHED_FIFO priority of an arm's process.
pub fn below_the_loop(settings: &Settings) -> u32 {
    settings.control_loop.priority.saturating_sub(BELOW_THE_LOOP).max(1)
}

/// Puts this thread under SCHED_FIFO at `priority`, and every thread that it starts from now on, unless it is
/// to have `no_rights`; one that spins ends the process. Returns what is missing, in words, having told what
/// the system refused; nothing stops without.
pub fn ask(who: &str, priority: u32, no_rights: bool, tell: Tell<'_>) -> Option<String> {
    if no_rights {
        return Some("--no-rights".to_owned());
    }
    let missing = limit_spin(SPINS)
        .map_err(|error| format!("no priority: RLIMIT_RTTIME cannot be set ({error})"))
        .and_then(|()| set_fifo(priority).map_err(|missing| missing.text))
        .and_then(|()| {
            spin_watch::watch(SPINS, priority)
                .map_err(|error| format!("no thread that looks whether it spins ({error})"))
        })
        .err()?;
    tell(&format!("{who}: {missing}"));
    Some(missing)
}

/// Lets the kernel end this process (SIGXCPU) once a real-time thread of it has computed for `longest`
/// without a pause (RLIMIT_RTTIME; a lower limit stays).
fn limit_spin(longest: Duration) -> std::io::Result<()> {
    let limit = getrlimit(Resource::Rttime);
    let micros = u64::try_from(longest.as_micros()).unwrap_or(u64::MAX);
    let current = Some(limit.current.map_or(micros, |lower| lower.min(micros)));
    Ok(setrlimit(Resource::Rttime, Rlimit { current, ..limit })?)
}

/// How long this thread could have run while others had the CPU; `None` from where the kernel does not tell.
/// Source: second number of /proc/PID/task/TID/schedstat (`Documentation/scheduler/sched-stats.rst`).
#[derive(Debug)]
pub struct CpuWait {
    file: Option<File>,
    waited_ns: u64,
}

impl CpuWait {
    /// Of the thread that calls, from now on.
    pub fn of_this_thread() -> Self {
        let mut wait = Self { file: File::open("/proc/thread-self/schedstat").ok(), waited_ns: 0 };
        wait.lately_ns();
        wait
    }

    /// Since the last call \[ns\].
    pub fn lately_ns(&mut self) -> Option<u64> {
        let mut bytes = [0; 96];
        let count = self.file.as_ref()?.read_at(&mut bytes, 0).ok()?;
        let text = std::str::from_utf8(bytes.get(..count)?).ok()?;
        let waited_ns = text.split_whitespace().nth(1)?.parse().ok()?;
        let lately_ns = u64::saturating_sub(waited_ns, self.waited_ns);
        self.waited_ns = waited_ns;
        Some(lately_ns)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use foretraced::rt::os::pin_to;

    use super::*;

    /// The scheduling policy of the thread that calls: 0 ordinary, 1 SCHED_FIFO.
    fn policy() -> u32 {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
        // The name, in parentheses, may have spaces; the policy is the 41st field.
        let (_, fields) = stat.rsplit_once(')').unwrap();
        fields.split_whitespace().nth(38).unwrap().parse().unwrap()
    }

    fn asked(priority: u32, no_rights: bool) -> (Option<String>, u32) {
        std::thread::spawn(move || (ask("test", priority, no_rights, &|_| {}), policy())).join().unwrap()
    }

    #[test]
    fn a_thread_has_the_priority_or_a_reason_with_a_remedy_and_runs_on() {
        assert_eq!(asked(1, true), (Some("--no-rights".to_owned()), 0));
        let (missing, policy) = asked(1000, false);
        let text = missing.unwrap();
        assert!(text.contains("SCHED_FIFO 1000 refused") && text.contains("from 1 to 99"), "{text}");
        assert_eq!(policy, 0);
        match asked(1, false) {
            (None, policy) => assert_eq!(policy, 1),
            (Some(text), policy) => {
                assert!(text.contains("SCHED_FIFO 1 refused") && text.contains("limits.conf"), "{text}");
                assert_eq!(policy, 0);
            }
        }
    }

    #[test]
    fn the_priority_is_ten_below_the_loop_s_and_at_least_one() {
        let mut settings = foretrace_config::Config::preset("ur5").unwrap().settings().clone();
        for (of_the_loop, below) in [(80, 70), (12, 2), (11, 1), (10, 1), (1, 1)] {
            settings.control_loop.priority = of_the_loop;
            assert_eq!(below_the_loop(&settings), below);
        }
    }

    /// One CPU for two threads that compute: each waits about half of the time; one that sleeps does not.
    #[test]
    fn a_thread_that_shares_its_cpu_has_waited_and_one_that_sleeps_has_not() {
        let computes = |for_ms: u64| {
            // The first that this process may use: the same for both.
            assert!((0..1024).any(|cpu| pin_to(cpu).is_ok()));
            let mut wait = CpuWait::of_this_thread();
            let begin = Instant::now();
            while begin.elapsed() < Duration::from_millis(for_ms) {
                std::hint::spin_loop();
            }
            wait.lately_ns()
        };
        let other = std::thread::spawn(move || computes(400));
        let waited = std::thread::spawn(move || computes(300)).join().unwrap();
        other.join().unwrap();
        let mut idle = CpuWait::of_this_thread();
        std::thread::sleep(Duration::from_millis(300));
        let Some((waited, idle)) = waited.zip(idle.lately_ns()) else {
            eprintln!("skipped: this kernel does not tell how long a thread waited");
            return;
        };
        assert!(waited > 50_000_000, "{waited} ns beside another");
        assert!(idle < waited, "{idle} ns asleep, {waited} beside another");
    }
}
