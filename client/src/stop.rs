//! `stop`: stops the arm with nothing but the run directory: no attachment, no shared memory, no free slot.

use std::hash::{BuildHasher, RandomState};
use std::io::ErrorKind;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use foretrace_shm::{Instance, InstanceError, Mode, STOP_ANSWER_BYTES, SignalError, StopAnswer, StopFrame};

/// The daemon notes a stop within microseconds; without an answer for this long, the next way is tried.
const PATIENCE: Duration = Duration::from_millis(100);
/// Pause before a full queue is tried again, and between two looks at a signal.
const AGAIN: Duration = Duration::from_millis(2);

/// A stop that a tick of the loop has taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stopped {
    /// The mode after that tick: `Stopped` or `Fault` where the arm was in charge, else `Idle`. None: it was
    /// taken as a signal, and nothing of the daemon but its loop runs that could report the mode.
    pub mode: Option<Mode>,
    /// Trust in that tick; none as above.
    pub trust: Option<f64>,
}

impl Stopped {
    /// The mode as text.
    #[must_use]
    pub fn words(&self) -> &'static str {
        self.mode.map_or("not told: taken as a signal", Mode::label)
    }
}

/// Why it is not known that the arm stops. Use the arm's own stop then.
#[derive(thiserror::Error)]
pub enum StopError {
    /// No daemon: an arm that followed commands brakes by itself.
    #[error("no daemon running for instance {number} (looked in {})", root.display())]
    NoDaemon {
        /// Number of the instance.
        number: u32,
        /// Where it was looked for.
        root: PathBuf,
    },
    /// The run directory is not this user's.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// Noted, but the loop does not run; its next tick takes the stop.
    #[error(
        "the daemon has noted the stop, but its loop has taken none within {} ms: it does not run, and the \
         arm brakes by itself when commands stay away", waited.as_millis()
    )]
    LoopSilent {
        /// How long it was waited for.
        waited: Duration,
    },
    /// A signal was sent, and no tick has been seen that took it.
    #[error(
        "process {pid} was sent SIGUSR1, which stops the arm in the next tick of its loop, but no such tick \
         was seen within {} ms: if the loop does not run, the arm brakes by itself when commands stay away",
        waited.as_millis()
    )]
    Unconfirmed {
        /// The process of the daemon.
        pid: u32,
        /// How long it was waited for.
        waited: Duration,
    },
    /// Neither way works.
    #[error("the daemon cannot be reached: its stop socket: {socket}; {signal}")]
    Unreachable {
        /// The error of the socket.
        socket: String,
        /// Why no signal was sent.
        signal: SignalError,
    },
}

/// Stop the arm of `instance` smoothly, and keep it stopped until it is armed again. Ends within `timeout`,
/// whatever state the daemon, its shared memory and this machine's memory are in.
///
/// First the datagram socket beside the daemon's lock file; if that gives no answer, SIGUSR1 to the process
/// that holds the lock; its loop takes that, and the kernel's account of its thread shows that it has. The
/// daemon may receive a stop twice, which counts as one. A request to arm that was sent before the stop came
/// is refused.
///
/// # Errors
///
/// [`StopError`]; all but `NoDaemon` mean that the arm's own stop should be used.
pub fn stop(instance: &Instance, timeout: Duration) -> Result<Stopped, StopError> {
    let begin = Instant::now();
    let deadline = begin + timeout;
    match instance.check_root() {
        Err(InstanceError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
            return Err(no_daemon(instance));
        }
        // Root may stop everybody's arm.
        Err(InstanceError::ForeignOwner { user: 0, .. }) => {}
        checked => checked?,
    }
    let attempt = StopAttempt::new(instance);
    let mut noted = false;
    let mut refused = String::new();
    // An address without a file first; where the daemon is in a network namespace of its own, only a file is
    // an address.
    for with_file in [false, true] {
        let until = deadline.min(Instant::now() + PATIENCE);
        let socket = if with_file { attempt.with_file() } else { attempt.nameless() };
        match socket.and_then(|socket| attempt.ask(&socket, until)) {
            Ok(StopReply::Taken(stopped)) => return Ok(stopped),
            Ok(StopReply::Noted(socket)) => {
                noted = true;
                if let Some(stopped) = attempt.wait(&socket, deadline) {
                    return Ok(stopped);
                }
            }
            Ok(StopReply::Nothing) => refused = "no answer".to_owned(),
            Err(error) => refused = error.to_string(),
        }
        if noted || Instant::now() >= deadline {
            break;
        }
    }
    if noted {
        return Err(StopError::LoopSilent { waited: begin.elapsed() });
    }
    match instance.signal_stop() {
        Ok(mut signalled) => {
            // A thread at the socket that is only slow can report more.
            let socket = attempt.with_file().and_then(|socket| {
                attempt.send(&socket, deadline.min(Instant::now() + PATIENCE)).map(|()| socket)
            });
            while Instant::now() < deadline {
                let taken = signalled.is_taken();
                let until = deadline.min(Instant::now() + if taken { PATIENCE } else { AGAIN });
                match &socket {
                    Ok(socket) => {
                        if let Some(stopped) = attempt.wait(socket, until) {
                            return Ok(stopped);
                        }
                    }
                    Err(_) => std::thread::sleep(AGAIN),
                }
                if taken {
                    return Ok(Stopped { mode: None, trust: None });
                }
            }
            Err(StopError::Unconfirmed { pid: signalled.pid(), waited: begin.elapsed() })
        }
        Err(SignalError::NoDaemon) => Err(no_daemon(instance)),
        Err(signal) => Err(StopError::Unreachable { socket: refused, signal }),
    }
}

