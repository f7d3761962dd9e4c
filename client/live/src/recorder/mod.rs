//! From a running daemon into files: one loop listens, one thread writes.
//!
//! Contract: listening never waits for the disk. Between the two stands a bounded queue; what finds no room
//! there, what shared memory overwrote and what was refused is counted, once a second in the file too. A file
//! that has grown beyond its bound is ended and followed by the next, with a start of its own.

mod files;
mod offered;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foretrace_client::monotonic_now_ns;
use foretrace_shm::{Piece, PieceKind, Status, Thing, TickInput, TickRecord};

use crate::LiveError;
use crate::source::{LiveSource, Lost, SourceMessage, SourceNews};
use files::FileWriter;
pub(crate) use files::{put_input, put_thing, put_tick};
use foretrace_record::RecordError;
use foretrace_record::write::{FileFacts, Output};
pub(crate) use offered::{OfferedWeights, PATIENCE as WEIGHTS_PATIENCE};

/// Messages that may wait for the disk: four seconds at 500 Hz.
const QUEUE: usize = 4096;
/// Between two messages about the recorder itself.
const TELL: Duration = Duration::from_secs(1);
/// A start that has not come whole after this time is asked for again.
const PATIENCE: Duration = Duration::from_secs(2);

#[derive(Debug, Clone)]
pub struct RecorderOptions {
    /// The first file; later ones have a number before the extension.
    pub target: PathBuf,
    /// Bytes of messages in a file; `None`: one file.
    pub max_bytes: Option<u64>,
    /// Files that are kept, the newest ones; `None`: all.
    pub max_files: Option<usize>,
    /// What the files say about themselves.
    pub facts: FileFacts,
}

/// What was recorded, and what was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct RecordingCounts {
    /// Ticks of which the input is there.
    pub inputs: u64,
    pub ticks: u64,
    /// Settings, weights and states.
    pub things: u64,
    /// States, from which a replay can start.
    pub states: u64,
    /// Messages that found no room in the queue.
    pub queue_lost: u64,
    /// Inputs that shared memory overwrote, or the daemon could not send.
    pub inputs_lost: u64,
    /// Tick records that shared memory overwrote.
    pub ticks_lost: u64,
    /// Things of which a piece was lost.
    pub things_broken: u64,
    /// Messages that were refused.
    pub refused: u64,
}

impl RecordingCounts {
    /// Inputs and tick records that are not in the file, by whatever way.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.queue_lost + self.inputs_lost + self.ticks_lost
    }
}

enum WriteJob {
    Input(Box<TickInput>),
    Tick(Box<TickRecord>),
    Status(Box<Status>),
    Thing(Thing),
    Counts(RecordingCounts),
}

/// What listener and writer share.
#[derive(Debug, Default)]
struct WriterShared {
    /// A new file needs a start of its own.
    renew: AtomicBool,
    written: AtomicU64,
}

#[derive(Debug)]
pub struct Recorder {
    jobs: Option<SyncSender<WriteJob>>,
    thread: Option<JoinHandle<Result<Vec<PathBuf>, RecordError>>>,
    shared: Arc<WriterShared>,
    source: LiveSource,
    counts: RecordingCounts,
    told: Instant,
    start: RecordingStart,
    offered: OfferedWeights,
}

/// The settings, weights and state that a file begins with.
#[derive(Debug)]
struct RecordingStart {
    /// When it was asked for.
    since: Instant,
    /// The state has come.
    came: bool,
    /// Times that it was asked for in vain.
    tries: u32,
}

impl RecordingStart {
    fn due() -> Self {
        Self { since: Instant::now(), came: false, tries: 0 }
    }

    /// Whether to ask again. A law whose state cannot be written never sends one: longer and longer between
    /// tries.
    fn is_late(&self) -> bool {
        !self.came && self.since.elapsed() > PATIENCE * 2_u32.saturating_pow(self.tries)
    }
}

impl Recorder {
    /// Begins to record what `source` hears; it must want everything.
    ///
    /// # Errors
    ///
    /// The file exists or cannot be written.
    pub fn start(source: LiveSource, options: RecorderOptions) -> Result<Self, LiveError> {
        let output = Output::create(&options.target, &options.facts)?;
        let (jobs, due) = sync_channel(QUEUE);
        let shared = Arc::new(WriterShared::default());
        let writer = FileWriter::new(output, options, shared.clone());
        let thread = std::thread::Builder::new()
            .name("foretrace-write".to_owned())
            .spawn(move || writer.run(&due))
            .map_err(|error| LiveError::Thread(error.to_string()))?;
        Ok(Self {
            jobs: Some(jobs),
            thread: Some(thread),
            shared,
            source,
            counts: RecordingCounts::default(),
            told: Instant::now(),
            start: RecordingStart::due(),
            offered: OfferedWeights::default(),
        })
    }

