//! A connection with a bound on what comes per second, and whom to count as one machine.
//!
//! For servers that speak with strangers. A WebSocket message in pieces without end, each of them empty, is
//! never a message: a bound on messages does not see it, one on bytes does.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{IpAddr, Ipv6Addr};
use std::time::{Duration, Instant};

/// A connection whose reads fail with `QuotaExceeded` where more comes than may.
#[derive(Debug)]
pub struct Metered<S> {
    inner: S,
    /// Most bytes per second.
    most: usize,
    /// Begin of this second, and bytes in it.
    second: (Instant, usize),
}

impl<S> Metered<S> {
    /// Around `inner`, from which at most `most` bytes may come per second.
    pub fn new(inner: S, most: usize) -> Self {
        Self { inner, most, second: (Instant::now(), 0) }
    }

    /// The connection.
    pub const fn get_ref(&self) -> &S {
        &self.inner
    }

    /// The connection; what is read past this is not counted.
    pub const fn get_mut(&mut self) -> &mut S {
        &mut self.inner
    }
}

impl<S: Read> Read for Metered<S> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(into)?;
        if self.second.0.elapsed() >= Duration::from_secs(1) {
            self.second = (Instant::now(), 0);
        }
        self.second.1 = self.second.1.saturating_add(count);
        if self.second.1 > self.most { Err(ErrorKind::QuotaExceeded.into()) } else { Ok(count) }
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

/// The address that stands for the whole machine of a peer, for bounds per machine: with IPv6 it may have as
/// many as it likes below one prefix of 64 bits (RFC 4291, section 2.5.4).
#[must_use]
pub fn machine(peer: IpAddr) -> IpAddr {
    match peer.to_canonical() {
        IpAddr::V6(address) if !address.is_loopback() => {
            IpAddr::V6(Ipv6Addr::from_bits(address.to_bits() & !u128::from(u64::MAX)))
        }
        address => address,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_bytes_than_may_come_in_a_second_end_the_reading_and_a_new_second_begins_anew() {
        let mut line = Metered::new(io::repeat(7), 100);
        let mut bytes = [0; 50];
        assert_eq!([line.read(&mut bytes).unwrap(), line.read(&mut bytes).unwrap()], [50, 50]);
        assert_eq!(line.read(&mut bytes).unwrap_err().kind(), ErrorKind::QuotaExceeded);
        line.second.0 -= Duration::from_secs(1);
        assert_eq!(line.read(&mut bytes).unwrap(), 50);
    }
}
