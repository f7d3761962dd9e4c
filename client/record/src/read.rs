//! Reading a recording, one record after the other, whatever became of the file.
//!
//! Contract: memory is bounded by the largest record, not by the file. A file that ends early yields
//! everything before its end, and says so; a file that is not a recording, or one of another layout, is an
//! error that says what to do. No input panics.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::{Record, op};

use foretrace_shm::{Status, Thing, TickInput, TickRecord, Validate, Wire};
use foretrace_sim::data::parse_mcap_record;

use crate::RecordError;
use crate::topics::{RecordingTopic, WIRE, layout_of, thing_of};

/// Bytes of a record at most, chunks included: far more than a recorder writes.
const LARGEST_RECORD: u64 = 64 << 20;
/// Bytes of a schema or a name at most, and how many schemas and channels there may be: together they stay in
/// memory, whatever the file holds.
const LARGEST_SCHEMA: usize = 256 << 10;
const MOST_CHANNELS: usize = 256;

/// Name, encoding and text.
pub type Schema = (String, String, Vec<u8>);

/// A channel of the file.
#[derive(Debug, Clone)]
pub struct Channel {
    pub name: String,
    pub encoding: String,
    /// Its schema, which other channels may have too.
    pub schema: Arc<Schema>,
    topic: Option<RecordingTopic>,
    /// The layout is another one than ours.
    foreign: bool,
}

#[derive(Debug, Clone)]
pub struct RecordedMessage {
    /// Number of its channel.
    pub channel: u16,
    /// Its number in its channel.
    pub sequence: u32,
    /// When it was recorded \[ns since 1970\].
    pub time_ns: u64,
    pub data: Vec<u8>,
}

/// What a record of the file is.
#[derive(Debug, Clone)]
pub enum RecordingEntry {
    Message(RecordedMessage),
    /// Facts under a name.
    Facts(String, BTreeMap<String, String>),
}

/// A message in our types.
#[derive(Debug, Clone)]
pub enum Content {
    /// Input of a tick.
    Input(Box<TickInput>),
    /// Record of a tick.
    Tick(Box<TickRecord>),
    Status(Box<Status>),
    /// Settings, weights or a state.
    Thing(Thing),
    Other,
}

/// How a file ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ended {
    /// As its writer ended it.
    Whole,
    /// Too early, or damaged: after so many bytes, for this reason.
    Cut { after: u64, why: String },
}

pub struct RecordingReader {
    path: PathBuf,
    file: BufReader<File>,
    /// Records of the open chunk, the next one from `at` on.
    chunk: Vec<u8>,
    at: usize,
    /// The file ends in the middle of the open chunk.
    torn: bool,
    channels: BTreeMap<u16, Channel>,
    schemas: BTreeMap<u16, Arc<Schema>>,
    read: u64,
    ended: Option<Ended>,
}

impl std::fmt::Debug for RecordingReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reader").field("path", &self.path).finish_non_exhaustive()
    }
}

