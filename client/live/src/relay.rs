//! The relay: one process that listens to a daemon for any number of recorders, viewers and metrics.
//!
//! Contract: one loop without a wait for anybody. Each listener has a queue of its own with a bound in
//! messages and bytes; where there is no room the oldest message goes, and is counted. A listener that takes
//! nothing for ten seconds, or says what no listener says, is let go. Only the user of the instance can
//! connect: the socket lies in the run directory.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Seek as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use foretrace_client::Instance;
use foretrace_serve::http::waits;

use crate::LiveError;
use crate::source::frame::{
    FrameInbox, ListenerMessage, LossCounts, asked, counts_frame, frame_of, framed, hello, kind,
};
use crate::source::remote::relay_socket;
use crate::source::{LiveSource, SourceNews, Wants};

/// Listeners at a time.
const LISTENERS: usize = 64;
/// Messages that wait for one listener at most: four seconds of ticks and inputs at 500 Hz.
const QUEUE: usize = 4096;
/// Bytes of them: what waits is shared by all listeners, but one that hangs keeps it alive.
const QUEUE_BYTES: usize = 16 << 20;
/// A listener that takes nothing for this long is let go.
const STUCK: Duration = Duration::from_secs(10);
/// A new listener has to say what it wants in this time.
const HELLO_TIMEOUT: Duration = Duration::from_secs(2);
/// Between two counts, which also say that the relay lives.
const TELL: Duration = Duration::from_secs(1);
/// Between two starts asked of the daemon, whoever wants one.
const STARTS_EVERY: Duration = Duration::from_millis(250);

/// What a relay did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct RelayTally {
    pub listeners: u64,
    pub admitted: u64,
    /// Listeners that were turned away or let go: too many, silent, stuck, or not of this protocol.
    pub refused: u64,
    /// Messages passed on, once per listener.
    pub passed: u64,
    /// Messages that found no room in the queue of a listener.
    pub dropped: u64,
}

#[derive(Debug)]
pub struct Relay {
    source: LiveSource,
    listener: UnixListener,
    path: PathBuf,
    /// Held as long as this lives.
    _lock: File,
    listeners: Vec<RelayListener>,
    tally: RelayTally,
    told: Instant,
    /// Somebody wants a start.
    wanted: bool,
    started: Instant,
}