    /// Takes what has come; returns what changed. Call this every few milliseconds.
    pub fn hear(&mut self) -> Option<SourceNews> {
        let news = self.take();
        if self.told.elapsed() >= TELL {
            self.told = Instant::now();
            let counts = self.counts();
            if let Some(jobs) = &self.jobs {
                // The next one, a second later, has all counts too.
                let _ = jobs.try_send(WriteJob::Counts(counts));
            }
        }
        if matches!(news, Some(SourceNews::Renewed | SourceNews::Elsewhere)) {
            self.start = RecordingStart::due();
        }
        let renewed = self.shared.renew.swap(false, Ordering::AcqRel);
        if !renewed && !self.start.is_late() {
            return news;
        }
        let tries = if renewed { 0 } else { self.start.tries + 1 };
        self.start = RecordingStart { tries, ..RecordingStart::due() };
        news.or(self.source.start_again().err().flatten())
    }

    /// Takes what has come.
    fn take(&mut self) -> Option<SourceNews> {
        let Some(jobs) = &self.jobs else { return None };
        let Self { source, counts, start, offered, .. } = self;
        let (mut lost, mut told) = (0, 0);
        let mut send = |job: WriteJob, count: &mut u64| pass(jobs, job, count, &mut lost);
        let news = source.hear(|heard| match heard {
            SourceMessage::Tick(record) => send(WriteJob::Tick(record), &mut counts.ticks),
            SourceMessage::Input(input) => {
                offered.input(&input);
                send(WriteJob::Input(input), &mut counts.inputs);
            }
            SourceMessage::Status(status) => send(WriteJob::Status(status), &mut told),
            SourceMessage::Thing(thing) => {
                offered.thing(&thing);
                if thing.kind == PieceKind::State {
                    counts.states += 1;
                    start.came = true;
                }
                send(WriteJob::Thing(thing), &mut counts.things);
            }
        });
        counts.queue_lost += lost;
        news
    }

    /// Takes the weights that the last ticks were offered, and settings; waits for them, but not for long.
    fn take_weights(&mut self) {
        let begin = Instant::now();
        while self.offered.is_due() && begin.elapsed() < WEIGHTS_PATIENCE && !self.has_failed() {
            std::thread::sleep(Duration::from_millis(2));
            let Some(jobs) = &self.jobs else { return };
            let Self { source, counts, offered, .. } = self;
            let mut lost = 0;
            source.hear(|heard| match heard {
                // A state of now has no ticks behind it.
                SourceMessage::Thing(thing) if thing.kind != PieceKind::State => {
                    offered.thing(&thing);
                    pass(jobs, WriteJob::Thing(thing), &mut counts.things, &mut lost);
                }
                _ => {}
            });
            counts.queue_lost += lost;
        }
    }

    #[must_use]
    pub fn counts(&self) -> RecordingCounts {
        let lost = self.source.lost();
        RecordingCounts {
            inputs_lost: lost.inputs,
            ticks_lost: lost.ticks,
            things_broken: lost.things,
            refused: lost.refused,
            ..self.counts
        }
    }

    /// Messages on the disk or on their way to it.
    #[must_use]
    pub fn written(&self) -> u64 {
        self.shared.written.load(Ordering::Relaxed)
    }

    /// The writer has ended by itself: [`Self::finish`] says why.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Ends the recording with the tick that has come last; returns its files and what is in them. Takes up
    /// to a fifth of a second more where the weights of that tick are still on their way: a thread that
    /// others wait for must not call this.
    ///
    /// # Errors
    ///
    /// The disk refused; what was written until then is in the part.
    pub fn finish(mut self) -> Result<(Vec<PathBuf>, RecordingCounts), LiveError> {
        self.take();
        // From here on ticks pass by that are not to be in the file.
        let Lost { inputs, ticks, refused, .. } = self.source.lost();
        self.take_weights();
        let counts = RecordingCounts { inputs_lost: inputs, ticks_lost: ticks, refused, ..self.counts() };
        if let Some(jobs) = self.jobs.take() {
            let _ = jobs.send(WriteJob::Counts(counts));
        }
        let thread = self.thread.take().map(JoinHandle::join);
        match thread {
            Some(Ok(files)) => Ok((files?, counts)),
            _ => Err(LiveError::Thread("it ended by a fault".to_owned())),
        }
    }
}

/// Passes `job` on; it counts as `sent`, or as `lost` where there is no room.
fn pass(jobs: &SyncSender<WriteJob>, job: WriteJob, sent: &mut u64, lost: &mut u64) {
    match jobs.try_send(job) {
        Ok(()) => *sent += 1,
        Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => *lost += 1,
    }
}

