//! The server's side of a WebSocket: messages in, messages out, and when a peer is to be let go.
//!
//! Contract: no call waits for longer than the timeouts of the stream below, once per packet. A peer that
//! sends too much, is silent or takes nothing for too long is reported with the reason; what could not be
//! written waits in a buffer of bounded size.

use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

use tungstenite::error::ProtocolError;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, WebSocket};

pub use tungstenite::{Bytes, Message};

use crate::http::waits;
use crate::metered::PerSecond;

/// Bytes that may wait to be written, beside the message that is being written.
const WAITING_BYTES: usize = 1 << 20;

/// What a peer may do.
#[derive(Debug, Clone, Copy)]
pub struct SocketLimits {
    /// Largest message of the peer \[bytes\].
    pub message_bytes: usize,
    /// Most messages of the peer per second, of any kind.
    pub messages_per_s: usize,
    /// Bytes that are collected before they are written; 0: each message at once.
    pub write_buffer: usize,
    /// Longest time for which it takes nothing.
    pub stuck: Duration,
    /// Longest time for which it sends nothing.
    pub silent: Duration,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Incoming {
    /// A message, text or binary.
    Message(Message),
    Nothing,
    /// The peer ended the connection.
    Closed,
    /// The connection broke by itself.
    Broken,
}

/// A connection that has been upgraded.
#[derive(Debug)]
pub struct Socket<S> {
    inner: WebSocket<S>,
    limits: SocketLimits,
    messages: PerSecond,
    heard: Instant,
    /// Since when something waits to be read by the peer.
    stuck_since: Option<Instant>,
}

impl<S: Read + Write> Socket<S> {
    /// Around `stream`, whose timeouts are short.
    pub fn new(stream: S, limits: SocketLimits) -> Self {
        let config = WebSocketConfig::default()
            .max_message_size(Some(limits.message_bytes))
            .max_frame_size(Some(limits.message_bytes))
            .write_buffer_size(limits.write_buffer)
            .max_write_buffer_size(WAITING_BYTES);
        Self {
            inner: WebSocket::from_raw_socket(stream, Role::Server, Some(config)),
            limits,
            messages: PerSecond::new(limits.messages_per_s),
            heard: Instant::now(),
            stuck_since: None,
        }
    }

    /// Waits for a packet, as long as the stream's read timeout.
    ///
    /// # Errors
    ///
    /// Why the peer is to be let go, in words to count by.
    pub fn receive(&mut self) -> Result<Incoming, &'static str> {
        let packet = self.inner.read();
        if packet.is_ok() {
            // Every kind of packet costs work.
            self.heard = Instant::now();
            if !self.messages.add(1) {
                return Err("too many messages");
            }
        }
        match packet {
            Ok(Message::Close(_)) | Err(Error::ConnectionClosed | Error::AlreadyClosed) => {
                Ok(Incoming::Closed)
            }
            Ok(message @ (Message::Text(_) | Message::Binary(_))) => Ok(Incoming::Message(message)),
            Err(Error::Io(error)) if error.kind() == ErrorKind::QuotaExceeded => Err("too many bytes"),
            Err(Error::Io(error)) if !waits(&error) => Ok(Incoming::Broken),
            Err(Error::Protocol(ProtocolError::ResetWithoutClosingHandshake)) => Ok(Incoming::Broken),
            Err(Error::Capacity(_)) => Err("message too long"),
            Ok(_) | Err(Error::Io(_)) if self.heard.elapsed() <= self.limits.silent => Ok(Incoming::Nothing),
            Ok(_) | Err(Error::Io(_)) => Err("silent"),
            Err(_) => Err("broken WebSocket"),
        }
    }

    /// Writes `message`, or keeps it in the buffer.
    pub fn send(&mut self, message: Message) {
        if self.inner.write(message).is_err() {
            self.stuck_since.get_or_insert_with(Instant::now);
        }
    }

