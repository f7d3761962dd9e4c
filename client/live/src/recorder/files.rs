//! The thread that writes: messages in, files out.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use foretrace_client::monotonic_now_ns;
use foretrace_shm::{PieceKind, Thing, TickInput, TickRecord, Wire};

use super::{
    OfferedWeights, RecorderOptions, RecordingCounts, WEIGHTS_PATIENCE, WriteJob, WriterShared,
    unix_minus_monotonic,
};
use foretrace_record::RecordError;
use foretrace_record::proto::{ProtoValue, encode};
use foretrace_record::repair::numbered;
use foretrace_record::scene::Scene;
use foretrace_record::topics::{RECORDER, RecordingTopic, frames, log, thing_bytes, tick, warning};
use foretrace_record::write::{FileFacts, Output, part_of};

/// Work that a killed recorder loses at most, beside what waits in the queue.
const FLUSH: Duration = Duration::from_millis(250);

pub(super) struct FileWriter {
    output: Output,
    options: RecorderOptions,
    shared: Arc<WriterShared>,
    finished: Vec<PathBuf>,
    number: usize,
    last: RecordingCounts,
    flushed: Instant,
    /// Weights that the ticks of the file need.
    offered: OfferedWeights,
    /// Since when the file is large enough.
    full_since: Option<Instant>,
    /// From the monotonic clock to the time since 1970 \[ns\].
    clock: u64,
}

impl FileWriter {
    pub(super) fn new(output: Output, options: RecorderOptions, shared: Arc<WriterShared>) -> Self {
        Self {
            output,
            options,
            shared,
            finished: Vec::new(),
            number: 1,
            last: RecordingCounts::default(),
            flushed: Instant::now(),
            offered: OfferedWeights::default(),
            full_since: None,
            clock: unix_minus_monotonic(),
        }
    }

