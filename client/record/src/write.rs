//! A recording being written.
//!
//! Contract: the file grows as `NAME.part` and gets its name when it is whole. Chunks reach the file complete
//! and at least every quarter of a second of work, so that a killed recorder loses no more than that; what is
//! left is mended by [`crate::repair`]. Existing files are never overwritten.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use foretrace_host::whole::begin;
use foretrace_shm::TickRecord;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{WriteOptions, Writer};

use crate::RecordError;
use crate::scene::{Preview, Scene};
use crate::topics::RecordingTopic;

/// Bytes of a chunk at most; most are closed by time before that.
const CHUNK_BYTES: u64 = 1 << 20;

/// What a recording says about itself, in order of the keys.
pub type FileFacts = BTreeMap<String, String>;

pub struct Output {
    writer: Writer<NoSeek<BufWriter<File>>>,
    channels: [u16; RecordingTopic::ALL.len()],
    sequences: [u32; RecordingTopic::ALL.len()],
    part: PathBuf,
    target: PathBuf,
    bytes: u64,
    written: u64,
    newest: Option<TickRecord>,
    /// That of the settings in the file.
    pub scene: Option<Scene>,
    /// The previewed path, as it was shown last.
    pub preview: Preview,
}

impl std::fmt::Debug for Output {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Output").field("target", &self.target).finish_non_exhaustive()
    }
}

/// Name of `target` while it is written.
#[must_use]
pub fn part_of(target: &Path) -> PathBuf {
    let mut name = target.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

impl Output {
    /// Begins the recording `target`, which says `facts` about itself.
    ///
    /// # Errors
    ///
    /// `target` or its part exists already; the folder cannot be written.
    pub fn create(target: &Path, facts: &FileFacts) -> Result<Self, RecordError> {
        let part = part_of(target);
        if target.exists() {
            return Err(RecordError::Exists { path: target.to_path_buf() });
        }
        // What another recorder left is its recording: it is mended first, or stays.
        let left = |_: &Path| Err(std::io::ErrorKind::AlreadyExists.into());
        let file = begin(&part, left).map_err(|error| RecordError::of_part(&part, error))?;
        let broken = |error: mcap::McapError| RecordError::of_mcap(&part, error);
        let options = WriteOptions::new()
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .profile("foretrace")
            .library(format!("foretrace {}", env!("CARGO_PKG_VERSION")));
        let mut writer = options.create(NoSeek::new(BufWriter::new(file))).map_err(broken)?;
        let broken = |error: mcap::McapError| RecordError::of_mcap(&part, error);
        let mut channels = [0; RecordingTopic::ALL.len()];
        for (channel, topic) in channels.iter_mut().zip(RecordingTopic::ALL) {
            let (name, encoding, text) = topic.schema();
            let schema = writer.add_schema(&name, encoding, &text).map_err(broken)?;
            *channel = writer
                .add_channel(schema, topic.name(), topic.encoding(), &BTreeMap::new())
                .map_err(broken)?;
        }
        let about = Metadata { name: "foretrace".to_owned(), metadata: facts.clone() };
        writer.write_metadata(&about).map_err(broken)?;
        let (sequences, target) = ([0; RecordingTopic::ALL.len()], target.to_path_buf());
        let (newest, scene, preview) = (None, None, Preview::default());
        let mut output =
            Self { writer, channels, sequences, part, target, bytes: 0, written: 0, newest, scene, preview };
        output.flush()?;
        Ok(output)
    }

    /// The tick record before `record`, which is the newest from here on.
    pub const fn follow(&mut self, record: &TickRecord) -> Option<TickRecord> {
        self.newest.replace(*record)
    }

    /// Bytes of messages so far.
    #[must_use]
    pub const fn bytes(&self) -> u64 {
        self.bytes
    }

    #[must_use]
    pub const fn written(&self) -> u64 {
        self.written
    }

    /// Adds a message of `topic` at `time_ns` since 1970.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn put(&mut self, topic: RecordingTopic, time_ns: u64, data: &[u8]) -> Result<(), RecordError> {
        let at = topic as usize;
        let (channel, sequence) = (self.channels.get(at), self.sequences.get_mut(at));
        let (Some(channel), Some(sequence)) = (channel, sequence) else { return Ok(()) };
        *sequence = sequence.wrapping_add(1);
        let header = MessageHeader {
            channel_id: *channel,
            sequence: *sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };
        self.writer
            .write_to_known_channel(&header, data)
            .map_err(|error| RecordError::of_mcap(&self.part, error))?;
        self.bytes += data.len() as u64;
        self.written += 1;
        Ok(())
    }

    /// Closes the chunk: what was added until now survives this process.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<(), RecordError> {
        self.writer.flush().map_err(|error| RecordError::of_mcap(&self.part, error))
    }

    /// Ends the recording, which then has its name; `facts` are what is known at the end.
    ///
    /// # Errors
    ///
    /// The file cannot be written or renamed.
    pub fn finish(mut self, facts: &FileFacts) -> Result<PathBuf, RecordError> {
        let end = Metadata { name: "foretrace.end".to_owned(), metadata: facts.clone() };
        let broken = |error: mcap::McapError| RecordError::of_mcap(&self.part, error);
        self.writer.write_metadata(&end).map_err(broken)?;
        self.writer.finish().map_err(broken)?;
        crate::appear(&self.part, &self.target)?;
        Ok(self.target)
    }
}