impl RecordingReader {
    /// Opens `path`.
    ///
    /// # Errors
    ///
    /// It cannot be read, or does not begin as a recording.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let failed = |source| RecordError::Read { path: path.to_path_buf(), source };
        // A pipe without a writer blocks whoever opens it.
        let none = |why: &str| RecordError::NoRecording { path: path.to_path_buf(), why: why.to_owned() };
        if !std::fs::metadata(path).map_err(failed)?.is_file() {
            return Err(none("not a regular file"));
        }
        let mut file = File::open(path).map_err(failed)?;
        let mut magic = [0; mcap::MAGIC.len()];
        let whole = file.read_exact(&mut magic).is_ok();
        if !whole || magic != *mcap::MAGIC {
            let why = if whole { "it does not begin as an MCAP file" } else { "it is empty or too short" };
            return Err(none(why));
        }
        Ok(Self {
            path: path.to_path_buf(),
            file: BufReader::with_capacity(1 << 16, file),
            chunk: Vec::new(),
            at: 0,
            torn: false,
            channels: BTreeMap::new(),
            schemas: BTreeMap::new(),
            read: magic.len() as u64,
            ended: None,
        })
    }

    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Channels seen so far.
    #[must_use]
    pub const fn channels(&self) -> &BTreeMap<u16, Channel> {
        &self.channels
    }

    /// How the file ended, once it has.
    #[must_use]
    pub const fn ended(&self) -> Option<&Ended> {
        self.ended.as_ref()
    }

    /// Where and why the file ended early, once it has; `None`: it is whole.
    #[must_use]
    pub fn damage(&self) -> Option<String> {
        match &self.ended {
            Some(Ended::Cut { after, why }) => Some(format!("after {after} bytes: {why}")),
            _ => None,
        }
    }

    /// The next message or facts; `None` at the end.
    ///
    /// # Errors
    ///
    /// The disk fails. A damaged file is not an error: it ends.
    pub fn next_entry(&mut self) -> Result<Option<RecordingEntry>, RecordError> {
        while self.ended.is_none() {
            if let Some(entry) = self.next_in_chunk() {
                return Ok(Some(entry));
            }
            if self.ended.is_none()
                && let Some(entry) = self.next_in_file()?
            {
                return Ok(Some(entry));
            }
        }
        Ok(None)
    }

    /// The next entry of the open chunk; `None` at its end, or where it is damaged.
    fn next_in_chunk(&mut self) -> Option<RecordingEntry> {
        while self.at < self.chunk.len() {
            let rest = self.chunk.get(self.at..).unwrap_or_default();
            let Some((kind, body)) = split(rest) else {
                self.at = self.chunk.len();
                if !self.torn {
                    self.cut("a record is longer than its chunk".to_owned());
                }
                break;
            };
            let parsed = wanted(kind).then(|| parse_mcap_record(kind, body).map(taken));
            self.at += HEAD + body.len();
            if let Some(entry) = parsed.and_then(|parsed| self.enter(parsed)) {
                return Some(entry);
            }
            if self.ended.is_some() {
                break;
            }
        }
        if self.torn && self.ended.is_none() {
            self.cut("the file ends in the middle of a chunk".to_owned());
        }
        None
    }

    /// The next entry outside of chunks, or a chunk to be looked into.
    fn next_in_file(&mut self) -> Result<Option<RecordingEntry>, RecordError> {
        let (mut head, failed) = ([0; HEAD], |source| RecordError::Read { path: self.path.clone(), source });
        match self.file.read_exact(&mut head) {
            Ok(()) => {}
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
                self.cut("the file has no end".to_owned());
                return Ok(None);
            }
            Err(source) => return Err(failed(source)),
        }
        let [kind, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        if kind == 0 || length > LARGEST_RECORD {
            self.cut(format!("a record of kind {kind} with {length} bytes"));
            return Ok(None);
        }
        // Grows as the bytes come, whatever the length says.
        let mut body = Vec::new();
        let came = (&mut self.file).take(length).read_to_end(&mut body).map_err(failed)? as u64;
        self.read += HEAD as u64 + came;
        if kind == op::CHUNK {
            self.open_chunk(&body, came < length);
            return Ok(None);
        }
        if came < length {
            self.cut("the file ends in the middle of a record".to_owned());
            return Ok(None);
        }
        if kind == op::FOOTER {
            let mut end = [0; mcap::MAGIC.len()];
            let whole = self.file.read_exact(&mut end).is_ok() && end == *mcap::MAGIC;
            let without = || Ended::Cut { after: self.read, why: "the file has no end".to_owned() };
            self.ended = Some(if whole { Ended::Whole } else { without() });
            return Ok(None);
        }
        let parsed = wanted(kind).then(|| parse_mcap_record(kind, &body).map(taken));
        Ok(parsed.and_then(|parsed| self.enter(parsed)))
    }

    /// Takes the records of a chunk, of which the end may be missing.
    fn open_chunk(&mut self, body: &[u8], torn: bool) {
        let Some((crc, compression, records, length)) = chunk_parts(body) else {
            self.cut("a chunk without a beginning".to_owned());
            return;
        };
        if !compression.is_empty() {
            let how = String::from_utf8_lossy(compression).into_owned();
            self.cut(format!("a chunk is compressed ({how}), which no recorder of foretrace does"));
            return;
        }
        if !torn && records.len() as u64 != length {
            self.cut("a chunk of another length than it says".to_owned());
            return;
        }
        if !torn && crc != 0 && crc32fast::hash(records) != crc {
            self.cut("the checksum of a chunk is wrong".to_owned());
            return;
        }
        self.chunk.clear();
        self.chunk.extend_from_slice(records);
        (self.at, self.torn) = (0, torn);
        if torn && records.is_empty() {
            self.cut("the file ends in the middle of a chunk".to_owned());
        }
    }

    /// Remembers schemas and channels, passes on what is an entry.
    fn enter(&mut self, parsed: Result<ParsedRecord, String>) -> Option<RecordingEntry> {
        match parsed {
            Ok(ParsedRecord::Entry(entry)) => return Some(entry),
            Ok(ParsedRecord::Schema(id, schema)) => {
                let bytes = schema.0.len() + schema.1.len() + schema.2.len();
                if self.fits(bytes, self.schemas.len(), "schema") {
                    self.schemas.insert(id, Arc::new(schema));
                }
            }
            Ok(ParsedRecord::Channel { id, schema, name, encoding }) => {
                if self.fits(name.len() + encoding.len(), self.channels.len(), "channel") {
                    let schema = self.schemas.get(&schema).cloned().unwrap_or_default();
                    self.channels.insert(id, channel(name, encoding, schema));
                }
            }
            Ok(ParsedRecord::Nothing) => {}
            Err(why) => self.cut(why),
        }
        None
    }

    /// Whether one more `what` of `bytes` beside `known` ones is within the bounds; ends the file otherwise.
    fn fits(&mut self, bytes: usize, known: usize, what: &str) -> bool {
        if bytes > LARGEST_SCHEMA {
            self.cut(format!("a {what} of {bytes} bytes, and {LARGEST_SCHEMA} are the most"));
        } else if known >= MOST_CHANNELS {
            self.cut(format!("more than {MOST_CHANNELS} of its kind: a {what}"));
        }
        self.ended.is_none()
    }

    /// As [`RecordingReader::content`], for whoever needs tick records and things only: of the rest another
    /// version's layout does no harm.
    ///
    /// # Errors
    ///
    /// Tick records or things of another layout than this program's, or bytes that are not a message.
    pub fn ticks_and_things(&self, message: &RecordedMessage) -> Result<Content, RecordError> {
        let needed = |topic| matches!(topic, RecordingTopic::TickRaw | RecordingTopic::Thing);
        match self.channels.get(&message.channel) {
            Some(channel) if channel.topic.is_some_and(needed) => self.content(message),
            _ => Ok(Content::Other),
        }
    }

    /// `message` in our types.
    ///
    /// # Errors
    ///
    /// Another layout than this program's, or bytes that are not a message.
    pub fn content(&self, message: &RecordedMessage) -> Result<Content, RecordError> {
        let Some(channel) = self.channels.get(&message.channel) else { return Ok(Content::Other) };
        if channel.foreign {
            return Err(RecordError::OtherLayout { path: self.path.clone(), topic: channel.name.clone() });
        }
        let data = message.data.as_slice();
        let content = match channel.topic {
            Some(RecordingTopic::Input) => {
                decoded::<TickInput>(data).map(|input| Content::Input(Box::new(input)))
            }
            Some(RecordingTopic::TickRaw) => {
                decoded::<TickRecord>(data).map(|tick| Content::Tick(Box::new(tick)))
            }
            Some(RecordingTopic::StatusRaw) => {
                decoded::<Status>(data).map(|status| Content::Status(Box::new(status)))
            }
            Some(RecordingTopic::Thing) => thing_of(data).map(Content::Thing),
            _ => Some(Content::Other),
        };
        content.ok_or_else(|| RecordError::Damaged { path: self.path.clone(), topic: channel.name.clone() })
    }

    fn cut(&mut self, why: String) {
        self.ended = Some(Ended::Cut { after: self.read, why });
    }
}

