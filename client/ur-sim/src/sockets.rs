//! Sockets of programs: connections that a program opens to a server, by name.
//!
//! Contract: bounded, and never waits: the control loop reads and writes what goes at once, and connecting is
//! a thread's. Without leave only loopback addresses are connected to. A send to a peer that does not read
//! fails; what a peer sends waits in its own buffers once [`MOST_BYTES`] are here.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Duration;

/// Sockets of one program.
const MOST_SOCKETS: usize = 32;
/// Bytes that wait to be read by a program, and as many to be sent.
pub(super) const MOST_BYTES: usize = 64 * 1024;
/// Longest that connecting takes: the manual's.
const CONNECTING: Duration = Duration::from_secs(2);
/// Connections that are being made at a time, those of programs that are over included.
const MOST_CONNECTING: usize = 16;
/// Characters of a name or address.
const LONGEST_NAME: usize = 255;

/// Why a socket was not opened.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NotOpened {
    #[error("cannot connect to {0}: {1}")]
    Refused(String, String),
    #[error(
        "{0} is not this machine; ur-sim connects programs to loopback only, unless --program-sockets any"
    )]
    NotLoopback(String),
    #[error("a program has at most {MOST_SOCKETS} sockets, and {MOST_CONNECTING} that are being connected")]
    TooMany,
}

#[derive(Debug)]
enum Link {
    Connecting(Receiver<Result<TcpStream, NotOpened>>),
    Open(TcpStream),
    Closed,
}

/// Whose a socket is, the program's or a secondary program's: it ends with that.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SocketOwner {
    Program,
    Secondary,
}

/// One connection of a program.
#[derive(Debug)]
pub(super) struct ProgramSocket {
    owner: SocketOwner,
    link: Link,
    /// What came; before `taken` it is of no use any more.
    inbox: Vec<u8>,
    taken: usize,
    searched: Searched,
    outbox: Vec<u8>,
}

/// How far the inbox has been looked through for a mark that is not there: what waits for it does not begin
/// anew in every cycle.
#[derive(Debug, Default)]
struct Searched {
    mark: Vec<u8>,
    /// So many bytes of the inbox, from `taken` on, begin no mark.
    bytes: usize,
}

/// What a search through an inbox found, and what it took.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MarkSearch {
    /// Where the mark begins.
    pub(super) at: Option<usize>,
    /// Bytes that were looked at.
    pub(super) looked_at: usize,
}

/// All connections of a program, by name.
#[derive(Debug, Default)]
pub struct ProgramSockets {
    any_host: bool,
    sockets: BTreeMap<String, ProgramSocket>,
    connecting: Arc<AtomicUsize>,
}

impl ProgramSockets {
    /// None yet; whether to other hosts than this one, too.
    #[must_use]
    pub fn new(any_host: bool) -> Self {
        Self { any_host, ..Self::default() }
    }

    /// Begins to connect; a socket of that name that is open already is closed.
    ///
    /// # Errors
    ///
    /// [`NotOpened::TooMany`], or no thread.
    pub fn open(&mut self, owner: SocketOwner, name: &str, host: &str, port: u16) -> Result<(), NotOpened> {
        self.sockets.remove(name);
        let connecting = Arc::clone(&self.connecting);
        if self.sockets.len() >= MOST_SOCKETS || connecting.load(Ordering::Relaxed) >= MOST_CONNECTING {
            return Err(NotOpened::TooMany);
        }
        let (name, host): (String, String) =
            (name.chars().take(LONGEST_NAME).collect(), host.chars().take(LONGEST_NAME).collect());
        let (tell, told) = channel();
        let (any_host, address) = (self.any_host, format!("{host}:{port}"));
        connecting.fetch_add(1, Ordering::Relaxed);
        let over = Arc::clone(&connecting);
        let started = std::thread::Builder::new().name("ur program socket".to_owned()).spawn(move || {
            // Whoever asked may be gone.
            let _ = tell.send(connect(&host, port, any_host));
            over.fetch_sub(1, Ordering::Relaxed);
        });
        if started.is_err() {
            connecting.fetch_sub(1, Ordering::Relaxed);
        }
        started.map_err(|error| NotOpened::Refused(address, error.to_string()))?;
        let link = Link::Connecting(told);
        let socket = ProgramSocket {
            owner,
            link,
            inbox: Vec::new(),
            taken: 0,
            searched: Searched::default(),
            outbox: Vec::new(),
        };
        self.sockets.insert(name, socket);
        Ok(())
    }

    /// Whether the socket has been connected; `None` while that is going on.
    pub fn opened(&mut self, name: &str) -> Option<Result<(), NotOpened>> {
        let gone = || NotOpened::Refused(name.to_owned(), "it was closed meanwhile".to_owned());
        let Some(socket) = self.sockets.get_mut(name) else { return Some(Err(gone())) };
        let Link::Connecting(told) = &socket.link else {
            return Some(if matches!(socket.link, Link::Open(_)) { Ok(()) } else { Err(gone()) });
        };
        match told.try_recv() {
            Err(TryRecvError::Empty) => None,
            Ok(Ok(stream)) => {
                socket.link = Link::Open(stream);
                Some(Ok(()))
            }
            Ok(Err(why)) => {
                self.sockets.remove(name);
                Some(Err(why))
            }
            Err(TryRecvError::Disconnected) => {
                self.sockets.remove(name);
                Some(Err(gone()))
            }
        }
    }

    pub fn close(&mut self, name: &str) {
        if let Some(mut socket) = self.sockets.remove(name) {
            socket.flush();
        }
    }

