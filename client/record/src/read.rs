//! Reading a recording, one record after the other, whatever became of the file.
//!
//! Contract: memory is bounded by the largest record or chunk, not by the file. A file that ends early yields
//! everything before its end, and says so; a file that is not a recording, or one of another layout, is an
//! error that says what to do. No input panics.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::Record;

use foretrace_shm::{Status, Thing, TickInput, TickRecord, Validate, Wire};
use foretrace_sim::data::{McapRecords, folder_for_file, parse_mcap_record, shortened};

/// How the file of a recording ended.
pub use foretrace_sim::data::McapEnd as Ended;

use crate::RecordError;
use crate::topics::{RecordingTopic, WIRE, layout_of, thing_of};

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
    pub metadata: BTreeMap<String, String>,
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
    /// When its sender says that it was sent \[ns since 1970\].
    pub publish_ns: u64,
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

pub struct RecordingReader {
    path: PathBuf,
    records: McapRecords<BufReader<File>>,
    channels: BTreeMap<u16, Channel>,
    schemas: BTreeMap<u16, Arc<Schema>>,
    /// Messages so far, and those of them of channels that the file does not tell of.
    messages: u64,
    orphans: u64,
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
        let none = |why: String| RecordError::NoRecording { path: path.to_path_buf(), why };
        // A pipe without a writer blocks whoever opens it.
        let about = std::fs::metadata(path).map_err(failed)?;
        if about.is_dir() {
            return Err(none(folder_for_file(path)));
        }
        if !about.is_file() {
            return Err(none("it is not a regular file; give a file of `foretrace record`".to_owned()));
        }
        let file = BufReader::with_capacity(1 << 16, File::open(path).map_err(failed)?);
        Ok(Self {
            path: path.to_path_buf(),
            records: McapRecords::begin(file, about.len()).map_err(failed)?.map_err(none)?,
            channels: BTreeMap::new(),
            schemas: BTreeMap::new(),
            messages: 0,
            orphans: 0,
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
        self.records.end()
    }

    /// Where and why the file ended early, once it has, and how much of it is left out; `None`: it is whole.
    #[must_use]
    pub fn damage(&self) -> Option<String> {
        self.ended().and_then(Ended::damage)
    }

    /// What was passed over so far, in words: attachments, and messages of channels that the file does not
    /// tell of.
    #[must_use]
    pub fn passed_over(&self) -> Option<String> {
        let count = |count: u64, what: &str| {
            (count > 0).then(|| format!("{count} {what}{}", if count == 1 { "" } else { "s" }))
        };
        let attachments = count(self.records.attachments(), "attachment");
        let orphans = count(self.orphans, "message").map(|words| format!("{words} of unknown channels"));
        match (attachments, orphans) {
            (Some(a), Some(b)) => Some(format!("{a} and {b}")),
            (a, b) => a.or(b),
        }
    }

    /// Why it is so that `what`, a sentence: the file's damage, or that another program wrote it; `None`:
    /// neither.
    #[must_use]
    pub fn lack(&self, what: &str) -> Option<RecordError> {
        /// Topics that are named at most, and characters of each.
        const NAMED: (usize, usize) = (4, 60);
        let (path, what) = (self.path.clone(), what.to_owned());
        if let Some(damage) = self.damage() {
            return Some(if self.messages > self.orphans {
                RecordError::Unread { path, what, damage }
            } else {
                RecordError::NothingBefore { path, what, damage }
            });
        }
        let raw = |channel: &Channel| channel.topic.is_some_and(RecordingTopic::is_raw);
        if self.channels.values().any(raw) {
            return None;
        }
        let names = self.channels.values().map(|channel| shortened(&channel.name, NAMED.1));
        let mut topics: Vec<String> = names.take(NAMED.0).collect();
        match self.channels.len() {
            0 => topics.push("it has none".to_owned()),
            more if more > NAMED.0 => topics.push(format!("{} more", more - NAMED.0)),
            _ => {}
        }
        Some(RecordError::NoTopics { path, what, topics: topics.join(", ") })
    }

    /// The next message or facts; `None` at the end.
    ///
    /// # Errors
    ///
    /// The disk fails. A damaged file is not an error: it ends.
    pub fn next_entry(&mut self) -> Result<Option<RecordingEntry>, RecordError> {
        loop {
            let failed = |source| RecordError::Read { path: self.path.clone(), source };
            let Some((kind, body)) = self.records.next_record().map_err(failed)? else { return Ok(None) };
            let parsed = parse_mcap_record(kind, body).map(taken);
            if let Some(entry) = self.enter(parsed) {
                return Ok(Some(entry));
            }
        }
    }

    /// Remembers schemas and channels, passes on what is an entry.
    fn enter(&mut self, parsed: Result<ParsedRecord, String>) -> Option<RecordingEntry> {
        match parsed {
            Ok(ParsedRecord::Entry(entry)) => {
                if let RecordingEntry::Message(message) = &entry {
                    self.messages += 1;
                    self.orphans += u64::from(!self.channels.contains_key(&message.channel));
                }
                return Some(entry);
            }
            Ok(ParsedRecord::Schema(id, schema)) => {
                let bytes = schema.0.len() + schema.1.len() + schema.2.len();
                // A summary tells again what is known.
                let others = if self.schemas.contains_key(&id) { 0 } else { self.schemas.len() };
                if self.fits(bytes, others, "schema") {
                    self.schemas.insert(id, Arc::new(schema));
                }
            }
            Ok(ParsedRecord::Channel(found)) => {
                let facts: usize = found.metadata.iter().map(|(key, value)| key.len() + value.len()).sum();
                let bytes = found.topic.len() + found.message_encoding.len() + facts;
                let others = if self.channels.contains_key(&found.id) { 0 } else { self.channels.len() };
                if self.fits(bytes, others, "channel") {
                    let schema = self.schemas.get(&found.schema_id).cloned().unwrap_or_default();
                    self.channels.insert(found.id, channel(found, schema));
                }
            }
            Ok(ParsedRecord::Nothing) => {}
            Err(why) => self.records.refuse(why),
        }
        None
    }

    /// Whether one more `what` of `bytes` beside `known` ones is within the bounds; ends the file otherwise.
    fn fits(&mut self, bytes: usize, known: usize, what: &str) -> bool {
        if bytes > LARGEST_SCHEMA {
            self.records.refuse(format!("a {what} of {bytes} bytes, and {LARGEST_SCHEMA} are the most"));
        } else if known >= MOST_CHANNELS {
            self.records.refuse(format!("more than {MOST_CHANNELS} of its kind: a {what}"));
        }
        self.ended().is_none()
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
}

enum ParsedRecord {
    Entry(RecordingEntry),
    Schema(u16, Schema),
    Channel(mcap::records::Channel),
    Nothing,
}

fn taken(record: Record<'_>) -> ParsedRecord {
    match record {
        Record::Message { header, data } => ParsedRecord::Entry(RecordingEntry::Message(RecordedMessage {
            channel: header.channel_id,
            sequence: header.sequence,
            time_ns: header.log_time,
            publish_ns: header.publish_time,
            data: data.into_owned(),
        })),
        Record::Metadata(facts) => ParsedRecord::Entry(RecordingEntry::Facts(facts.name, facts.metadata)),
        Record::Schema { header, data } => {
            ParsedRecord::Schema(header.id, (header.name, header.encoding, data.into_owned()))
        }
        Record::Channel(channel) => ParsedRecord::Channel(channel),
        _ => ParsedRecord::Nothing,
    }
}

fn channel(found: mcap::records::Channel, schema: Arc<Schema>) -> Channel {
    let mcap::records::Channel { topic: name, message_encoding: encoding, metadata, .. } = found;
    let topic = RecordingTopic::from_name(&name);
    let foreign =
        encoding == WIRE && topic.is_some_and(|topic| layout_of(&topic.schema().2) != layout_of(&schema.2));
    Channel { name, encoding, schema, metadata, topic, foreign }
}

/// The message of exactly these bytes, if it is a legal one.
fn decoded<T: Wire + Validate>(mut data: &[u8]) -> Option<T> {
    let message = T::get(&mut data)?;
    (data.is_empty() && message.validate().is_ok()).then_some(message)
}
