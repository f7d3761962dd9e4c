//! An arm behind a Unix socket, in lock-step with the law: one command there, one joint state back, in
//! virtual time.
//!
//! Contract: the peer listens; each run is a connection of its own. Nothing is trusted: a message of another
//! size, kind or version, a number that is not finite or out of range, a stamp that goes back or ahead, a
//! peer that is silent for longer than the time-out or goes away ends the run with an error. Absent: retries,
//! a clock (only the time-out looks at one).

mod wire;

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foretrace_control::contact;
use foretrace_control::follower::JointCommand;
use foretrace_control::units::Stamp;
use foretrace_sim::arm::JOINTS;

pub use wire::{
    ARM_HELLO, ArmAnswer, ArmEffortUnit, ArmHello, COMMAND, Command, HEADER, Kind, LAW_HELLO, LawHello,
    MAGIC, STATE, VERSION, WireError, check_header,
};

use crate::experiments::{ArmError, ArmFacts, DeskArm, Measured, epoch};

/// The instant at which every run of this period \[ns\] begins.
#[must_use]
pub fn begin(period_ns: u64) -> Stamp {
    epoch(period_ns)
}

/// A lock-step socket that cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LockstepError {
    /// Nobody listens.
    #[error("{path}: {error}; start the simulator that listens there first (--arm-socket)")]
    Connect { path: PathBuf, error: io::Error },
    /// Silence.
    #[error(
        "{path}: the arm says nothing for {seconds} s {when}; give it more time (--arm-timeout), or end it"
    )]
    Silent {
        path: PathBuf,
        /// The time-out \[s\].
        seconds: f64,
        when: String,
    },
    /// The peer went away.
    #[error("{path}: the arm closed the connection {when}; its own output says why")]
    Closed { path: PathBuf, when: String },
    /// The connection failed.
    #[error("{path}: {error} {when}")]
    Io { path: PathBuf, error: io::Error, when: String },
    /// A wrong message.
    #[error("{path}: {error} ({when})")]
    Wire { path: PathBuf, error: WireError, when: String },
}

/// The arm behind a socket.
#[derive(Debug)]
pub struct SocketArm {
    path: PathBuf,
    stream: UnixStream,
    timeout: Duration,
    hello: ArmHello,
    tick: u64,
    /// Commanded last \[rad\].
    q: [f64; JOINTS],
    /// Stamp of the newest state.
    measured: Stamp,
}

impl SocketArm {
    /// Connects to the peer that listens at `path`, says `hello` and hears its.
    ///
    /// # Errors
    /// Nobody there, silence for longer than `timeout`, anything but the arm's hello.
    pub fn connect(path: &Path, timeout: Duration, hello: &LawHello) -> Result<Self, LockstepError> {
        let wrong = |error| LockstepError::Connect { path: path.to_owned(), error };
        let stream = UnixStream::connect(path).map_err(wrong)?;
        let limit = Some(timeout.max(Duration::from_millis(1)));
        stream.set_read_timeout(limit).and_then(|()| stream.set_write_timeout(limit)).map_err(wrong)?;
        let nothing =
            ArmHello { rate_hz: 1.0, group_delay_s: None, effort: ArmEffortUnit::None, q: hello.home };
        let mut arm = Self {
            path: path.to_owned(),
            stream,
            timeout,
            hello: nothing,
            tick: 0,
            q: hello.home,
            measured: hello.begin,
        };
        arm.send(&hello.encode())?;
        let answer = arm.receive::<ARM_HELLO>(Kind::ArmHello)?;
        arm.hello = ArmHello::decode(&answer).map_err(|error| arm.wire(error))?;
        arm.q = arm.hello.q;
        Ok(arm)
    }

    /// What the arm reported of itself.
    #[must_use]
    pub const fn hello(&self) -> &ArmHello {
        &self.hello
    }

