//! The listener: lets pages in, one thread each, and no more of them than may be.

use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foretrace_serve::guard::{HostGuard, Token};
use foretrace_serve::http::{self, Head};
use foretrace_serve::peers::{PeerLimits, Peers, Slot, bound_waits};

use crate::board::{ConsoleBoard, ConsoleTally};
use crate::certificate::Certificate;
use crate::keys::Keys;
use crate::link::{DaemonLink, LinkError, PageInbox, channels};
use crate::page;
use crate::session;
use crate::stops;
use crate::wire::{PageStream, TLS_BEGINS};

/// Connections at a time; a browser opens six for each page. One who fills all slots that other machines may
/// have leaves some for a page of this machine that wants to stop the arm.
const LIMITS: PeerLimits = PeerLimits { all: 32, remote: 24, of_one: 12, local: 32 };
/// Between two looks at new connections.
const ACCEPT_INTERVAL: Duration = Duration::from_millis(5);
/// Longest wait for bytes of a request, and for an answer to be taken.
const WAIT: Duration = Duration::from_millis(200);
/// Longest wait for a page that does not read its answer.
const ANSWER: Duration = Duration::from_secs(5);
/// Longest time for all of an answer, so that a page that takes it byte by byte keeps no slot.
const WHOLE_ANSWER: Duration = Duration::from_secs(30);
/// Lines for the shell that may wait.
const LINES: usize = 64;
/// Longest wait for a shell that takes no lines, at the end.
const LAST_LINES: Duration = Duration::from_secs(1);

const HTML: &str = "text/html; charset=utf-8";

/// Tells the person at the console's shell.
type Log = Box<dyn Fn(&str) + Send + Sync>;

/// Why there is no console.
#[derive(thiserror::Error)]
pub enum ConsoleError {
    /// Nobody can listen there.
    #[error("cannot listen on {at}: {source}: choose another with --port, or an address of this machine")]
    Taken { at: SocketAddr, source: std::io::Error },
    /// The system gives no random numbers, or no thread.
    #[error("the console cannot start: {0}")]
    System(#[from] std::io::Error),
    /// The daemon cannot be attached to.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// Nothing would be new on the pages any more.
    #[error("the console's link to the daemon ended by itself: start the console again")]
    LinkEnded,
}

foretrace_serve::debug_as_display!(ConsoleError);

/// What other machines need to reach a console.
#[derive(Debug, Clone)]
pub struct Lan {
    /// Addresses of this machine, the one to be printed first; none of them loopback.
    pub addresses: Vec<IpAddr>,
    /// Names of this machine.
    pub names: Vec<String>,
    /// For all of these, and for this machine itself.
    pub certificate: Certificate,
}

/// How connections begin, and what they may ask for.
struct ConsoleDoor {
    guard: HostGuard,
    /// `None`: in the clear.
    certificate: Option<Certificate>,
    /// Where a page under TLS is, for those who forgot it.
    origin: String,
    peers: Arc<Peers>,
}

/// A console that listens.
pub struct Console {
    listeners: Vec<TcpListener>,
    at: SocketAddr,
    door: ConsoleDoor,
    board: Arc<ConsoleBoard>,
    inbox: PageInbox,
    log: Log,
    lines: Receiver<String>,
}

impl std::fmt::Debug for Console {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Console").field("at", &self.at).finish_non_exhaustive()
    }
}

/// Makes tokens for a console that runs.
#[derive(Clone)]
pub struct Renewer {
    board: Arc<ConsoleBoard>,
    origin: String,
}

impl Renewer {
    /// An address with a token that works once more. The page that controls goes on.
    ///
    /// # Errors
    ///
    /// The system gives no random numbers.
    pub fn address(&self) -> std::io::Result<String> {
        self.board.renew_token(Token::random()?);
        Ok(format!("{}/#{}", self.origin, self.board.token()))
    }
}

