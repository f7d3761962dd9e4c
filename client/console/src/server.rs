//! The listener: lets pages in, one thread each, and no more of them than may be.

use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::board::{Board, Tally};
use crate::guard::{Hosts, Token};
use crate::http::{self, Head};
use crate::link::{Inbox, Link, LinkError, channels};
use crate::page;
use crate::session;
use crate::stops;

/// Most connections at a time.
const CONNECTIONS: usize = 32;
/// Between two looks at new connections.
const KNOCKS_EVERY: Duration = Duration::from_millis(5);
/// Longest wait for bytes of a request, and for an answer to be taken.
const WAIT: Duration = Duration::from_millis(200);
/// Longest wait for a page that does not read its answer.
const ANSWER: Duration = Duration::from_secs(5);
/// Lines for the shell that may wait.
const LINES: usize = 64;
/// Longest wait for a shell that takes no lines, at the end.
const LAST_LINES: Duration = Duration::from_secs(1);

/// Tells the person at the console's shell.
type Log = Box<dyn Fn(&str) + Send + Sync>;

/// Why there is no console.
#[derive(thiserror::Error)]
pub enum ConsoleError {
    /// Nobody can listen there.
    #[error("127.0.0.1:{port} cannot be listened at: {source}: choose another with --port")]
    Taken {
        /// The port.
        port: u16,
        /// The system's error.
        source: std::io::Error,
    },
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

impl std::fmt::Debug for ConsoleError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

/// A console that listens.
pub struct Console {
    listener: TcpListener,
    at: SocketAddr,
    board: Arc<Board>,
    inbox: Inbox,
    log: Log,
    lines: Receiver<String>,
}

impl std::fmt::Debug for Console {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Console").field("at", &self.at).finish_non_exhaustive()
    }
}

impl Console {
    /// Listens at `port` of 127.0.0.1; 0: a free one. `log` is told what a person at the shell should know.
    ///
    /// # Errors
    ///
    /// `Taken`, `System`.
    pub fn open(port: u16, log: Log) -> Result<Self, ConsoleError> {
        let taken = |source| ConsoleError::Taken { port, source };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(taken)?;
        listener.set_nonblocking(true)?;
        let at = listener.local_addr()?;
        let (pens, orders, inbox) = channels();
        let (line, lines) = sync_channel(LINES);
        let board = Arc::new(Board::new(Token::random()?, line, pens, orders));
        Ok(Self { listener, at, board, inbox, log, lines })
    }

    /// The address to open; whoever has it controls.
    #[must_use]
    pub fn address(&self) -> String {
        format!("http://{}/#{}", self.at, self.board.token.text())
    }

    /// Where it listens.
    #[must_use]
    pub const fn at(&self) -> SocketAddr {
        self.at
    }

    /// Serves pages until `over` says so.
    ///
    /// # Errors
    ///
    /// `Link`, `LinkEnded`, `System`.
    pub fn run(self, link: Link, mut over: impl FnMut() -> bool) -> Result<Tally, ConsoleError> {
        let Self { listener, at, board, inbox, log, lines } = self;
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
        let hosts = Arc::new(Hosts::of(at));
        let count = Arc::new(AtomicU64::new(0));
        let mut failed = None;
        while !over() && failed.is_none() {
            match listener.accept() {
                Ok((stream, peer)) => {
                    let id = count.fetch_add(1, Ordering::Relaxed) + 1;
                    welcome(board.clone(), hosts.clone(), stream, peer, id);
                }
                // Also where no descriptor is left: some connection ends.
                Err(_) => std::thread::sleep(KNOCKS_EVERY),
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
            std::thread::sleep(KNOCKS_EVERY);
        }
        failed.map_or_else(|| Ok(board.tally()), Err)
    }
}

/// A thread that could not be started ends those that were.
fn ending<T>(board: &Board, started: std::io::Result<T>) -> std::io::Result<T> {
    started.inspect_err(|_| board.finish())
}

/// The thread that tells: a terminal may block it for as long as it likes.
fn logging(board: Arc<Board>, log: Log, lines: Receiver<String>) -> std::io::Result<JoinHandle<()>> {
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
fn welcome(board: Arc<Board>, hosts: Arc<Hosts>, mut stream: TcpStream, peer: SocketAddr, id: u64) {
    let timeouts = stream
        .set_nonblocking(false)
        .and_then(|()| stream.set_read_timeout(Some(WAIT)))
        .and_then(|()| stream.set_write_timeout(Some(ANSWER)));
    if timeouts.is_err() {
        return;
    }
    if !board.enter(CONNECTIONS) {
        board.refuse("too many connections");
        // A short answer fits into the socket's own buffer.
        let _ = http::answer(&mut stream, "503 Service Unavailable", "text/plain", b"too many connections\n");
        return;
    }
    let inside = board.clone();
    let serves = move || {
        admit(&inside, &hosts, stream, peer, id);
        inside.leave();
    };
    if std::thread::Builder::new().name("console-page".to_owned()).spawn(serves).is_err() {
        board.refuse("no thread");
        board.leave();
    }
}

/// Reads the request and answers it, or makes the connection a page's.
fn admit(board: &Arc<Board>, hosts: &Hosts, mut stream: TcpStream, peer: SocketAddr, id: u64) {
    let refuse = |stream: &mut TcpStream, status: &str, reason: &'static str| {
        board.refuse(reason);
        // It need not read the reason.
        let _ = http::answer(stream, status, "text/plain; charset=utf-8", format!("{reason}\n").as_bytes());
    };
    let head = match Head::read(&mut stream) {
        Ok(head) => head,
        Err(error) => return refuse(&mut stream, "400 Bad Request", error.label()),
    };
    if !head.only("host").is_some_and(|host| hosts.knows(host)) {
        return refuse(&mut stream, "403 Forbidden", "foreign host");
    }
    if head.method != "GET" {
        return refuse(&mut stream, "405 Method Not Allowed", "another method than GET");
    }
    if head.path != "/socket" {
        return match page::file(&head.path) {
            // A browser that goes away meanwhile is no failure.
            Some(file) => drop(http::answer(&mut stream, "200 OK", file.kind, file.body)),
            None => refuse(&mut stream, "404 Not Found", "no such file"),
        };
    }
    if !head.only("origin").is_some_and(|origin| hosts.own(origin)) {
        return refuse(&mut stream, "403 Forbidden", "foreign origin");
    }
    let Some(key) = head.socket_key() else {
        return refuse(&mut stream, "400 Bad Request", "no WebSocket of version 13");
    };
    if http::upgrade(&mut stream, key).is_err() {
        return;
    }
    board.count(|tally| tally.pages += 1);
    session::serve(board, stream, id, &peer.to_string());
}