    pub(super) fn run(mut self, due: &Receiver<WriteJob>) -> Result<Vec<PathBuf>, RecordError> {
        loop {
            match due.recv_timeout(Duration::from_millis(50)) {
                Ok(job) => self.write(job)?,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if self.flushed.elapsed() >= FLUSH {
                self.flushed = Instant::now();
                self.output.flush()?;
                if self.options.max_bytes.is_some_and(|most| self.output.bytes() >= most) {
                    self.full_since.get_or_insert_with(Instant::now);
                }
            }
            // Not between a tick and its weights, which would be in the next file.
            let ends = |since: Instant| !self.offered.is_due() || since.elapsed() >= WEIGHTS_PATIENCE;
            if self.full_since.is_some_and(ends) {
                self.full_since = None;
                self.turn_over()?;
            }
        }
        let Self { output, mut finished, last, .. } = self;
        finished.push(output.finish(&told(&last))?);
        Ok(finished)
    }

    fn write(&mut self, job: WriteJob) -> Result<(), RecordError> {
        match &job {
            WriteJob::Input(input) => self.offered.input(input),
            WriteJob::Thing(thing) => self.offered.thing(thing),
            WriteJob::Tick(_) | WriteJob::Status(_) | WriteJob::Counts(_) => {}
        }
        let output = &mut self.output;
        let at = |stamp_ns: u64| stamp_ns.wrapping_add(self.clock);
        let mut bytes = Vec::new();
        match job {
            WriteJob::Input(input) => put_input(output, at(input.header.stamp_ns), &input)?,
            WriteJob::Tick(record) => put_tick(output, at(record.header.stamp_ns), &record)?,
            WriteJob::Status(status) => {
                status.put(&mut bytes);
                output.put(RecordingTopic::StatusRaw, at(status.header.stamp_ns), &bytes)?;
            }
            WriteJob::Thing(thing) => put_thing(output, at(monotonic_now_ns()), &thing)?,
            WriteJob::Counts(counts) => {
                self.last = counts;
                let values = [
                    ProtoValue::U64(output.written()),
                    ProtoValue::U64(counts.queue_lost),
                    ProtoValue::U64(counts.inputs_lost),
                    ProtoValue::U64(counts.ticks_lost),
                    ProtoValue::U64(counts.things_broken),
                    ProtoValue::U64(counts.refused),
                ];
                let counts = encode(&RECORDER, &values).unwrap_or_default();
                output.put(RecordingTopic::Recorder, at(monotonic_now_ns()), &counts)?;
            }
        }
        self.shared.written.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    /// Ends the file and begins the next.
    fn turn_over(&mut self) -> Result<(), RecordError> {
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
    output.put(RecordingTopic::Input, time_ns, &bytes)
}

/// Writes a thing at `time_ns` since 1970; settings as a scene too.
pub(crate) fn put_thing(output: &mut Output, time_ns: u64, thing: &Thing) -> Result<(), RecordError> {
    output.put(RecordingTopic::Thing, time_ns, &thing_bytes(thing))?;
    let shown = output.scene.as_ref().is_some_and(|scene| scene.is_of(&thing.bytes));
    if thing.kind != PieceKind::Settings || shown {
        return Ok(());
    }
    match Scene::of(&thing.bytes) {
        Ok(scene) => {
            let update = scene.update(time_ns);
            output.scene = Some(scene);
            output.put(RecordingTopic::Scene, time_ns, &update)
        }
        Err(why) => {
            let words = format!("the arm is not shown: the settings cannot be read here: {why}");
            output.put(RecordingTopic::Log, time_ns, &warning(&words, time_ns))
        }
    }
}

/// Writes one tick record in all its encodings at `time_ns` since 1970.
pub(crate) fn put_tick(output: &mut Output, time_ns: u64, record: &TickRecord) -> Result<(), RecordError> {
    let mut bytes = Vec::new();
    record.put(&mut bytes);
    output.put(RecordingTopic::TickRaw, time_ns, &bytes)?;
    output.put(RecordingTopic::Tick, time_ns, &tick(record))?;
    frames(record, time_ns)
        .iter()
        .try_for_each(|frame| output.put(RecordingTopic::Frames, time_ns, frame))?;
    let around = output.scene.as_mut().map_or_else(Vec::new, |scene| scene.frames(record, time_ns));
    around.iter().try_for_each(|frame| output.put(RecordingTopic::Frames, time_ns, frame))?;
    if let Some(line) = output.preview.update(record, time_ns) {
        output.put(RecordingTopic::Preview, time_ns, &line)?;
    }
    let before = output.follow(record);
    let lines = before.map_or_else(Vec::new, |before| log(&before, record, time_ns));
    lines.iter().try_for_each(|line| output.put(RecordingTopic::Log, time_ns, line))
}

/// Counts as facts at the end of a file.
fn told(counts: &RecordingCounts) -> FileFacts {
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

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_shm::input_flags;
    use std::sync::mpsc::sync_channel;

    use foretrace_record::read::{Content, RecordingEntry, RecordingReader};

    /// Versions of the weights in a file.
    fn sets(path: &std::path::Path) -> Vec<u64> {
        let (mut reader, mut sets) = (RecordingReader::open(path).unwrap(), Vec::new());
        while let Some(entry) = reader.next_entry().unwrap() {
            if let RecordingEntry::Message(message) = entry
                && let Content::Thing(thing) = reader.content(&message).unwrap()
            {
                sets.push(thing.number);
            }
        }
        sets
    }

    #[test]
    fn a_file_that_is_large_enough_ends_behind_the_weights_of_its_last_tick() {
        let folder = tempfile::TempDir::new().unwrap();
        let target = folder.path().join("run.mcap");
        let facts = FileFacts::default();
        let options = RecorderOptions {
            target: target.clone(),
            max_bytes: Some(1),
            max_files: None,
            facts: facts.clone(),
        };
        let output = Output::create(&target, &facts).unwrap();
        let writer = FileWriter::new(output, options, Arc::default());
        let (jobs, due) = sync_channel(16);
        let writing = std::thread::spawn(move || writer.run(&due));
        let size = || std::fs::metadata(part_of(&target)).map_or(u64::MAX, |file| file.len());
        let begin = size();
        let input = TickInput {
            parts: 1,
            daemon_id: 1,
            flags: input_flags::WEIGHTS,
            weights_version: 9,
            ..TickInput::default()
        };
        jobs.send(WriteJob::Input(Box::new(input))).unwrap();
        // The chunk is closed, and the file found to be large enough.
        while size() == begin {
            std::thread::sleep(Duration::from_millis(1));
        }
        let thing = Thing { kind: PieceKind::Weights, number: 9, daemon_id: 1, bytes: vec![7] };
        jobs.send(WriteJob::Thing(thing)).unwrap();
        let second = numbered(&target, "2");
        while !part_of(&second).exists() {
            std::thread::sleep(Duration::from_millis(1));
        }
        drop(jobs);
        assert_eq!(writing.join().unwrap().unwrap(), [target.clone(), second.clone()]);
        assert_eq!((sets(&target), sets(&second)), (vec![9], vec![]));
    }
}