impl Console {
    /// Listens at `port` of 127.0.0.1, in the clear; with `lan` also at its addresses, all of them under TLS.
    /// 0: a free port. `log` is told what a person at the shell should know.
    ///
    /// # Errors
    ///
    /// `Taken`, `System`.
    pub fn open(port: u16, lan: Option<Lan>, log: Log) -> Result<Self, ConsoleError> {
        let mut port = port;
        let mut listeners = Vec::new();
        let mut at = Vec::new();
        let others = lan.as_ref().map_or(&[][..], |lan| &lan.addresses);
        for address in std::iter::once(IpAddr::V4(Ipv4Addr::LOCALHOST)).chain(others.iter().copied()) {
            let place = SocketAddr::new(address, port);
            let listener =
                TcpListener::bind(place).map_err(|source| ConsoleError::Taken { at: place, source })?;
            listener.set_nonblocking(true)?;
            at.push(listener.local_addr()?);
            // All at the same one.
            port = at.last().map_or(port, SocketAddr::port);
            listeners.push(listener);
        }
        let shown = at.get(1).or(at.first()).copied().unwrap_or_else(|| (Ipv4Addr::LOCALHOST, port).into());
        let (guard, certificate, scheme) = match lan {
            None => (HostGuard::local(port), None, "http"),
            Some(lan) => (HostGuard::secure(&at, &lan.names), Some(lan.certificate), "https"),
        };
        let door = ConsoleDoor {
            guard,
            certificate,
            origin: format!("{scheme}://{shown}"),
            peers: Peers::new(LIMITS),
        };
        let (pens, orders, inbox) = channels();
        let (line, lines) = sync_channel(LINES);
        let keys = Keys::new(Token::random()?, door.certificate.is_some());
        let board = Arc::new(ConsoleBoard::new(keys, line, pens, orders));
        Ok(Self { listeners, at: shown, door, board, inbox, log, lines })
    }

    /// The address to open; whoever has it controls, under TLS the first one that opens it.
    #[must_use]
    pub fn address(&self) -> String {
        format!("{}/#{}", self.door.origin, self.board.token())
    }

    /// Makes further addresses while it runs.
    #[must_use]
    pub fn renewer(&self) -> Renewer {
        Renewer { board: self.board.clone(), origin: self.door.origin.clone() }
    }

    /// Where it listens: for other machines, where it does.
    #[must_use]
    pub const fn at(&self) -> SocketAddr {
        self.at
    }

    /// Serves pages until `over` says so.
    ///
    /// # Errors
    ///
    /// `DaemonLink`, `LinkEnded`, `System`.
    pub fn run(self, link: DaemonLink, mut over: impl FnMut() -> bool) -> Result<ConsoleTally, ConsoleError> {
        let Self { listeners, at: _, door, board, inbox, log, lines } = self;
        let logging = logging(board.clone(), log, lines)?;
        let (stopped, instance) = (board.clone(), link.instance.clone());
        let stopping = std::thread::Builder::new()
            .name("console-stop".to_owned())
            .spawn(move || stops::serve(&stopped, &instance));
        let stopping = ending(&board, stopping)?;
        let (linked, link_ended) = std::sync::mpsc::channel();
        let links = board.clone();
        let running = std::thread::Builder::new().name("console-link".to_owned()).spawn(move || {
            let ended = link.run(&links, &inbox);
            let _ = linked.send(ended);
        });
        let running = ending(&board, running)?;
        let door = Arc::new(door);
        let count = Arc::new(AtomicU64::new(0));
        let mut failed = None;
        while !over() && failed.is_none() {
            let mut accepted = false;
            for listener in &listeners {
                if let Ok((stream, peer)) = listener.accept() {
                    let id = count.fetch_add(1, Ordering::Relaxed) + 1;
                    welcome(board.clone(), door.clone(), stream, peer, id);
                    accepted = true;
                }
            }
            if !accepted {
                // Also where no descriptor is left: some connection ends.
                std::thread::sleep(ACCEPT_INTERVAL);
            }
            failed = match link_ended.try_recv() {
                Err(TryRecvError::Empty) => None,
                Ok(Err(error)) => Some(error.into()),
                Ok(Ok(())) | Err(TryRecvError::Disconnected) => Some(ConsoleError::LinkEnded),
            };
        }
        board.finish();
        // It looks at the end every few milliseconds, or has ended.
        let _ = running.join();
        // A stop that was asked for is still sent.
        let _ = stopping.join();
        let begin = Instant::now();
        while !logging.is_finished() && begin.elapsed() < LAST_LINES {
            std::thread::sleep(ACCEPT_INTERVAL);
        }
        failed.map_or_else(|| Ok(board.tally()), Err)
    }
}

/// A thread that could not be started ends those that were.
fn ending<T>(board: &ConsoleBoard, started: std::io::Result<T>) -> std::io::Result<T> {
    started.inspect_err(|_| board.finish())
}

/// The thread that tells: a terminal may block it for as long as it likes.
fn logging(board: Arc<ConsoleBoard>, log: Log, lines: Receiver<String>) -> std::io::Result<JoinHandle<()>> {
    let tells = move || {
        loop {
            let over = board.is_over();
            match lines.recv_timeout(WAIT) {
                Ok(line) => log(&line),
                Err(RecvTimeoutError::Timeout) if !over => {}
                Err(_) => return,
            }
        }
    };
    std::thread::Builder::new().name("console-log".to_owned()).spawn(tells)
}