    fn when(&self) -> String {
        match self.tick {
            0 => "in its hello, or answering the first command".to_owned(),
            tick => format!("at tick {tick}"),
        }
    }

    fn wire(&self, error: WireError) -> LockstepError {
        LockstepError::Wire { path: self.path.clone(), error, when: self.when() }
    }

    fn failed(&self, error: io::Error) -> LockstepError {
        let (path, when) = (self.path.clone(), self.when());
        match error.kind() {
            io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => {
                LockstepError::Silent { path, seconds: self.timeout.as_secs_f64(), when }
            }
            io::ErrorKind::UnexpectedEof | io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionReset => {
                LockstepError::Closed { path, when }
            }
            _ => LockstepError::Io { path, error, when },
        }
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), LockstepError> {
        self.stream.write_all(bytes).map_err(|error| self.failed(error))
    }

    /// A whole message; its header is checked before the rest is awaited, so that a wrong length is
    /// reported as such.
    fn receive<const SIZE: usize>(&mut self, kind: Kind) -> Result<[u8; SIZE], LockstepError> {
        let mut bytes = [0; SIZE];
        let began = Instant::now();
        let (head, rest) = bytes.split_at_mut(HEADER);
        self.fill(head, began)?;
        let mut header = [0; HEADER];
        header.copy_from_slice(head);
        check_header(&header, kind).map_err(|error| self.wire(error))?;
        self.fill(rest, began)?;
        Ok(bytes)
    }

    /// Reads all of `bytes` of a message awaited since `began`; a peer that drips is silent, too.
    fn fill(&mut self, mut bytes: &mut [u8], began: Instant) -> Result<(), LockstepError> {
        while !bytes.is_empty() {
            match self.stream.read(bytes) {
                Ok(0) => return Err(self.failed(io::ErrorKind::UnexpectedEof.into())),
                Ok(count) => bytes = bytes.split_at_mut(count.min(bytes.len())).1,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.failed(error)),
            }
            if !bytes.is_empty() && began.elapsed() > self.timeout {
                return Err(self.failed(io::ErrorKind::TimedOut.into()));
            }
        }
        Ok(())
    }

    fn exchange(
        &mut self,
        until: Stamp,
        command: Option<&JointCommand<JOINTS>>,
    ) -> Result<ArmAnswer, LockstepError> {
        let (q, qd) = command.map_or((self.q, [0.0; JOINTS]), |command| (command.q, command.qd));
        let enabled = command.is_some_and(|command| command.enabled);
        let command = Command { until, tick: self.tick, enabled, q, qd };
        self.send(&command.encode())?;
        let bytes = self.receive::<STATE>(Kind::State)?;
        let state = ArmAnswer::decode(&bytes, &command, self.measured, self.hello.effort);
        let state = state.map_err(|error| self.wire(error))?;
        (self.q, self.measured, self.tick) = (q, state.stamp, self.tick + 1);
        Ok(state)
    }
}

impl DeskArm for SocketArm {
    fn facts(&self) -> ArmFacts {
        let effort = match self.hello.effort {
            ArmEffortUnit::None => None,
            ArmEffortUnit::NewtonMetre => Some(contact::EffortUnit::NewtonMetres),
            ArmEffortUnit::Ampere => Some(contact::EffortUnit::Amperes),
        };
        ArmFacts { group_delay_s: self.hello.group_delay_s, look_ahead_s: 0.0, servo: true, effort }
    }

    fn begin(&mut self, now: Stamp) -> Result<Measured, ArmError> {
        self.measured = now;
        Ok(Measured::plain(now, self.hello.q, [0.0; JOINTS]))
    }

    fn step(&mut self, until: Stamp, command: Option<&JointCommand<JOINTS>>) -> Result<Measured, ArmError> {
        let ArmAnswer { stamp, q, qd, effort, motion_allowed, .. } = self.exchange(until, command)?;
        Ok(Measured { stamp, q, qd, effort, motion_allowed })
    }
}
