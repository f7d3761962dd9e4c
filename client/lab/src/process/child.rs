//! The other program: its start, lines there and back, its end.

use std::collections::BTreeSet;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rustix::net::{RecvFlags, recv};
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};

use super::LONGEST_LINE;
use super::error::ProcessFault;

/// Once its input has ended a program may take so long to end by itself.
const GRACE: Duration = Duration::from_secs(1);
/// Between looks at a program that is about to end.
const LOOK: Duration = Duration::from_millis(1);

/// Groups of processes that run.
static RUNNING: Mutex<BTreeSet<u32>> = Mutex::new(BTreeSet::new());

/// Kills all programs at once: for a signal that ends this one without unwinding.
pub fn end_all() {
    running(|groups| groups.iter().for_each(|group| kill(*group)));
}

fn running<R>(change: impl FnOnce(&mut BTreeSet<u32>) -> R) -> R {
    change(&mut RUNNING.lock().unwrap_or_else(PoisonError::into_inner))
}

fn kill(group: u32) {
    // One that is gone already is what is wanted.
    if let Some(group) = i32::try_from(group).ok().and_then(Pid::from_raw) {
        let _ = kill_process_group(group, Signal::KILL);
    }
}

/// A program that answers lines with lines.
#[derive(Debug)]
pub(super) struct LineChild {
    child: Child,
    stream: UnixStream,
    patience: Duration,
    line: Vec<u8>,
    failed: bool,
}

impl LineChild {
    /// A socket serves as its input and output, because reading and writing one can be bounded in time.
    pub(super) fn start(command: &str, patience: Duration) -> Result<Self, ProcessFault> {
        let refused = |error: std::io::Error| ProcessFault::Start(error.to_string());
        let (stream, theirs) = UnixStream::pair().map_err(refused)?;
        let patience = patience.max(Duration::from_millis(1));
        stream.set_read_timeout(Some(patience)).map_err(refused)?;
        stream.set_write_timeout(Some(patience)).map_err(refused)?;
        let input = theirs.try_clone().map_err(refused)?;
        let child = Command::new("/bin/sh")
            .args(["-c", command])
            .stdin(Stdio::from(OwnedFd::from(input)))
            .stdout(Stdio::from(OwnedFd::from(theirs)))
            // What a shell starts ends with it.
            .process_group(0)
            .spawn()
            .map_err(refused)?;
        running(|groups| groups.insert(child.id()));
        Ok(Self { child, stream, patience, line: Vec::new(), failed: false })
    }

    /// What it answers to `line`, which has its end of line.
    pub(super) fn ask(&mut self, line: &[u8]) -> Result<&[u8], ProcessFault> {
        let answered = self.exchange(line);
        self.failed = answered.is_err();
        answered.map(|()| self.line.as_slice())
    }

    fn exchange(&mut self, line: &[u8]) -> Result<(), ProcessFault> {
        if matches!(recv(&self.stream, &mut [0; 1], RecvFlags::PEEK | RecvFlags::DONTWAIT), Ok((_, 1..))) {
            return Err(ProcessFault::Unasked);
        }
        let began = Instant::now();
        self.stream.write_all(line).map_err(|error| self.fault(&error))?;
        self.line.clear();
        let mut bytes = [0; 4096];
        loop {
            let count = match self.stream.read(&mut bytes) {
                Ok(0) => return Err(ProcessFault::Ended(self.ending())),
                Ok(count) => count,
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) => return Err(self.fault(&error)),
            };
            let (got, _) = bytes.split_at(count.min(bytes.len()));
            let end = got.iter().position(|byte| *byte == b'\n');
            let (rest, more) = got.split_at(end.map_or(got.len(), |end| end + 1));
            self.line.extend_from_slice(rest);
            if self.line.len() > LONGEST_LINE {
                return Err(ProcessFault::TooLong);
            }
            if !more.is_empty() {
                return Err(ProcessFault::Unasked);
            }
            if end.is_some() {
                return Ok(());
            }
            // Who drips is silent, too.
            if began.elapsed() > self.patience {
                return Err(self.silent());
            }
        }
    }

    fn silent(&self) -> ProcessFault {
        ProcessFault::Silent { seconds: self.patience.as_secs_f64() }
    }

    fn fault(&mut self, error: &std::io::Error) -> ProcessFault {
        match error.kind() {
            ErrorKind::WouldBlock | ErrorKind::TimedOut => self.silent(),
            ErrorKind::BrokenPipe | ErrorKind::ConnectionReset => ProcessFault::Ended(self.ending()),
            _ => ProcessFault::Io(error.to_string()),
        }
    }

    /// How it went away, as far as can be seen soon.
    fn ending(&mut self) -> String {
        if self.has_ended(GRACE) {
            self.reap().map_or_else(|| "ended".to_owned(), |status| format!("ended ({status})"))
        } else {
            "closed its output".to_owned()
        }
    }

    /// Whether it has ended within `patience`; it is not reaped, so that its number stays its own.
    fn has_ended(&self, patience: Duration) -> bool {
        let Some(pid) = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw) else { return true };
        let began = Instant::now();
        let look = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT | WaitIdOptions::NOHANG;
        while matches!(waitid(WaitId::Pid(pid), look), Ok(None)) {
            if began.elapsed() >= patience {
                return false;
            }
            std::thread::sleep(LOOK);
        }
        true
    }

    /// Ends what is left of its group, and takes its status; none the second time.
    fn reap(&mut self) -> Option<ExitStatus> {
        let group = self.child.id();
        if running(|groups| groups.remove(&group)) {
            // Its number is still its own: nobody has waited for it.
            kill(group);
            return self.child.wait().ok();
        }
        None
    }
}

impl Drop for LineChild {
    fn drop(&mut self) {
        if !self.failed {
            // Its input ends: a program may write down what it wants to keep.
            let _ = self.stream.shutdown(std::net::Shutdown::Write);
            self.has_ended(GRACE);
        }
        self.reap();
    }
}
