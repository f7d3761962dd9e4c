//! A viewer's connection, with a bound on what comes.
//!
//! Contract: where more comes than may, reading fails with `QuotaExceeded`. A message in pieces without end,
//! each of them empty, is none yet: only its bytes can be counted.

use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Most bytes of a viewer per second: far more than one says.
const BYTES: usize = 4 << 20;

pub(crate) struct Metered {
    pub(crate) stream: TcpStream,
    /// Begin of this second, and bytes in it.
    second: (Instant, usize),
}

impl Metered {
    pub(crate) fn new(stream: TcpStream) -> Self {
        Self { stream, second: (Instant::now(), 0) }
    }
}

impl Read for Metered {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.stream.read(into)?;
        if self.second.0.elapsed() >= Duration::from_secs(1) {
            self.second = (Instant::now(), 0);
        }
        self.second.1 += count;
        if self.second.1 > BYTES { Err(ErrorKind::QuotaExceeded.into()) } else { Ok(count) }
    }
}

impl Write for Metered {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}
