//! The flight recorder: the last seconds of a running daemon in memory, written when something goes wrong.
//!
//! Contract: memory is bounded by the time that is kept. What is written can be replayed: a state of the law
//! is asked for again and again, and inputs are kept from the newest state that is old enough. Files are few
//! (the oldest goes) and far between; what that suppressed is counted.

mod memory;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use foretrace_shm::{Mode, Rung, TickRecord, health};
use serde::Serialize;

use crate::recorder::WEIGHTS_PATIENCE;
use crate::source::{LiveSource, SourceMessage, SourceNews};
use foretrace_record::write::{FileFacts, Output, part_of};
use foretrace_record::{RecordError, whole};
use memory::FlightMemory;

/// Seconds after a trigger that are written too.
const AFTER: Duration = Duration::from_secs(1);

/// What a flight recorder does.
#[derive(Debug, Clone)]
pub struct FlightOptions {
    /// Folder of the files.
    pub folder: PathBuf,
    /// Time before a trigger that is written.
    pub keep: Duration,
    /// Shortest time between two files; stops and requests do not wait.
    pub apart: Duration,
    /// Files that are kept, the newest ones.
    pub max_files: usize,
    /// What the files say about themselves.
    pub facts: FileFacts,
}

/// Why a file was written; of two, the first one matters more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Trigger {
    Stop,
    /// A tick ended after its deadline.
    Overrun,
    /// The loop began to follow the pen without a plan of its own.
    PlanFailed,
    Request,
}

impl Trigger {
    /// A word for file names and people.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Stop => "stop",
            Self::Overrun => "overrun",
            Self::PlanFailed => "plan-failed",
            Self::Request => "request",
        }
    }

    /// The trigger of this word.
    #[must_use]
    pub fn from_word(word: &str) -> Option<Self> {
        [Self::Stop, Self::Overrun, Self::PlanFailed, Self::Request].into_iter().find(|t| t.word() == word)
    }

    /// What `record` shows that `before` did not.
    fn of(before: Option<&TickRecord>, record: &TickRecord) -> Option<Self> {
        let stopped =
            |tick: &TickRecord| tick.mode == u32::from(Mode::Stopped) || tick.mode == u32::from(Mode::Fault);
        let follows_without = |tick: &TickRecord| {
            tick.mode == u32::from(Mode::Following) && tick.rung != u32::from(Rung::FreshPlan)
        };
        let before = before?;
        if stopped(record) && !stopped(before) {
            Some(Self::Stop)
        } else if record.health & health::OVERRUN != 0 {
            Some(Self::Overrun)
        } else if follows_without(record) && !follows_without(before) {
            Some(Self::PlanFailed)
        } else {
            None
        }
    }
}

/// A file that was written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FlightFile {
    pub recording: PathBuf,
    /// The same as a Perfetto trace.
    pub trace: PathBuf,
    pub trigger: Trigger,
    pub ticks: u64,
}

#[derive(Debug)]
pub struct Flight {
    options: FlightOptions,
    source: LiveSource,
    /// When a state was asked for.
    since: Instant,
    memory: FlightMemory,
    due: Option<(Instant, Trigger)>,
    /// Somebody asked while a file was due.
    asked: bool,
    last: Option<Instant>,
    suppressed: u64,
    /// Recordings in the folder, oldest first, those of earlier recorders too.
    files: VecDeque<PathBuf>,
}

impl Flight {
    /// Begins to keep what `source` hears; it must want everything.
    ///
    /// # Errors
    ///
    /// The folder cannot be made or read.
    pub fn start(source: LiveSource, options: FlightOptions) -> Result<Self, RecordError> {
        std::fs::create_dir_all(&options.folder)
            .map_err(|source| RecordError::Write { path: options.folder.clone(), source })?;
        let files = earlier(&options.folder)
            .map_err(|source| RecordError::Read { path: options.folder.clone(), source })?;
        Ok(Self {
            source,
            since: Instant::now(),
            options,
            memory: FlightMemory::default(),
            due: None,
            asked: false,
            last: None,
            suppressed: 0,
            files,
        })
    }

    /// Somebody asks for a file.
    pub fn ask(&mut self) {
        self.trigger(Trigger::Request);
    }

    /// Triggers that came too soon after a file.
    #[must_use]
    pub const fn suppressed(&self) -> u64 {
        self.suppressed
    }

    fn trigger(&mut self, trigger: Trigger) {
        if let Some((_, due)) = &mut self.due {
            // Nobody who asks is forgotten, and a stop is not a detail of what led to it.
            self.asked |= trigger == Trigger::Request || (*due == Trigger::Request && trigger < *due);
            *due = (*due).min(trigger);
            return;
        }
        // Who asks has a reason, and nothing matters more than a stop.
        let soon = self.last.is_some_and(|last| last.elapsed() < self.options.apart);
        if soon && !matches!(trigger, Trigger::Request | Trigger::Stop) {
            self.suppressed += 1;
            return;
        }
        self.due = Some((Instant::now() + AFTER, trigger));
    }

