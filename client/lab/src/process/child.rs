//! The other program: its start, lines there and back, its end.

use std::io::{ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use foretrace_host::children::GroupChild;
use rustix::net::{RecvFlags, recv};

use super::LONGEST_LINE;
use super::error::ProcessFault;

/// Once its input has ended a program may take so long to end by itself.
const GRACE: Duration = Duration::from_secs(1);
/// Between looks at a program that is about to end.
const LOOK: Duration = Duration::from_millis(1);

/// A program that answers lines with lines.
#[derive(Debug)]
pub(super) struct LineChild {
    child: GroupChild,
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
        let mut shell = Command::new("/bin/sh");
        shell.args(["-c", command]);
        shell.stdin(Stdio::from(OwnedFd::from(input))).stdout(Stdio::from(OwnedFd::from(theirs)));
        let child = GroupChild::start(&mut shell).map_err(refused)?;
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
        if self.child.has_ended(GRACE, LOOK) {
            self.child.end().map_or_else(|| "ended".to_owned(), |status| format!("ended ({status})"))
        } else {
            "closed its output".to_owned()
        }
    }
}

impl Drop for LineChild {
    fn drop(&mut self) {
        if !self.failed {
            // Its input ends: a program may write down what it wants to keep.
            let _ = self.stream.shutdown(std::net::Shutdown::Write);
            let _ = self.child.has_ended(GRACE, LOOK);
        }
    }
}