    /// What this owner has opened; it is over.
    pub fn close_of(&mut self, owner: SocketOwner) {
        self.sockets.retain(|_, socket| {
            if socket.owner == owner {
                socket.flush();
            }
            socket.owner != owner
        });
    }

    /// The program is over.
    pub fn close_all(&mut self) {
        self.sockets.values_mut().for_each(ProgramSocket::flush);
        self.sockets.clear();
    }

    /// Open sockets, and those on their way.
    #[must_use]
    pub fn len(&self) -> usize {
        self.sockets.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.sockets.is_empty()
    }

    /// What waits to be sent goes out as far as it can.
    pub fn flush(&mut self) {
        self.sockets.values_mut().for_each(ProgramSocket::flush);
    }

    pub(super) fn get(&mut self, name: &str) -> Option<&mut ProgramSocket> {
        self.sockets.get_mut(name)
    }
}

impl ProgramSocket {
    /// Takes bytes to be sent; false where the peer is gone or does not read.
    pub(super) fn send(&mut self, bytes: &[u8]) -> bool {
        if !matches!(self.link, Link::Open(_)) || self.outbox.len() + bytes.len() > MOST_BYTES {
            return false;
        }
        self.outbox.extend_from_slice(bytes);
        self.flush();
        matches!(self.link, Link::Open(_))
    }

    fn flush(&mut self) {
        while let (Link::Open(stream), false) = (&mut self.link, self.outbox.is_empty()) {
            match stream.write(&self.outbox) {
                Ok(count) if count > 0 => {
                    self.outbox.drain(..count.min(self.outbox.len()));
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Ok(_) | Err(_) => self.link = Link::Closed,
            }
        }
    }

    /// Reads what has come; whether more may come, and how many bytes came.
    pub(super) fn receive(&mut self) -> (bool, usize) {
        let mut buffer = [0; 4096];
        let before = self.inbox().len();
        while self.inbox().len() < MOST_BYTES {
            let Link::Open(stream) = &mut self.link else { break };
            let room = buffer.len().min(MOST_BYTES - self.inbox.len().saturating_sub(self.taken));
            match stream.read(buffer.get_mut(..room).unwrap_or_default()) {
                Ok(0) => self.link = Link::Closed,
                Ok(count) => self.inbox.extend_from_slice(buffer.get(..count).unwrap_or_default()),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => self.link = Link::Closed,
            }
        }
        (matches!(self.link, Link::Open(_)), self.inbox().len().saturating_sub(before))
    }

    /// What has come and was not taken yet.
    pub(super) fn inbox(&self) -> &[u8] {
        self.inbox.get(self.taken..).unwrap_or_default()
    }

    /// No more can come before something is taken.
    pub(super) fn is_full(&self) -> bool {
        self.inbox().len() >= MOST_BYTES
    }

    /// Looks for `mark` where it was not looked for yet.
    pub(super) fn find(&mut self, mark: &[u8]) -> MarkSearch {
        if self.searched.mark != mark {
            self.searched = Searched { mark: mark.to_vec(), bytes: 0 };
        }
        let from = self.searched.bytes;
        let rest = self.inbox().get(from..).unwrap_or_default();
        let length = rest.len();
        match find(rest, mark) {
            Some(at) => MarkSearch { at: Some(from + at), looked_at: at + mark.len() },
            None => {
                self.searched.bytes = from + (length + 1).saturating_sub(mark.len());
                MarkSearch { at: None, looked_at: length }
            }
        }
    }

    /// Takes the first `count` bytes.
    pub(super) fn take(&mut self, count: usize) -> Vec<u8> {
        let taken = self.inbox().get(..count).unwrap_or(self.inbox()).to_vec();
        self.discard(taken.len());
        taken
    }

    /// Forgets the first `count` bytes.
    pub(super) fn discard(&mut self, count: usize) {
        self.taken = self.taken.saturating_add(count).min(self.inbox.len());
        self.searched.bytes = self.searched.bytes.saturating_sub(count);
        // Moving the rest costs no more than what was taken did.
        if self.taken * 2 >= self.inbox.len() {
            self.inbox.drain(..self.taken);
            self.taken = 0;
        }
    }
}

/// Where `mark` begins in `bytes`; one of no length begins at once.
pub(super) fn find(bytes: &[u8], mark: &[u8]) -> Option<usize> {
    let Some(&first) = mark.first() else { return Some(0) };
    let mut from = 0;
    while let Some(at) = bytes.get(from..)?.iter().position(|byte| *byte == first) {
        from += at;
        if bytes.get(from..)?.starts_with(mark) {
            return Some(from);
        }
        from += 1;
    }
    None
}

fn connect(host: &str, port: u16, any_host: bool) -> Result<TcpStream, NotOpened> {
    let refused = |why: &dyn std::fmt::Display| NotOpened::Refused(format!("{host}:{port}"), why.to_string());
    let mut why = NotOpened::NotLoopback(host.to_owned());
    // A name is looked up in the network: not without leave.
    if !any_host && host != "localhost" && host.parse::<IpAddr>().is_err() {
        return Err(why);
    }
    let addresses = (host, port).to_socket_addrs().map_err(|error| refused(&error))?;
    for address in addresses.filter(|address| any_host || address.ip().to_canonical().is_loopback()).take(4) {
        let stream = TcpStream::connect_timeout(&address, CONNECTING)
            .and_then(|stream| stream.set_nonblocking(true).map(|()| stream))
            .and_then(|stream| stream.set_nodelay(true).map(|()| stream));
        match stream {
            Ok(stream) => return Ok(stream),
            Err(error) => why = refused(&error),
        }
    }
    Err(why)
}
