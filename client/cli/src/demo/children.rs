//! The processes of a demo: started from this program's own file, watched, and always ended.
//!
//! Contract: a [`Child`] that goes out of scope is ended (SIGTERM, then SIGKILL after a grace time) and
//! waited for. What it writes on stderr is kept, the last lines only, to be shown if it fails. Its stdout
//! goes nowhere.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foretrace_client::{FaultReason, StopDetail, monotonic_now_ns};

use crate::failure::Failure;
use crate::os;
use crate::stopped::STARVED;

const GRACE: Duration = Duration::from_secs(5);
const TAIL_LINES: usize = 20;
/// What an arm says of a pause of its own comes within this time of the stop \[ns\].
const SAME_NS: u64 = 2_000_000_000;

/// The last lines of a process on stderr, and when they came on the monotonic clock [ns].
#[derive(Debug, Clone, Default)]
pub(crate) struct LastWords(Arc<Mutex<VecDeque<(u64, String)>>>);

impl LastWords {
    fn lines(&self) -> MutexGuard<'_, VecDeque<(u64, String)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn push(&self, at_ns: u64, line: String) {
        let mut lines = self.lines();
        if lines.len() >= TAIL_LINES {
            lines.pop_front();
        }
        lines.push_back((at_ns, line));
    }

    /// What a simulated arm said of its own want of CPU when this stop latched for want of its joint state.
    pub(crate) fn starved(&self, fault: FaultReason, stop: &StopDetail) -> Option<String> {
        if fault != FaultReason::JointStateStale {
            return None;
        }
        let lines = self.lines();
        let mut then = lines.iter().rev().filter(|(came_ns, _)| came_ns.abs_diff(stop.at_ns) <= SAME_NS);
        then.find_map(|(_, line)| Some(line.get(line.find(STARVED)?..)?.to_owned()))
    }
}

/// One process of the demo.
#[derive(Debug)]
pub(crate) struct Child {
    name: &'static str,
    process: std::process::Child,
    status: Option<ExitStatus>,
    tail: LastWords,
    reader: Option<JoinHandle<()>>,
}

impl Child {
    /// Starts `foretrace ARGUMENTS...`; `name` is for messages.
    pub(crate) fn start(name: &'static str, arguments: &[String]) -> Result<Self, Failure> {
        let cannot =
            |error| Failure::failed(format_args!("cannot start the {name}: {error}"), "see the message");
        let program = std::env::current_exe().map_err(cannot)?;
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut process = os::tie_to_parent(&mut command).spawn().map_err(cannot)?;
        let tail = LastWords::default();
        let reader = process.stderr.take().map(|stderr| {
            let tail = tail.clone();
            std::thread::spawn(move || {
                for line in BufReader::new(stderr).split(b'\n').map_while(Result::ok) {
                    tail.push(monotonic_now_ns(), String::from_utf8_lossy(&line).into_owned());
                }
            })
        });
        Ok(Self { name, process, status: None, tail, reader })
    }

    /// What it says on stderr, also later.
    pub(crate) fn words(&self) -> LastWords {
        self.tail.clone()
    }

    /// Fails with the child's last words if it has ended, in whatever way.
    pub(crate) fn expect_alive(&mut self) -> Result<(), Failure> {
        match self.poll() {
            None => Ok(()),
            Some(status) => Err(self.died(status)),
        }
    }

    /// How it ended, if it has.
    pub(crate) fn poll(&mut self) -> Option<ExitStatus> {
        if self.status.is_none() {
            self.status = self.process.try_wait().ok().flatten();
        }
        self.status
    }

    /// Asks it to end and waits; a child that does not end in time or ends badly is a failure.
    pub(crate) fn end(&mut self) -> Result<(), Failure> {
        match self.ended() {
            Some(status) if status.success() => Ok(()),
            Some(status) => Err(self.died(status)),
            None => Err(Failure::failed(
                format_args!("the {} did not end within {} s and was killed", self.name, GRACE.as_secs()),
                "see its messages above",
            )),
        }
    }

    /// Its last lines on stderr.
    pub(crate) fn last_words(&mut self) -> Vec<String> {
        if self.poll().is_some()
            && let Some(reader) = self.reader.take()
        {
            let _ = reader.join();
        }
        self.tail.lines().iter().map(|(_, line)| line.clone()).collect()
    }

    fn died(&mut self, status: ExitStatus) -> Failure {
        let words = self.last_words();
        let quoted: String = words.iter().map(|line| format!("\n  {}: {line}", self.name)).collect();
        Failure::failed(format_args!("the {} ended early ({status}){quoted}", self.name), "")
    }

    fn ended(&mut self) -> Option<ExitStatus> {
        if let Some(status) = self.poll() {
            return Some(status);
        }
        os::terminate(self.process.id());
        let deadline = Instant::now() + GRACE;
        while Instant::now() < deadline {
            if let Some(status) = self.poll() {
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = self.process.kill();
        self.status = self.process.wait().ok();
        None
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        if self.status.is_none() {
            let _ = self.ended();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stopped::starved;

    #[test]
    fn an_arm_that_got_no_cpu_is_told_for_the_stop_at_that_time_only() {
        let words = LastWords::default();
        let at = |at_ns| StopDetail { at_ns, ..StopDetail::NONE };
        assert_eq!(words.starved(FaultReason::JointStateStale, &at(0)), None);
        words.push(10_000_000_000, format!("foretrace: arm: {}", starved(83_000_000)));
        words.push(10_100_000_000, "arm: something else".to_owned());
        let told = words.starved(FaultReason::JointStateStale, &at(9_950_000_000)).unwrap();
        assert!(told.starts_with(STARVED) && told.ends_with(" 83 ms"), "{told}");
        assert_eq!(words.starved(FaultReason::JointStateStale, &at(60_000_000_000)), None);
        assert_eq!(words.starved(FaultReason::TrackingError, &at(9_950_000_000)), None);
        (0..TAIL_LINES).for_each(|_| words.push(11_000_000_000, String::new()));
        assert_eq!(words.starved(FaultReason::JointStateStale, &at(9_950_000_000)), None, "forgotten");
    }
}
