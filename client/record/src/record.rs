//! From a running daemon into files: one loop listens, one thread writes.
//!
//! Contract: listening never waits for the disk. Between the two stands a bounded queue; what finds no room
//! there, what shared memory overwrote and what was refused is counted, once a second in the file too. A file
//! that has grown beyond its bound is ended and followed by the next, with a start of its own.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use foretrace_client::monotonic_now_ns;
use foretrace_shm::{Piece, PieceKind, Status, Thing, TickInput, TickRecord, Wire};

use crate::RecordError;
use crate::proto::{Value, encode};
use crate::repair::numbered;
use crate::source::{Heard, News, Source};
use crate::topics::{RECORDER, Topic, frames, log, thing_bytes, tick};
use crate::write::{Facts, Output, part_of};

/// Messages that may wait for the disk: four seconds at 500 Hz.
const QUEUE: usize = 4096;
/// Work that a killed recorder loses at most, beside what waits in the queue.
const FLUSH: Duration = Duration::from_millis(250);
/// Between two messages about the recorder itself.
const TELL: Duration = Duration::from_secs(1);
/// A start that has not come whole after this time is asked for again.
const PATIENCE: Duration = Duration::from_secs(2);

/// Where to record.
#[derive(Debug, Clone)]
pub struct Options {
    /// The first file; later ones have a number before the extension.
    pub target: PathBuf,
    /// Bytes of messages in a file; `None`: one file.
    pub max_bytes: Option<u64>,
    /// Files that are kept, the newest ones; `None`: all.
    pub max_files: Option<usize>,
    /// What the files say about themselves.
    pub facts: Facts,
}

/// What was recorded, and what was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Counts {
    /// Ticks of which the input is there.
    pub inputs: u64,
    /// Tick records.
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

impl Counts {
    /// Inputs and tick records that are not in the file, by whatever way.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.queue_lost + self.inputs_lost + self.ticks_lost
    }
}

enum Job {
    Input(Box<TickInput>),
    Tick(Box<TickRecord>),
    Status(Box<Status>),
    Thing(Thing),
    Counts(Counts),
}

/// What listener and writer share.
#[derive(Debug, Default)]
struct Shared {
    /// A new file needs a start of its own.
    renew: AtomicBool,
    written: AtomicU64,
}

/// Records a daemon.
#[derive(Debug)]
pub struct Recorder {
    jobs: Option<SyncSender<Job>>,
    thread: Option<JoinHandle<Result<Vec<PathBuf>, RecordError>>>,
    shared: Arc<Shared>,
    source: Source,
    counts: Counts,
    told: Instant,
    start: Start,
}

/// The settings, weights and state that a file begins with.
#[derive(Debug)]
struct Start {
    /// When it was asked for.
    since: Instant,
    /// The state has come.
    came: bool,
    /// Times that it was asked for in vain.
    tries: u32,
    /// It could not even be asked for; told already.
    deaf: bool,
}

