//! Reads packages of port 30001 or 30002, one after the other, and sends scripts there.
//!
//! Contract: every wait is bounded; after an error the connection is of no use any more.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use super::{LARGEST, Malformed, PrimaryPackage};

/// Why there is not a package.
#[derive(Debug, thiserror::Error)]
pub enum PrimaryError {
    /// No connection; the kind tells refusal from silence.
    #[error("no connection to the primary interface: {0}")]
    Connect(std::io::Error),
    /// The connection broke.
    #[error("the primary interface's connection broke: {0}")]
    Broken(std::io::Error),
    /// It was closed from the other side.
    #[error("the controller closed the primary interface's connection")]
    Closed,
    /// What came is not a package.
    #[error("not the primary interface: {0}")]
    Malformed(#[from] Malformed),
}

#[derive(Debug)]
pub struct PrimaryClient {
    stream: TcpStream,
    bytes: Vec<u8>,
}

impl PrimaryClient {
    /// Connects within `patience`.
    ///
    /// # Errors
    ///
    /// [`PrimaryError::Connect`].
    pub fn connect(address: SocketAddr, patience: Duration) -> Result<Self, PrimaryError> {
        let stream = crate::connect(address, patience).map_err(PrimaryError::Connect)?;
        Ok(Self { stream, bytes: Vec::new() })
    }

    /// Sends a script, each write within the patience of [`Self::connect`].
    ///
    /// # Errors
    ///
    /// [`PrimaryError::Broken`].
    pub fn send(&mut self, script: &[u8]) -> Result<(), PrimaryError> {
        self.stream.write_all(script).map_err(PrimaryError::Broken)
    }

    /// The next package; `None` when none was whole after `timeout`.
    ///
    /// # Errors
    ///
    /// See [`PrimaryError`].
    pub fn receive(&mut self, timeout: Duration) -> Result<Option<PrimaryPackage>, PrimaryError> {
        let end = Instant::now() + timeout;
        let mut piece = [0; 4096];
        loop {
            let mut rest = &self.bytes[..];
            let package = PrimaryPackage::take(&mut rest)?;
            let used = self.bytes.len() - rest.len();
            self.bytes.drain(..used);
            let now = Instant::now();
            if package.is_some() || now >= end {
                return Ok(package);
            }
            // Less than a package is kept, so this never grows beyond one and a piece.
            debug_assert!(self.bytes.len() < LARGEST, "a whole package was not taken");
            let wait = end.duration_since(now).max(Duration::from_micros(100));
            self.stream.set_read_timeout(Some(wait)).map_err(PrimaryError::Broken)?;
            match self.stream.read(&mut piece) {
                Ok(0) => return Err(PrimaryError::Closed),
                Ok(length) => self.bytes.extend(piece.iter().take(length)),
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => {}
                    _ => return Err(PrimaryError::Broken(error)),
                },
            }
        }
    }
}
