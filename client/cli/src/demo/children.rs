//! The processes of a demo: started from this program's own file, watched, and always ended.
//!
//! Contract: a [`Child`] that goes out of scope is ended (SIGTERM, then SIGKILL after a grace time) and
//! waited for. What it writes on stderr is kept, the last lines only, to be shown if it fails. Its stdout
//! goes nowhere.

use std::io::{BufRead, BufReader};
use std::process::{Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foretrace_client::monotonic_now_ns;
use foretrace_report::run::LastWords;
use rustix::process::{Pid, Signal, kill_process};

use crate::failure::Failure;
use crate::os::tie_to_parent;

const GRACE: Duration = Duration::from_secs(5);
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
        let mut process = tie_to_parent(&mut command).spawn().map_err(cannot)?;
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
        self.poll().map_or(Ok(()), |status| Err(self.died(status)))
    }

    /// How it ended, if it has.
    fn poll(&mut self) -> Option<ExitStatus> {
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
        self.tail.texts()
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
        // A child that has not been waited for: its number is not used again.
        let _ = kill_process(Pid::from_child(&self.process), Signal::TERM);
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