impl Relay {
    /// Takes the slots and begins to listen for listeners.
    ///
    /// # Errors
    ///
    /// No daemon; no slot; another relay; the socket cannot be made.
    pub fn open(instance: &Instance) -> Result<Self, LiveError> {
        let path = relay_socket(instance);
        let refused = |why: io::Error| LiveError::NoRelay { path: path.clone(), why: why.to_string() };
        // Says first that there is no daemon, where there is not even a folder.
        let source = LiveSource::open_direct(instance, Wants::ALL)?;
        let lock = locked(instance.root().join("relay.lock"))?;
        // Under the lock: what is there is left over.
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(refused(error)),
            _ => {}
        }
        let listener = UnixListener::bind(&path).map_err(refused)?;
        listener.set_nonblocking(true).map_err(refused)?;
        let now = Instant::now();
        Ok(Self {
            source,
            listener,
            path: path.clone(),
            _lock: lock,
            listeners: Vec::new(),
            tally: RelayTally::default(),
            told: now,
            wanted: false,
            started: now,
        })
    }

    #[must_use]
    pub const fn path(&self) -> &PathBuf {
        &self.path
    }

    #[must_use]
    pub fn tally(&self) -> RelayTally {
        RelayTally { listeners: self.listeners.len() as u64, ..self.tally }
    }

    /// Takes what has come and passes it on; returns what changed. Call this every few milliseconds.
    pub fn turn(&mut self) -> Option<SourceNews> {
        self.admit();
        let Self { source, listeners, tally, .. } = self;
        let mut news = source.hear(|heard| {
            let (kind, frame) = frame_of(&heard);
            for listener in &mut *listeners {
                if listener.wants_kind(kind) {
                    tally.passed += 1;
                    tally.dropped += listener.push(kind, frame.clone());
                }
            }
        });
        if self.told.elapsed() >= TELL {
            self.told = Instant::now();
            let lost = self.source.lost();
            for listener in self.listeners.iter_mut().filter(|listener| listener.wants.is_some()) {
                let counts =
                    LossCounts { refused: lost.refused, broken: lost.things + listener.things_dropped };
                listener.push(kind::COUNTS, counts_frame(counts));
            }
        }
        let (mut wanted, mut refused) = (false, 0);
        self.listeners.retain_mut(|listener| match listener.turn(&mut wanted) {
            Ok(()) => true,
            Err(end) => {
                refused += u64::from(end == ListenerEnd::Refused);
                false
            }
        });
        self.tally.refused += refused;
        self.wanted |= wanted;
        if self.wanted && self.started.elapsed() >= STARTS_EVERY {
            self.started = Instant::now();
            match self.source.start_again() {
                Ok(()) => self.wanted = false,
                Err(report) => news = news.or(report),
            }
        }
        news
    }

    fn admit(&mut self) {
        // No more at once than there may be: the loop goes on.
        for _ in 0..LISTENERS {
            let Ok((stream, _)) = self.listener.accept() else { return };
            if self.listeners.len() >= LISTENERS || stream.set_nonblocking(true).is_err() {
                self.tally.refused += 1;
                continue;
            }
            self.tally.admitted += 1;
            self.listeners.push(RelayListener::new(stream));
        }
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        // The next one would remove it too.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// The lock of the only relay, signed with this process's number.
fn locked(path: PathBuf) -> Result<File, LiveError> {
    let no_relay = |why: String| LiveError::NoRelay { path: path.clone(), why };
    let mut options = OpenOptions::new();
    let options = options.read(true).write(true).create(true).truncate(false).mode(0o600);
    let mut file = options.open(&path).map_err(|error| no_relay(error.to_string()))?;
    match file.try_lock() {
        Ok(()) => {}
        Err(std::fs::TryLockError::WouldBlock) => {
            let mut holder = String::new();
            // What stands there is for the message only.
            let _ = (&file).take(20).read_to_string(&mut holder);
            let who =
                if holder.is_empty() { "another process".to_owned() } else { format!("process {holder}") };
            return Err(no_relay(format!(
                "{who} is the relay of this instance already; programs find it by themselves, one is enough"
            )));
        }
        Err(std::fs::TryLockError::Error(error)) => return Err(no_relay(error.to_string())),
    }
    let signed = file
        .set_len(0)
        .and_then(|()| file.rewind())
        .and_then(|()| file.write_all(std::process::id().to_string().as_bytes()));
    signed.map_err(|error| no_relay(error.to_string()))?;
    Ok(file)
}

/// How a listener ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ListenerEnd {
    Left,
    /// It was let go.
    Refused,
}

#[derive(Debug)]
struct RelayListener {
    stream: UnixStream,
    inbox: FrameInbox,
    wants: Option<Wants>,
    queue: VecDeque<(u32, Arc<[u8]>)>,
    bytes: usize,
    /// Bytes of the first message that are on their way.
    sent: usize,
    things_dropped: u64,
    /// When it last took something, or had nothing to take.
    took: Instant,
}

impl RelayListener {
    fn new(stream: UnixStream) -> Self {
        let mut listener = Self {
            stream,
            inbox: FrameInbox::of_listener(),
            wants: None,
            queue: VecDeque::new(),
            bytes: 0,
            sent: 0,
            things_dropped: 0,
            took: Instant::now(),
        };
        listener.push(kind::HELLO, framed(kind::HELLO, &hello()));
        listener
    }

    fn wants_kind(&self, kind: u32) -> bool {
        self.wants.is_some_and(|wants| match kind {
            kind::TICK => wants.ticks,
            kind::INPUT | kind::THING => wants.inputs,
            _ => true,
        })
    }

    /// Puts a message behind those that wait; returns how many had to go for it.
    fn push(&mut self, kind: u32, frame: Arc<[u8]>) -> u64 {
        self.bytes += frame.len();
        self.queue.push_back((kind, frame));
        let mut dropped = 0;
        while self.queue.len() > QUEUE || self.bytes > QUEUE_BYTES {
            // The first one may be half on its way.
            let Some((kind, frame)) = self.queue.remove(usize::from(self.sent > 0)) else { break };
            self.bytes -= frame.len();
            self.things_dropped += u64::from(kind == kind::THING);
            dropped += 1;
        }
        dropped
    }

