//! Bounds per second: of bytes on a connection, and of messages.
//!
//! A WebSocket message in pieces without end, each of them empty, is never a message: a bound on messages
//! does not see it, one on bytes does.

use std::io::{self, ErrorKind, Read, Write};
use std::time::{Duration, Instant};

/// Counts what comes in each second.
#[derive(Debug)]
pub struct PerSecond {
    most: usize,
    begin: Instant,
    count: usize,
}

impl PerSecond {
    /// At most `most` per second.
    #[must_use]
    pub fn new(most: usize) -> Self {
        Self { most, begin: Instant::now(), count: 0 }
    }

    /// Adds `count`; whether no more came in this second than may.
    pub fn add(&mut self, count: usize) -> bool {
        if self.begin.elapsed() >= Duration::from_secs(1) {
            (self.begin, self.count) = (Instant::now(), 0);
        }
        self.count = self.count.saturating_add(count);
        self.count <= self.most
    }
}

/// A connection whose reads fail with `QuotaExceeded` where more comes than may.
#[derive(Debug)]
pub struct Metered<S> {
    inner: S,
    bytes: PerSecond,
}

impl<S> Metered<S> {
    /// Around `inner`, from which at most `most` bytes may come per second.
    pub fn new(inner: S, most: usize) -> Self {
        Self { inner, bytes: PerSecond::new(most) }
    }

    pub const fn get_ref(&self) -> &S {
        &self.inner
    }
}

impl<S: Read> Read for Metered<S> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(into)?;
        if self.bytes.add(count) { Ok(count) } else { Err(ErrorKind::QuotaExceeded.into()) }
    }
}

impl<S: Write> Write for Metered<S> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.inner.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_bytes_than_may_come_in_a_second_end_the_reading_and_a_new_second_starts_from_zero() {
        let mut line = Metered::new(io::repeat(7), 100);
        let mut bytes = [0; 50];
        assert_eq!([line.read(&mut bytes).unwrap(), line.read(&mut bytes).unwrap()], [50, 50]);
        assert_eq!(line.read(&mut bytes).unwrap_err().kind(), ErrorKind::QuotaExceeded);
        line.bytes.begin -= Duration::from_secs(1);
        assert_eq!(line.read(&mut bytes).unwrap(), 50);
    }
}