fn no_daemon(instance: &Instance) -> StopError {
    StopError::NoDaemon { number: instance.number(), root: instance.root().to_path_buf() }
}

const fn stopped(mode: Mode, trust: f64) -> Stopped {
    Stopped { mode: Some(mode), trust: Some(trust) }
}

enum StopReply {
    Taken(Stopped),
    Noted(UnixDatagram),
    Nothing,
}

/// One stop, however often it is sent.
struct StopAttempt<'a> {
    instance: &'a Instance,
    frame: StopFrame,
    file: PathBuf,
}

impl Drop for StopAttempt<'_> {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.file);
    }
}

impl<'a> StopAttempt<'a> {
    fn new(instance: &'a Instance) -> Self {
        // Random keys from the kernel: the answer's key cannot be guessed.
        let token = RandomState::new().hash_one(foretrace_shm::monotonic_now_ns());
        let pid = std::process::id();
        let file = instance.root().join(format!("stop-{pid}-{:08x}", token >> 32));
        Self { instance, frame: StopFrame { token, pid }, file }
    }

    fn nameless(&self) -> std::io::Result<UnixDatagram> {
        let name = format!("foretrace-stop-{:016x}", self.frame.token ^ 0x5f5f_5f5f_5f5f_5f5f);
        UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(name)?)
    }

    fn with_file(&self) -> std::io::Result<UnixDatagram> {
        let _ = std::fs::remove_file(&self.file);
        UnixDatagram::bind(&self.file)
    }

    /// Sends the frame and waits for the first answer.
    fn ask(&self, socket: &UnixDatagram, until: Instant) -> std::io::Result<StopReply> {
        self.send(socket, until)?;
        Ok(match self.next(socket, until) {
            Some(StopAnswer { taken: Some(mode), trust, .. }) => StopReply::Taken(stopped(mode, trust)),
            Some(_) => StopReply::Noted(socket.try_clone()?),
            None => StopReply::Nothing,
        })
    }

    fn send(&self, socket: &UnixDatagram, until: Instant) -> std::io::Result<()> {
        // A full queue at the other end must not block this program.
        socket.set_nonblocking(true)?;
        let path = self.instance.stop_socket();
        while let Err(error) = socket.send_to(&self.frame.encode(), &path) {
            if error.kind() != ErrorKind::WouldBlock || Instant::now() >= until {
                return Err(error);
            }
            std::thread::sleep(AGAIN);
        }
        socket.set_nonblocking(false)
    }

    /// Waits for the tick that takes it.
    fn wait(&self, socket: &UnixDatagram, deadline: Instant) -> Option<Stopped> {
        loop {
            let StopAnswer { taken, trust, .. } = self.next(socket, deadline)?;
            if let Some(mode) = taken {
                return Some(stopped(mode, trust));
            }
        }
    }

    /// The next answer to this stop.
    fn next(&self, socket: &UnixDatagram, until: Instant) -> Option<StopAnswer> {
        let mut bytes = [0; STOP_ANSWER_BYTES + 1];
        loop {
            let left = until.saturating_duration_since(Instant::now());
            // Zero would wait for ever.
            socket.set_read_timeout(Some(left.max(Duration::from_micros(1)))).ok()?;
            match socket.recv(&mut bytes) {
                Ok(length) => {
                    let answer = StopAnswer::decode(bytes.get(..length).unwrap_or_default());
                    if let Some(answer) = answer.filter(|answer| answer.token == self.frame.token) {
                        return Some(answer);
                    }
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return None,
            }
            if left.is_zero() {
                return None;
            }
        }
    }
}
