//! A connection, in the clear or under TLS, with the same bounded waits.
//!
//! Contract: no call waits for longer than the timeouts of the socket below it, once per piece that moves.
//! What a peer does not read waits in a buffer of bounded size, and the next write says that it would block.
//! Bytes are counted before TLS takes them: records without content, also of a handshake, cost work too.

use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::Duration;

use foretrace_serve::metered::Metered;
use rustls::{ServerConfig, ServerConnection};

/// The first byte of a TLS handshake. Source: RFC 8446, 5.1 (content type handshake).
pub(crate) const TLS_BEGINS: u8 = 22;

/// Most bytes of a page per second: a multiple of what the fastest pen needs.
const BYTES: usize = 4 << 20;

pub(crate) enum PageStream {
    Clear(Metered<TcpStream>),
    Secure(Box<Secure>),
}

/// A connection under TLS.
pub(crate) struct Secure {
    socket: Metered<TcpStream>,
    tls: ServerConnection,
}

impl PageStream {
    pub(crate) fn clear(socket: TcpStream) -> Self {
        Self::Clear(Metered::new(socket, BYTES))
    }

    /// Puts TLS on a connection; the handshake goes with the first reads.
    ///
    /// # Errors
    ///
    /// The settings of TLS do not fit together.
    pub(crate) fn secure(socket: TcpStream, config: &Arc<ServerConfig>) -> io::Result<Self> {
        let tls = ServerConnection::new(config.clone()).map_err(io::Error::other)?;
        Ok(Self::Secure(Box::new(Secure { socket: Metered::new(socket, BYTES), tls })))
    }

    fn socket(&self) -> &TcpStream {
        match self {
            Self::Clear(socket) => socket.get_ref(),
            Self::Secure(secure) => secure.socket.get_ref(),
        }
    }

    /// Longest waits of one read and one write.
    pub(crate) fn set_timeouts(&self, read: Duration, write: Duration) -> io::Result<()> {
        let socket = self.socket();
        socket.set_read_timeout(Some(read))?;
        socket.set_write_timeout(Some(write))
    }

    pub(crate) fn set_nodelay(&self) -> io::Result<()> {
        self.socket().set_nodelay(true)
    }

    /// Says that nothing more comes. The peer need not hear it.
    pub(crate) fn end(&mut self) {
        if let Self::Secure(secure) = self {
            secure.tls.send_close_notify();
            let _ = secure.pass_on();
        }
    }
}

impl Secure {
    /// Hands what waits to the socket.
    fn pass_on(&mut self) -> io::Result<()> {
        while self.tls.wants_write() {
            if self.tls.write_tls(&mut self.socket)? == 0 {
                return Err(ErrorKind::WriteZero.into());
            }
        }
        Ok(())
    }
}

impl Read for Secure {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self.tls.reader().read(into) {
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            done => return done,
        }
        self.tls.read_tls(&mut self.socket)?;
        let heard = self.tls.process_new_packets();
        // A page that reads nothing is heard all the same: it may ask for a stop.
        let _ = self.pass_on();
        heard.map_err(|error| io::Error::new(ErrorKind::InvalidData, error))?;
        // One piece per call, so that a peer that drips cannot hold the caller's clock up.
        self.tls.reader().read(into)
    }
}

impl Write for Secure {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // What waits goes first; more is taken only when all of it went.
        self.pass_on()?;
        let taken = self.tls.writer().write(bytes)?;
        match self.pass_on() {
            Err(error) if !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => Err(error),
            _ => Ok(taken),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.pass_on()?;
        self.socket.flush()
    }
}

impl Read for PageStream {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Clear(socket) => socket.read(into),
            Self::Secure(secure) => secure.read(into),
        }
    }
}

impl Write for PageStream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Clear(socket) => socket.write(bytes),
            Self::Secure(secure) => secure.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Clear(socket) => socket.flush(),
            Self::Secure(secure) => secure.flush(),
        }
    }
}
