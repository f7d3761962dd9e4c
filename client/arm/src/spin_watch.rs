//! Ends a process of which a real-time thread computes without a pause.
//!
//! The kernel's own limit, RLIMIT_RTTIME, counts the ticks of its clock that find such a thread running.
//! Where the loop runs on the same CPU at each of them (periods of 2 ms, ticks of 4 ms) it counts none, and
//! the thread keeps its CPU for good. This one looks at what the others have computed since they last slept.

use std::collections::BTreeMap;
use std::fs::{read_dir, read_to_string};
use std::io;
use std::path::Path;
use std::time::Duration;

use foretraced::rt::os::set_fifo;
use rustix::process::{Signal, getpid, kill_process};

/// Looks so often, from the priority above theirs.
const EVERY: Duration = Duration::from_millis(50);
const THREADS: &str = "/proc/self/task";

/// A thread when it was first seen after its last pause.
#[derive(Debug, Clone, Copy)]
struct Seen {
    pauses: u64,
    computed_ns: u64,
}

/// Ends this process with SIGXCPU, as the kernel's limit does, once a thread of it under SCHED_FIFO or
/// SCHED_RR has computed for `longest` since it last slept. Looks from just above `priority`, that of those
/// threads, so that none of them keeps it from looking.
///
/// # Errors
/// No thread could be started.
pub(crate) fn watch(longest: Duration, priority: u32) -> io::Result<()> {
    let look = move || {
        // Where the rights end at `priority`, another CPU is needed.
        let _ = set_fifo(priority + 1).or_else(|_| set_fifo(priority));
        let mut threads = BTreeMap::new();
        loop {
            std::thread::sleep(EVERY);
            if spins(&mut threads, longest) {
                let _ = kill_process(getpid(), Signal::XCPU);
            }
        }
    };
    std::thread::Builder::new().name("spin-watch".to_owned()).spawn(look).map(drop)
}

/// Whether one of the threads computes without a pause; remembers when each was first seen so.
fn spins(threads: &mut BTreeMap<String, Seen>, longest: Duration) -> bool {
    let now: BTreeMap<String, Seen> = read_dir(THREADS)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|thread| {
            let name = thread.file_name().into_string().ok()?;
            let seen = real_time(&thread.path())?;
            let before = threads.get(&name).filter(|before| before.pauses == seen.pauses);
            Some((name, before.copied().unwrap_or(seen)))
        })
        .collect();
    *threads = now;
    threads.iter().any(|(name, since)| {
        let computed = real_time(&Path::new(THREADS).join(name)).map(|seen| seen.computed_ns);
        u128::from(computed.unwrap_or(0).saturating_sub(since.computed_ns)) >= longest.as_nanos()
    })
}

/// How often a thread has paused and how long it has computed; `None`: it is not under a real-time policy, or
/// has ended.
///
/// *Source*: proc(5), `stat` field 41 and `status`; `Documentation/scheduler/sched-stats.rst`, `schedstat`.
fn real_time(thread: &Path) -> Option<Seen> {
    let read = |name| read_to_string(thread.join(name)).ok();
    let (stat, status, schedstat) = (read("stat")?, read("status")?, read("schedstat")?);
    let (_, fields) = stat.rsplit_once(')')?;
    if !matches!(fields.split_whitespace().nth(38)?, "1" | "2") {
        return None;
    }
    let pauses = status.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"))?;
    let computed_ns = schedstat.split_whitespace().next()?;
    Some(Seen { pauses: pauses.trim().parse().ok()?, computed_ns: computed_ns.parse().ok()? })
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt as _;
    use std::process::{Command, ExitStatus};
    use std::time::Instant;

    use super::*;

    const LONGEST: Duration = Duration::from_millis(200);
    /// What a process of the test does.
    const ROLE: &str = "FORETRACE_SPIN_WATCH";
    const NO_RIGHTS: i32 = 77;

    /// Computes for `longest` on its CPU.
    fn compute(longest: Duration) {
        let begin = Instant::now();
        while begin.elapsed() < longest {
            std::hint::spin_loop();
        }
    }

    /// The test of this name again, in a process of its own that is `role`; how that ended, and when.
    fn process(test: &str, role: &str) -> (ExitStatus, Duration) {
        let begin = Instant::now();
        let mut child = Command::new(std::env::current_exe().unwrap());
        child.args(["--exact", &format!("spin_watch::tests::{test}")]).env(ROLE, role);
        (child.output().unwrap().status, begin.elapsed())
    }

    /// A process in which a real-time thread does `work`, with no limit of the kernel.
    fn watched(work: impl FnOnce() + Send + 'static) -> ! {
        let ended = std::thread::spawn(move || {
            if set_fifo(1).is_err() {
                std::process::exit(NO_RIGHTS);
            }
            watch(LONGEST, 1).unwrap();
            work();
        });
        let _ = ended.join();
        std::process::exit(0);
    }

    #[test]
    fn a_thread_that_computes_without_a_pause_ends_its_process() {
        if std::env::var_os(ROLE).is_some() {
            watched(|| compute(Duration::from_secs(5)));
        }
        let (status, took) = process("a_thread_that_computes_without_a_pause_ends_its_process", "spins");
        if status.code() == Some(NO_RIGHTS) {
            eprintln!("skipped: no real-time priority here");
            return;
        }
        assert_eq!(status.signal(), Some(Signal::XCPU.as_raw()), "{status} after {took:?}");
        assert!(took >= LONGEST, "{took:?}");
    }

    #[test]
    fn one_that_pauses_is_left_alone_however_long_it_computes_in_all() {
        let pauses = || {
            for _ in 0..20 {
                compute(LONGEST / 2);
                std::thread::sleep(Duration::from_millis(1));
            }
        };
        if std::env::var_os(ROLE).is_some() {
            watched(pauses);
        }
        let (status, took) =
            process("one_that_pauses_is_left_alone_however_long_it_computes_in_all", "pauses");
        if status.code() == Some(NO_RIGHTS) {
            eprintln!("skipped: no real-time priority here");
            return;
        }
        assert!(status.success(), "{status} after {took:?}");
    }
}