/// Kind and length of a record.
const HEAD: usize = 1 + size_of::<u64>();

/// Kind and body of the record at the front of `bytes`; `None` if it is not all there.
fn split(bytes: &[u8]) -> Option<(u8, &[u8])> {
    let [kind, length @ ..] = *bytes.first_chunk::<HEAD>()?;
    let length = usize::try_from(u64::from_le_bytes(length)).ok()?;
    bytes.get(HEAD..HEAD.checked_add(length)?).map(|body| (kind, body))
}

/// Checksum, compression, the records that are there, and how many bytes of them there ought to be.
fn chunk_parts(body: &[u8]) -> Option<(u32, &[u8], &[u8], u64)> {
    // Two times and the size come before.
    let mut rest = body.get(24..)?;
    let crc = u32::get(&mut rest)?;
    let named = u32::get(&mut rest)? as usize;
    let compression = rest.get(..named)?;
    rest = rest.get(named..)?;
    let length = u64::get(&mut rest)?;
    Some((crc, compression, rest, length))
}

/// Records that say something here; indexes repeat what is known.
fn wanted(kind: u8) -> bool {
    matches!(kind, op::SCHEMA | op::CHANNEL | op::MESSAGE | op::METADATA)
}

enum ParsedRecord {
    Entry(RecordingEntry),
    Schema(u16, Schema),
    Channel { id: u16, schema: u16, name: String, encoding: String },
    Nothing,
}

fn taken(record: Record<'_>) -> ParsedRecord {
    match record {
        Record::Message { header, data } => ParsedRecord::Entry(RecordingEntry::Message(RecordedMessage {
            channel: header.channel_id,
            sequence: header.sequence,
            time_ns: header.log_time,
            data: data.into_owned(),
        })),
        Record::Metadata(facts) => ParsedRecord::Entry(RecordingEntry::Facts(facts.name, facts.metadata)),
        Record::Schema { header, data } => {
            ParsedRecord::Schema(header.id, (header.name, header.encoding, data.into_owned()))
        }
        Record::Channel(channel) => ParsedRecord::Channel {
            id: channel.id,
            schema: channel.schema_id,
            name: channel.topic,
            encoding: channel.message_encoding,
        },
        _ => ParsedRecord::Nothing,
    }
}

fn channel(name: String, encoding: String, schema: Arc<Schema>) -> Channel {
    let topic = RecordingTopic::from_name(&name);
    let foreign =
        encoding == WIRE && topic.is_some_and(|topic| layout_of(&topic.schema().2) != layout_of(&schema.2));
    Channel { name, encoding, schema, topic, foreign }
}

/// The message of exactly these bytes, if it is a legal one.
fn decoded<T: Wire + Validate>(mut data: &[u8]) -> Option<T> {
    let message = T::get(&mut data)?;
    (data.is_empty() && message.validate().is_ok()).then_some(message)
}