    /// Reads what it asks for and writes what it takes.
    fn turn(&mut self, wanted: &mut bool) -> Result<(), ListenerEnd> {
        let gone = self.inbox.fill(&mut self.stream).is_err();
        while let Some((kind, body)) = self.inbox.next_frame().map_err(|_| ListenerEnd::Refused)? {
            match asked(kind, body) {
                Some(ListenerMessage::Wants(wants)) if self.wants.is_none() => {
                    self.wants = Some(wants);
                    *wanted |= wants.inputs;
                }
                Some(ListenerMessage::Again) if self.wants.is_some_and(|wants| wants.inputs) => {
                    *wanted = true
                }
                _ => return Err(ListenerEnd::Refused),
            }
        }
        if gone {
            return Err(ListenerEnd::Left);
        }
        while let Some((_, frame)) = self.queue.front() {
            match self.stream.write(frame.get(self.sent..).unwrap_or_default()) {
                Ok(count) => {
                    self.took = Instant::now();
                    self.sent += count;
                    if self.sent >= frame.len() {
                        self.bytes -= frame.len();
                        (self.sent, _) = (0, self.queue.pop_front());
                    }
                }
                Err(error) if waits(&error) => break,
                Err(_) => return Err(ListenerEnd::Left),
            }
        }
        if self.queue.is_empty() && self.wants.is_some() {
            self.took = Instant::now();
        }
        let patience = if self.wants.is_some() { STUCK } else { HELLO_TIMEOUT };
        if self.took.elapsed() > patience { Err(ListenerEnd::Refused) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::SourceMessage;
    use crate::source::frame::{RelayMessage, said, wants_frame};

    fn admitted() -> (UnixStream, RelayListener) {
        let (mut end, stream) = UnixStream::pair().unwrap();
        stream.set_nonblocking(true).unwrap();
        end.write_all(&wants_frame(Wants::ALL)).unwrap();
        let (mut listener, mut wanted) = (RelayListener::new(stream), false);
        listener.turn(&mut wanted).unwrap();
        assert!(wanted, "whoever begins needs a start");
        (end, listener)
    }

    #[test]
    fn a_listener_that_does_not_read_keeps_the_newest_messages_within_a_bound() {
        let (mut end, mut listener) = admitted();
        let mut tick = foretrace_shm::TickRecord::default();
        let (mut dropped, mut wanted) = (0, false);
        for number in 1..=3 * QUEUE as u64 {
            tick.tick = number;
            let (kind, frame) = frame_of(&SourceMessage::Tick(Box::new(tick)));
            dropped += listener.push(kind, frame);
            listener.turn(&mut wanted).unwrap();
        }
        assert!(listener.queue.len() <= QUEUE && listener.bytes <= QUEUE_BYTES);
        // Then it reads all: whole frames, in order, the newest at the end, and as many as were not dropped.
        end.set_nonblocking(true).unwrap();
        let (mut inbox, mut seen) = (FrameInbox::of_relay(), Vec::new());
        while !listener.queue.is_empty() {
            listener.turn(&mut wanted).unwrap();
            inbox.fill(&mut end).unwrap();
            while let Some((kind, body)) = inbox.next_frame().unwrap() {
                if let Some(RelayMessage::Heard(SourceMessage::Tick(tick))) = said(kind, body) {
                    seen.push(tick.tick);
                }
            }
        }
        assert!(seen.is_sorted() && seen.last() == Some(&(3 * QUEUE as u64)), "{:?}", seen.last());
        assert!(dropped > 0);
        assert_eq!(seen.len() as u64 + dropped, 3 * QUEUE as u64);
    }

    #[test]
    fn things_that_were_dropped_are_reported_and_other_peers_are_let_go() {
        let (_end, mut listener) = admitted();
        let thing = vec![0; 6 << 20];
        let dropped: u64 = (0..3).map(|_| listener.push(kind::THING, framed(kind::THING, &thing))).sum();
        assert_eq!((dropped, listener.things_dropped), (1, 1), "the hello is read, two things fit");
        let mut wanted = false;
        for wrong in [&framed(kind::TICK, &[]), &framed(kind::WANTS, &[1, 1]), &framed(kind::AGAIN, &[0; 64])]
        {
            let (mut end, mut listener) = admitted();
            end.write_all(wrong).unwrap();
            assert_eq!(listener.turn(&mut wanted), Err(ListenerEnd::Refused), "{wrong:?}");
        }
        let (end, mut listener) = admitted();
        drop(end);
        assert_eq!(listener.turn(&mut wanted), Err(ListenerEnd::Left));
    }
}