/// What to add to a stamp of the monotonic clock for the time since 1970 \[ns\].
#[must_use]
pub fn unix_minus_monotonic() -> u64 {
    let unix = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(unix.as_nanos()).unwrap_or(0).wrapping_sub(monotonic_now_ns())
}

/// A piece at a time is enough: the largest thing has some hundred.
const _: () = assert!(size_of::<Piece>() < 8192);

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;
    use std::os::unix::fs::PermissionsExt as _;
    use std::os::unix::net::{UnixListener, UnixStream};
    use std::sync::mpsc::{Sender, channel};

    use foretrace_client::Instance;
    use foretrace_shm::{Header, host_boot_id, input_flags};

    use crate::source::Wants;
    use crate::source::frame::{frame_of, framed, hello, kind};
    use crate::source::remote::relay_socket;
    use foretrace_record::read::{Content, RecordingEntry, RecordingReader};

    /// A recorder of a daemon that has sent ticks 1 to 6, of which the last one was offered weights 9; `more`
    /// is sent when the recording ends. Returns ticks and weights in the file, and the counts.
    fn ended(more: impl FnOnce(&mut UnixStream) + Send + 'static) -> (Vec<u64>, Vec<u64>, RecordingCounts) {
        let folder = tempfile::TempDir::new_in("/tmp").unwrap();
        std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o700)).unwrap();
        let instance = Instance::at(3, folder.path()).unwrap();
        let mut lock = instance.lock().unwrap();
        lock.announce().unwrap();
        let listener = UnixListener::bind(relay_socket(&instance)).unwrap();
        let (ends, ending): (Sender<()>, _) = channel();
        let relay = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            stream.write_all(&framed(kind::HELLO, &hello())).unwrap();
            (1..=6).for_each(|tick| send(&mut stream, SourceMessage::Input(input(tick))));
            ending.recv().unwrap();
            more(&mut stream);
            // The other end goes first.
            let _ = ending.recv();
        });
        let target = folder.path().join("run.mcap");
        let options = RecorderOptions {
            target: target.clone(),
            max_bytes: None,
            max_files: None,
            facts: FileFacts::default(),
        };
        let source = LiveSource::open(&instance, Wants::ALL).unwrap();
        let mut recorder = Recorder::start(source, options).unwrap();
        while recorder.counts().inputs < 6 {
            recorder.hear();
            std::thread::sleep(Duration::from_millis(1));
        }
        ends.send(()).unwrap();
        let (files, counts) = recorder.finish().unwrap();
        assert_eq!(files, std::slice::from_ref(&target));
        drop(ends);
        relay.join().unwrap();
        let (mut ticks, mut sets) = (Vec::new(), Vec::new());
        let mut reader = RecordingReader::open(&target).unwrap();
        while let Some(entry) = reader.next_entry().unwrap() {
            let RecordingEntry::Message(message) = entry else { continue };
            match reader.content(&message).unwrap() {
                Content::Input(input) => ticks.push(input.tick),
                Content::Thing(thing) => sets.push(thing.number),
                _ => {}
            }
        }
        (ticks, sets, counts)
    }

    fn send(stream: &mut UnixStream, heard: SourceMessage) {
        stream.write_all(&frame_of(&heard).1).unwrap();
    }

    fn input(tick: u64) -> Box<TickInput> {
        let header = Header { sequence: tick, stamp_ns: monotonic_now_ns(), boot_id: host_boot_id() };
        let flags = if tick == 6 { input_flags::WEIGHTS } else { 0 };
        Box::new(TickInput {
            header,
            tick,
            parts: 1,
            daemon_id: 1,
            flags,
            weights_version: 9 * u64::from(tick == 6),
            ..TickInput::default()
        })
    }

    #[test]
    fn a_recording_ends_with_its_last_tick_and_the_weights_that_it_was_offered() {
        let thing = |kind, number| SourceMessage::Thing(Thing { kind, number, daemon_id: 1, bytes: vec![7] });
        let (ticks, sets, counts) = ended(move |stream| {
            std::thread::sleep(Duration::from_millis(80));
            send(stream, SourceMessage::Input(input(7)));
            // Tick 8 is lost, which is no loss of this recording.
            send(stream, SourceMessage::Input(input(9)));
            send(stream, thing(PieceKind::State, 9));
            send(stream, thing(PieceKind::Weights, 9));
        });
        assert_eq!((ticks, sets), ((1..=6).collect(), vec![9]));
        assert_eq!((counts.inputs, counts.things, counts.lost()), (6, 1, 0), "{counts:?}");
    }

    #[test]
    fn a_recording_ends_also_if_the_weights_of_its_last_tick_never_come() {
        let (ticks, sets, counts) = ended(|_| {});
        assert_eq!((ticks.len(), sets.len(), counts.lost()), (6, 0, 0), "{counts:?}");
    }
}