/// Gives the connection a thread, or turns it away.
fn welcome(
    board: Arc<ConsoleBoard>,
    door: Arc<ConsoleDoor>,
    mut stream: TcpStream,
    peer: SocketAddr,
    id: u64,
) {
    if bound_waits(&stream, WAIT, ANSWER).is_err() {
        return;
    }
    let slot = match door.peers.enter(&stream) {
        Ok(slot) => slot,
        Err(full) => {
            let reason = full.label();
            board.refuse(reason);
            // A short answer fits into the socket's own buffer; one who expects TLS reads the end of it.
            if door.certificate.is_none() {
                http::refuse(&mut stream, "503 Service Unavailable", reason, WHOLE_ANSWER);
            }
            return;
        }
    };
    let inside = board.clone();
    let serves = move || match begun(&door, stream) {
        Ok(wire) => admit(&inside, &door, wire, &slot, peer, id),
        Err(reason) => inside.refuse(reason),
    };
    if std::thread::Builder::new().name("console-page".to_owned()).spawn(serves).is_err() {
        board.refuse("no thread");
    }
}

/// Puts TLS on the connection where pages come under it; one that speaks plain HTTP is told where to go.
fn begun(door: &ConsoleDoor, mut stream: TcpStream) -> Result<PageStream, &'static str> {
    let Some(certificate) = &door.certificate else { return Ok(PageStream::clear(stream)) };
    let begin = Instant::now();
    let mut first = [0];
    loop {
        match stream.peek(&mut first) {
            Ok(1) if first == [TLS_BEGINS] => {
                return PageStream::secure(stream, &certificate.config).map_err(|_| "no TLS");
            }
            Ok(1) => break,
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
                    && begin.elapsed() < http::HEAD_TIME => {}
            _ => return Err(http::NoHead::Incomplete.label()),
        }
    }
    // Read, so that the answer is not lost in a reset.
    let _ = Head::read(&mut stream);
    let words = page::insecure(&door.origin);
    let _ = http::answer(&mut stream, "426 Upgrade Required", HTML, words.as_bytes(), WHOLE_ANSWER);
    Err("not under TLS")
}

/// Reads the request and answers it, or makes the connection a page's.
fn admit(
    board: &Arc<ConsoleBoard>,
    door: &ConsoleDoor,
    mut stream: PageStream,
    slot: &Slot,
    peer: SocketAddr,
    id: u64,
) {
    let refuse = |stream: &mut PageStream, status: &str, reason: &'static str| {
        board.refuse(reason);
        http::refuse(stream, status, reason, WHOLE_ANSWER);
        stream.end();
    };
    let head = match Head::asked(&mut stream, slot) {
        Ok(head) => head,
        Err((status, reason)) => return refuse(&mut stream, status, reason),
    };
    if head.minor_version != 1 {
        return refuse(&mut stream, "505 HTTP Version Not Supported", "malformed request");
    }
    if !head.only("host").is_some_and(|host| door.guard.is_host(host)) {
        return refuse(&mut stream, "403 Forbidden", "foreign host");
    }
    if head.method != "GET" {
        return refuse(&mut stream, "405 Method Not Allowed\r\nAllow: GET", "another method than GET");
    }
    if head.path != "/socket" {
        return match page::file(&head.path) {
            Some(file) => {
                let slow = [ErrorKind::TimedOut, ErrorKind::WouldBlock];
                match http::answer(&mut stream, "200 OK", file.kind, file.body, WHOLE_ANSWER) {
                    Err(error) if slow.contains(&error.kind()) => board.refuse("answer taken too slowly"),
                    // A browser that goes away meanwhile is no failure.
                    _ => {}
                }
                stream.end();
            }
            None => refuse(&mut stream, "404 Not Found", "no such file"),
        };
    }
    if !head.only("origin").is_some_and(|origin| door.guard.is_origin(origin)) {
        return refuse(&mut stream, "403 Forbidden", "foreign origin");
    }
    let Some(key) = head.socket_key() else {
        return refuse(&mut stream, "400 Bad Request", "no WebSocket of version 13");
    };
    if http::upgrade(&mut stream, key, None).is_err() {
        return;
    }
    board.count(|tally| tally.pages += 1);
    session::serve(board, stream, id, &peer.to_string());
}