impl Start {
    fn due() -> Self {
        Self { since: Instant::now(), came: false, tries: 0, deaf: false }
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
    pub fn start(source: Source, options: Options) -> Result<Self, RecordError> {
        let output = Output::create(&options.target, &options.facts)?;
        let (jobs, due) = sync_channel(QUEUE);
        let shared = Arc::new(Shared::default());
        let writer = FileWriter {
            output,
            options,
            shared: shared.clone(),
            finished: Vec::new(),
            number: 1,
            last: Counts::default(),
            flushed: Instant::now(),
            clock: unix_minus_monotonic(),
        };
        let thread = std::thread::Builder::new()
            .name("foretrace-write".to_owned())
            .spawn(move || writer.run(&due))
            .map_err(|error| RecordError::Thread(error.to_string()))?;
        Ok(Self {
            jobs: Some(jobs),
            thread: Some(thread),
            shared,
            source,
            counts: Counts::default(),
            told: Instant::now(),
            start: Start::due(),
        })
    }

    /// Takes what has come; returns what changed. Call this every few milliseconds.
    pub fn hear(&mut self) -> Option<News> {
        let news = self.take();
        if self.told.elapsed() >= TELL {
            self.told = Instant::now();
            let counts = self.counts();
            if let Some(jobs) = &self.jobs {
                // The next one, a second later, has all counts too.
                let _ = jobs.try_send(Job::Counts(counts));
            }
        }
        if matches!(news, Some(News::Renewed | News::Elsewhere)) {
            self.start = Start::due();
        }
        let renewed = self.shared.renew.swap(false, Ordering::AcqRel);
        if !renewed && !self.start.is_late() {
            return news;
        }
        self.start = Start {
            since: Instant::now(),
            came: false,
            tries: if renewed { 0 } else { self.start.tries + 1 },
            deaf: self.start.deaf,
        };
        match self.source.start_again() {
            Ok(()) => self.start.deaf = false,
            Err(error) if !std::mem::replace(&mut self.start.deaf, true) => {
                return news.or(Some(News::Deaf(error)));
            }
            Err(_) => {}
        }
        news
    }

    /// Takes what has come.
    fn take(&mut self) -> Option<News> {
        let Some(jobs) = &self.jobs else { return None };
        let (counts, start) = (&mut self.counts, &mut self.start);
        let (mut lost, mut told) = (0, 0);
        let mut send = |job: Job, count: &mut u64| match jobs.try_send(job) {
            Ok(()) => *count += 1,
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => lost += 1,
        };
        let news = self.source.hear(|heard| match heard {
            Heard::Tick(record) => send(Job::Tick(record), &mut counts.ticks),
            Heard::Input(input) => send(Job::Input(input), &mut counts.inputs),
            Heard::Status(status) => send(Job::Status(status), &mut told),
            Heard::Thing(thing) => {
                if thing.kind == PieceKind::State {
                    counts.states += 1;
                    start.came = true;
                }
                send(Job::Thing(thing), &mut counts.things);
            }
        });
        self.counts.queue_lost += lost;
        news
    }

    /// Counts so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let lost = self.source.lost();
        Counts {
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

    /// Ends the recording; returns its files and what is in them.
    ///
    /// # Errors
    ///
    /// The disk refused; what was written until then is in the part.
    pub fn finish(mut self) -> Result<(Vec<PathBuf>, Counts), RecordError> {
        self.hear();
        let counts = self.counts();
        if let Some(jobs) = self.jobs.take() {
            let _ = jobs.send(Job::Counts(counts));
        }
        let thread = self.thread.take().map(JoinHandle::join);
        match thread {
            Some(Ok(files)) => files.map(|files| (files, counts)),
            _ => Err(RecordError::Thread("it ended by a fault".to_owned())),
        }
    }
}

/// The writing thread.
struct FileWriter {
    output: Output,
    options: Options,
    shared: Arc<Shared>,
    finished: Vec<PathBuf>,
    number: usize,
    last: Counts,
    flushed: Instant,
    /// From the monotonic clock to the time since 1970 \[ns\].
    clock: u64,
}

impl FileWriter {
    fn run(mut self, due: &Receiver<Job>) -> Result<Vec<PathBuf>, RecordError> {
        loop {
            match due.recv_timeout(Duration::from_millis(50)) {
                Ok(job) => self.write(job)?,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if self.flushed.elapsed() >= FLUSH {
                self.flushed = Instant::now();
                self.output.flush()?;
                self.turn_over()?;
            }
        }
        let Self { output, mut finished, last, .. } = self;
        finished.push(output.finish(&told(&last))?);
        Ok(finished)
    }

    fn write(&mut self, job: Job) -> Result<(), RecordError> {
        let output = &mut self.output;
        let at = |stamp_ns: u64| stamp_ns.wrapping_add(self.clock);
        let mut bytes = Vec::new();
        match job {
            Job::Input(input) => put_input(output, at(input.header.stamp_ns), &input)?,
            Job::Tick(record) => put_tick(output, at(record.header.stamp_ns), &record)?,
            Job::Status(status) => {
                status.put(&mut bytes);
                output.put(Topic::StatusRaw, at(status.header.stamp_ns), &bytes)?;
            }
            Job::Thing(thing) => output.put(Topic::Thing, at(monotonic_now_ns()), &thing_bytes(&thing))?,
            Job::Counts(counts) => {
                self.last = counts;
                let values = [
                    Value::U64(output.written()),
                    Value::U64(counts.queue_lost),
                    Value::U64(counts.inputs_lost),
                    Value::U64(counts.ticks_lost),
                    Value::U64(counts.things_broken),
                    Value::U64(counts.refused),
                ];
                let counts = encode(&RECORDER, &values).unwrap_or_default();
                output.put(Topic::Recorder, at(monotonic_now_ns()), &counts)?;
            }
        }
        self.shared.written.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    /// Ends a file that is large enough, and begins the next.
    fn turn_over(&mut self) -> Result<(), RecordError> {
        if self.options.max_bytes.is_none_or(|most| self.output.bytes() < most) {
            return Ok(());
        }
        // An earlier recording may have some of the numbers.
        let next = loop {
            self.number += 1;
            let next = numbered(&self.options.target, &self.number.to_string());
            if !next.exists() && !part_of(&next).exists() {
                break Output::create(&next, &self.options.facts)?;
            }
        };
        let full = std::mem::replace(&mut self.output, next);
        self.finished.push(full.finish(&told(&self.last))?);
        self.shared.renew.store(true, Ordering::Release);
        if let Some(kept) = self.options.max_files {
            while self.finished.len() + 1 > kept.max(1) {
                let oldest = self.finished.remove(0);
                std::fs::remove_file(&oldest)
                    .map_err(|source| RecordError::Write { path: oldest.clone(), source })?;
            }
        }
        Ok(())
    }
}

/// Writes one input at `time_ns` since 1970.
pub(crate) fn put_input(output: &mut Output, time_ns: u64, input: &TickInput) -> Result<(), RecordError> {
    let mut bytes = Vec::new();
    input.put(&mut bytes);
    output.put(Topic::Input, time_ns, &bytes)
}

/// Writes one tick record in all its encodings at `time_ns` since 1970.
pub(crate) fn put_tick(output: &mut Output, time_ns: u64, record: &TickRecord) -> Result<(), RecordError> {
    let mut bytes = Vec::new();
    record.put(&mut bytes);
    output.put(Topic::TickRaw, time_ns, &bytes)?;
    output.put(Topic::Tick, time_ns, &tick(record))?;
    frames(record, time_ns).iter().try_for_each(|frame| output.put(Topic::Frames, time_ns, frame))?;
    let before = output.follow(record);
    let lines = before.map_or_else(Vec::new, |before| log(&before, record, time_ns));
    lines.iter().try_for_each(|line| output.put(Topic::Log, time_ns, line))
}

/// Counts as facts at the end of a file.
fn told(counts: &Counts) -> Facts {
    let all = [
        ("inputs", counts.inputs),
        ("ticks", counts.ticks),
        ("things", counts.things),
        ("states", counts.states),
        ("queue_lost", counts.queue_lost),
        ("inputs_lost", counts.inputs_lost),
        ("ticks_lost", counts.ticks_lost),
        ("things_broken", counts.things_broken),
        ("refused", counts.refused),
    ];
    all.iter().map(|(key, count)| ((*key).to_owned(), count.to_string())).collect()
}

/// What to add to a stamp of the monotonic clock for the time since 1970 \[ns\].
#[must_use]
pub fn unix_minus_monotonic() -> u64 {
    let unix = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(unix.as_nanos()).unwrap_or(0).wrapping_sub(monotonic_now_ns())
}

/// A piece at a time is enough: the largest thing has some hundred.
const _: () = assert!(size_of::<Piece>() < 8192);
