//! A pen in another user's process: `GatewayFeed` sends to `foretrace gateway` over its socket.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use foretrace_shm::gateway::{Frame, WELCOME};
use foretrace_shm::{PenSample, Rejection, Validate};

use crate::PenReading;

/// The gateway answers at once; only one that hangs takes longer.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest line of the gateway \[bytes\].
const LINE_LIMIT: u64 = 4096;

/// Why readings cannot go through the gateway.
#[derive(thiserror::Error)]
pub enum GatewayError {
    /// No connection.
    #[error("{}: {source}: is `foretrace gateway` running, and may this user write to its \
             socket?", path.display())]
    Unreachable {
        /// The socket that was tried.
        path: PathBuf,
        /// The system's reason for it.
        source: io::Error,
    },
    /// The gateway refused this client, with its reason.
    #[error("the gateway says: {0}")]
    Refused(String),
    /// The gateway would refuse the reading.
    #[error("the pen reading is invalid: {0}")]
    Invalid(#[from] Rejection),
    /// The connection broke without a word.
    #[error("the gateway is gone: {0}")]
    Gone(io::Error),
}

/// Sends pen readings to a gateway, as [`PenFeed`](crate::PenFeed) does to the shared memory of the own user.
#[derive(Debug)]
pub struct GatewayFeed {
    lines: BufReader<UnixStream>,
    sent: u64,
}

impl GatewayFeed {
    /// Connect to the gateway's socket and wait until it lets this process in.
    ///
    /// # Errors
    ///
    /// `Unreachable`; `Refused`, with its reason; `Gone`.
    pub fn connect(path: impl AsRef<Path>) -> Result<Self, GatewayError> {
        let path = path.as_ref();
        let unreachable = |source| GatewayError::Unreachable { path: path.to_path_buf(), source };
        let stream = UnixStream::connect(path).map_err(unreachable)?;
        stream.set_read_timeout(Some(PATIENCE)).map_err(unreachable)?;
        stream.set_write_timeout(Some(PATIENCE)).map_err(unreachable)?;
        let mut feed = Self { lines: BufReader::new(stream), sent: 0 };
        match feed.line() {
            Ok(line) if line == WELCOME => Ok(feed),
            Ok(line) => Err(GatewayError::Refused(line)),
            Err(error) => Err(GatewayError::Gone(error)),
        }
    }

    /// Send one reading, stamped on this host's monotonic clock and later than the one before.
    ///
    /// # Errors
    ///
    /// `Invalid`, and nothing is sent; `Refused` or `Gone`, and the connection is over: connect again.
    pub fn send(&mut self, reading: PenReading) -> Result<(), GatewayError> {
        self.send_sample(reading.sample())
    }

    /// Send a sample as it stands; its header is not transmitted.
    ///
    /// # Errors
    ///
    /// As [`GatewayFeed::send`].
    pub fn send_sample(&mut self, sample: PenSample) -> Result<(), GatewayError> {
        sample.validate()?;
        match self.lines.get_mut().write_all(&Frame(sample).encode()) {
            Ok(()) => {
                self.sent = self.sent.saturating_add(1);
                Ok(())
            }
            Err(error) => Err(self.line().map_or(GatewayError::Gone(error), GatewayError::Refused)),
        }
    }

    /// Readings sent so far.
    #[must_use]
    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// End the connection in order. Returns the gateway's last line: how many samples it passed on and
    /// refused, and why.
    ///
    /// # Errors
    ///
    /// `Gone`.
    pub fn finish(mut self) -> Result<String, GatewayError> {
        self.lines.get_ref().shutdown(Shutdown::Write).map_err(GatewayError::Gone)?;
        self.line().map_err(GatewayError::Gone)
    }

    /// One line of the gateway, without its end.
    fn line(&mut self) -> io::Result<String> {
        let mut bytes = Vec::new();
        self.lines.by_ref().take(LINE_LIMIT).read_until(b'\n', &mut bytes)?;
        match bytes.pop() {
            Some(b'\n') => Ok(String::from_utf8_lossy(&bytes).into_owned()),
            _ => Err(io::Error::from(io::ErrorKind::UnexpectedEof)),
        }
    }
}