    /// Writes what was collected.
    pub fn flush(&mut self) {
        if self.inner.flush().is_err() {
            self.stuck_since.get_or_insert_with(Instant::now);
        }
    }

    /// Tries to write what waits.
    ///
    /// # Errors
    ///
    /// Why the peer is to be let go, in words to count by.
    pub fn push(&mut self) -> Result<(), &'static str> {
        let Some(since) = self.stuck_since else { return Ok(()) };
        match self.inner.flush() {
            Ok(()) => self.stuck_since = None,
            Err(_) if since.elapsed() > self.limits.stuck => return Err("reads too slowly"),
            Err(_) => {}
        }
        Ok(())
    }

    /// Whether something still waits to be read by the peer.
    #[must_use]
    pub const fn is_stuck(&self) -> bool {
        self.stuck_since.is_some()
    }

    /// Says that the connection ends; the peer need not hear it. Returns the stream.
    pub fn close(mut self) -> S {
        let _ = self.inner.close(None);
        let _ = self.inner.flush();
        self.inner.into_inner()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{TcpListener, TcpStream};

    const LIMITS: SocketLimits = SocketLimits {
        message_bytes: 1000,
        messages_per_s: 20,
        write_buffer: 0,
        stuck: Duration::from_millis(200),
        silent: Duration::from_millis(200),
    };

    fn pair() -> (WebSocket<TcpStream>, Socket<TcpStream>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let peer = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let stream = listener.accept().unwrap().0;
        stream.set_read_timeout(Some(Duration::from_millis(2))).unwrap();
        stream.set_write_timeout(Some(Duration::from_millis(2))).unwrap();
        (WebSocket::from_raw_socket(peer, Role::Client, None), Socket::new(stream, LIMITS))
    }

    /// What ends the connection, with how many messages came before.
    fn end(socket: &mut Socket<TcpStream>) -> (Result<Incoming, &'static str>, usize) {
        let mut messages = 0;
        loop {
            match socket.receive() {
                Ok(Incoming::Message(_)) => messages += 1,
                Ok(Incoming::Nothing) => {}
                end => return (end, messages),
            }
        }
    }

    #[test]
    fn a_peer_that_floods_is_silent_too_long_or_gone_is_reported_with_the_reason() {
        let (mut peer, mut socket) = pair();
        for _ in 0..=LIMITS.messages_per_s {
            peer.send(Message::text("x")).unwrap();
        }
        assert_eq!(end(&mut socket), (Err("too many messages"), LIMITS.messages_per_s));
        let (mut peer, mut socket) = pair();
        peer.send(Message::text("x")).unwrap();
        assert_eq!(end(&mut socket), (Err("silent"), 1));
        let (mut peer, mut socket) = pair();
        peer.send(Message::text("x".repeat(1001))).unwrap();
        assert_eq!(end(&mut socket), (Err("message too long"), 0));
        let (peer, mut socket) = pair();
        drop(peer);
        assert_eq!(end(&mut socket), (Ok(Incoming::Broken), 0));
        let (mut peer, mut socket) = pair();
        peer.close(None).unwrap();
        assert_eq!(end(&mut socket), (Ok(Incoming::Closed), 0));
    }

    #[test]
    fn a_peer_that_takes_nothing_is_reported_and_one_that_takes_late_is_not() {
        let (mut late, mut socket) = pair();
        while !socket.is_stuck() {
            socket.send(Message::binary(vec![7; 100_000]));
        }
        let reading = std::thread::spawn(move || while late.read().is_ok() {});
        while socket.is_stuck() {
            socket.push().unwrap();
        }
        drop(socket.close());
        reading.join().unwrap();
        let (_never, mut socket) = pair();
        let begin = Instant::now();
        let reason = loop {
            socket.send(Message::binary(vec![7; 100_000]));
            if let Err(reason) = socket.push() {
                break reason;
            }
            assert!(begin.elapsed() < Duration::from_secs(60));
        };
        assert_eq!(reason, "reads too slowly");
    }
}