    /// Takes what has come; returns the file that was written, if one was due. `tell` gets what changed.
    /// Call this every few milliseconds.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn hear(&mut self, mut tell: impl FnMut(SourceNews)) -> Result<Option<FlightFile>, RecordError> {
        if let Some(trigger) = self.take(&mut tell) {
            self.trigger(trigger);
        }
        if let Some((at, trigger)) = self.due
            && Instant::now() >= if self.memory.lacks_weights() { at + WEIGHTS_PATIENCE } else { at }
        {
            self.due = std::mem::take(&mut self.asked).then(|| (Instant::now(), Trigger::Request));
            let written = self.write(trigger)?;
            self.last = Some(Instant::now());
            return Ok(Some(written));
        }
        // Whoever begins to listen gets a state.
        if self.since.elapsed() > self.options.keep / 2 {
            self.since = Instant::now();
            self.source.start_again().err().flatten().into_iter().for_each(tell);
        }
        Ok(None)
    }

    /// Takes in what has come; returns what of it asks for a file.
    fn take(&mut self, tell: &mut impl FnMut(SourceNews)) -> Option<Trigger> {
        let memory = &mut self.memory;
        let mut found = None;
        let news = self.source.hear(|heard| match heard {
            SourceMessage::Tick(record) => {
                let new = Trigger::of(memory.ticks.back().map(|last| &**last), &record);
                found = found.into_iter().chain(new).min();
                memory.ticks.push_back(record);
            }
            SourceMessage::Input(input) => memory.input(input),
            SourceMessage::Thing(thing) => memory.thing(thing),
            SourceMessage::Status(_) => {}
        });
        memory.forget(u64::try_from(self.options.keep.as_nanos()).unwrap_or(u64::MAX));
        news.into_iter().for_each(tell);
        found
    }

    /// Writes what is in memory now.
    fn write(&mut self, trigger: Trigger) -> Result<FlightFile, RecordError> {
        let unix = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        let name = format!("flight-{}-{}", unix.as_millis(), trigger.word());
        let path_of = |extension: &str| self.options.folder.join(format!("{name}.{extension}"));
        let mut facts = self.options.facts.clone();
        facts.insert("trigger".to_owned(), trigger.word().to_owned());
        let recording = path_of("mcap");
        let part = part_of(&recording);
        let mut output = Output::create(&recording, &facts)?;
        let done = self.memory.write(&mut output).and_then(|()| output.finish(&self.told()));
        // Half a file helps nobody, and its room is needed.
        let recording = done.inspect_err(|_| drop(std::fs::remove_file(&part)))?;
        self.files.push_back(recording.clone());
        let trace = path_of("perfetto-trace");
        let pid = facts.get("daemon_pid").and_then(|pid| pid.parse().ok()).unwrap_or(0);
        whole(&trace, |file| self.memory.write_trace(pid, file, &trace))?;
        let ticks = self.memory.ticks.len() as u64;
        let written = FlightFile { recording, trace, trigger, ticks };
        while self.files.len() > self.options.max_files.max(1) {
            if let Some(old) = self.files.pop_front() {
                remove(&old)?;
                remove(&old.with_extension("perfetto-trace"))?;
            }
        }
        Ok(written)
    }

    /// What is missing, as facts at the end of a file.
    fn told(&self) -> FileFacts {
        let lost = self.source.lost();
        [("inputs_lost", lost.inputs), ("ticks_lost", lost.ticks), ("suppressed", self.suppressed)]
            .map(|(key, count)| (key.to_owned(), count.to_string()))
            .into()
    }
}

/// Recordings that earlier flight recorders left in `folder`, oldest first.
fn earlier(folder: &Path) -> std::io::Result<VecDeque<PathBuf>> {
    let mut found = Vec::new();
    for file in std::fs::read_dir(folder)? {
        let path = file?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let words = name.strip_prefix("flight-").and_then(|rest| rest.strip_suffix(".mcap"));
        let when = words.and_then(|words| words.split_once('-')).and_then(|(when, _)| when.parse().ok());
        if let Some(when) = when {
            let when: u128 = when;
            found.push((when, path));
        }
    }
    found.sort();
    Ok(found.into_iter().map(|(_, path)| path).collect())
}

/// Removes a file, unless somebody else has.
fn remove(path: &Path) -> Result<(), RecordError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(RecordError::Write { path: path.to_path_buf(), source })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triggers_are_stops_late_ticks_and_ticks_without_a_plan() {
        let following = TickRecord { mode: Mode::Following.into(), ..Default::default() };
        let of = |change: TickRecord| Trigger::of(Some(&following), &change);
        assert_eq!(of(following), None);
        assert_eq!(of(TickRecord { mode: Mode::Stopped.into(), ..following }), Some(Trigger::Stop));
        assert_eq!(of(TickRecord { health: health::OVERRUN, ..following }), Some(Trigger::Overrun));
        assert_eq!(of(TickRecord { rung: Rung::Stop.into(), ..following }), Some(Trigger::PlanFailed));
        let stopped = TickRecord { mode: Mode::Stopped.into(), ..following };
        assert_eq!(Trigger::of(Some(&stopped), &stopped), None);
        let without = TickRecord { rung: Rung::Hold.into(), ..following };
        assert_eq!(Trigger::of(Some(&without), &without), None, "a long failure is one");
    }

    #[test]
    fn files_of_earlier_recorders_are_known_in_order_and_others_are_left() {
        let folder = tempfile::TempDir::new().unwrap();
        for name in ["flight-20-stop.mcap", "flight-9-plan-failed.mcap", "mine.mcap", "flight-x.mcap"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let found = earlier(folder.path()).unwrap();
        assert_eq!(
            found,
            ["flight-9-plan-failed.mcap", "flight-20-stop.mcap"].map(|n| folder.path().join(n))
        );
    }
}
