//! A recording: what is in it, its topics as rows of bytes, its settings and other pieces, its pen.
//!
//! Contract: raw topics are read by the layout that the file itself names, so that recordings of other
//! versions are read too. A row is the host's time of the message, 8 bytes, and the message. No more is kept
//! than the caller allows.

use std::path::PathBuf;
use std::sync::Arc;

use foretrace_record::RecordError;
use foretrace_record::info::info;
use foretrace_record::pen::pen_samples;
use foretrace_record::read::{Channel, Content, RecordedMessage, RecordingEntry, RecordingReader, Schema};
use foretrace_record::table::{RawLayout, layout};
use foretrace_shm::PieceKind;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use super::failed::of_record;
use super::values::table;
use super::work::{StillWanted, apart};
use crate::problem::{invalid, problem};

/// Name of the column in front of a raw topic's own.
const TIME: &str = "time_ns";

/// What is in the recording, as a dict; see `Recording` on the Python side.
#[pyfunction]
fn recording_info(python: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let info = apart(python, move |_| info(&path))?.map_err(of_record)?;
    Ok(table!(python;
        "begin" => info.begin,
        "end" => info.end,
        "topics" => info.topics,
        "foreign" => info.foreign,
        "seconds" => info.seconds,
        "ticks" => info.ticks,
        "missing_ticks" => info.missing_ticks,
        "states" => info.states,
        "daemons" => info.daemons,
        "laws" => info.laws,
        "damage" => info.damage,
        "passed_over" => info.passed_over,
    ))
}

/// Bytes that are kept at a time, as many as are allowed.
pub(super) struct Room {
    left: u64,
    most: u64,
}

impl Room {
    pub(super) const fn of(most: u64) -> Self {
        Self { left: most, most }
    }

    /// `bytes` more are kept; `remedy`: what to do where there is no room for them.
    pub(super) fn count(&mut self, bytes: usize, remedy: &'static str) -> Result<(), ReadFailure> {
        let most = self.most;
        self.left = self.left.checked_sub(bytes as u64).ok_or(ReadFailure::TooMuch { most, remedy })?;
        Ok(())
    }

    /// As [`Self::count`], of `count` entries at the end of `kept`, which then has the memory for them.
    pub(super) fn take<T>(
        &mut self,
        kept: &mut Vec<T>,
        count: usize,
        remedy: &'static str,
    ) -> Result<(), ReadFailure> {
        self.count(count.saturating_mul(size_of::<T>()), remedy)?;
        kept.try_reserve(count).map_err(|_| ReadFailure::TooMuch { most: self.most - self.left, remedy })
    }
}

/// Why what was asked for is not read.
pub(super) enum ReadFailure {
    File(RecordError),
    /// It is more than `most` bytes.
    TooMuch {
        most: u64,
        remedy: &'static str,
    },
    /// What was asked for is not there, with what is.
    Unknown(String),
}

impl From<RecordError> for ReadFailure {
    fn from(error: RecordError) -> Self {
        Self::File(error)
    }
}

pub(super) fn of_read(path: PathBuf) -> impl Fn(ReadFailure) -> PyErr {
    move |failure| match failure {
        ReadFailure::File(error) => of_record(error),
        ReadFailure::TooMuch { most, remedy } => {
            let path = path.display();
            problem(format_args!("{path}: what was asked for is more than {most} bytes; {remedy}"))
        }
        ReadFailure::Unknown(why) => invalid(why),
    }
}

const OF_TOPIC: &str = "take every n-th message with topic(name, every=n), or set foretrace.recordings.MOST_BYTES \
                        where there is memory for it";
pub(super) const OF_ALL: &str = "set foretrace.recordings.MOST_BYTES where there is memory for it";

/// All messages of one topic.
struct TopicRows {
    schema: Arc<Schema>,
    encoding: String,
    /// Of a raw topic.
    layout: Option<RawLayout>,
    /// Of the messages \[ns since 1970\], and where each of them ends in `bytes`.
    times: Vec<u64>,
    ends: Vec<u64>,
    bytes: Vec<u8>,
}

impl TopicRows {
    fn of(channel: &Channel) -> Result<Self, String> {
        let (schema, encoding) = (channel.schema.clone(), channel.encoding.clone());
        let damaged =
            |why| format!("the layout of {} is damaged: {why}; take its other topics", channel.name);
        let layout = layout(channel).map_err(damaged)?;
        if layout.as_ref().is_some_and(|layout| layout.fields.iter().any(|field| field.name == TIME)) {
            return Err(damaged(format!("its field {TIME} has the name of the messages' time")));
        }
        Ok(Self { schema, encoding, layout, times: Vec::new(), ends: Vec::new(), bytes: Vec::new() })
    }

    fn add(&mut self, message: &RecordedMessage, room: &mut Room) -> Result<(), ReadFailure> {
        room.take(&mut self.times, 1, OF_TOPIC)?;
        room.take(&mut self.ends, 1, OF_TOPIC)?;
        room.take(&mut self.bytes, message.data.len().saturating_add(8), OF_TOPIC)?;
        if self.layout.is_some() {
            self.bytes.extend_from_slice(&message.time_ns.to_le_bytes());
        }
        self.bytes.extend_from_slice(&message.data);
        self.times.push(message.time_ns);
        self.ends.push(self.bytes.len() as u64);
        Ok(())
    }
}

/// Every `every`-th message of `topic`, of which at most `most` bytes are kept.
fn rows(
    path: PathBuf,
    topic: &str,
    every: u64,
    most: u64,
    wanted: &StillWanted,
) -> Result<TopicRows, ReadFailure> {
    let mut reader = RecordingReader::open(&path)?;
    let wrong = |why| RecordError::Format { path: path.clone(), why };
    let (mut found, mut seen, mut room): (Option<TopicRows>, u64, Room) = (None, 0, Room::of(most));
    while let Some(entry) = reader.next_entry()? {
        if !wanted.still() {
            break;
        }
        let RecordingEntry::Message(message) = entry else { continue };
        let Some(channel) = reader.channels().get(&message.channel).filter(|c| c.name == topic) else {
            continue;
        };
        let rows = match &mut found {
            Some(rows) => rows,
            None => found.insert(TopicRows::of(channel).map_err(wrong)?),
        };
        if *rows.schema != *channel.schema || rows.encoding != channel.encoding {
            return Err(wrong(format!("{topic} changes its layout in the middle of the file")).into());
        }
        seen += 1;
        if !(seen - 1).is_multiple_of(every.max(1)) {
            continue;
        }
        if rows.layout.as_ref().is_some_and(|layout| ![0, message.data.len()].contains(&layout.size)) {
            return Err(RecordError::Damaged { path: path.clone(), topic: topic.to_owned() }.into());
        }
        rows.add(&message, &mut room)?;
    }
    if let Some(rows) = found {
        return Ok(rows);
    }
    let why = format!("it holds no message of {topic}");
    if let Some(lack) = reader.lack(&why) {
        return Err(lack.into());
    }
    let mut topics: Vec<&str> = reader.channels().values().map(|channel| channel.name.as_str()).collect();
    topics.sort_unstable();
    topics.dedup();
    Err(ReadFailure::Unknown(format!("{}: {why}; there are {}", path.display(), topics.join(", "))))
}

/// Messages of a topic: encoding, name and text of the schema, times, ends, bytes; of a raw topic the size of
/// a message (0: they differ), and its fields: name, number, offset, count.
#[pyfunction]
fn recording_rows<'py>(
    python: Python<'py>,
    path: PathBuf,
    topic: String,
    every: u64,
    most: u64,
) -> PyResult<Bound<'py, PyDict>> {
    if every == 0 {
        return Err(invalid("every is 0; legal: 1 (all messages) and more"));
    }
    let failed = of_read(path.clone());
    let rows = apart(python, move |wanted| rows(path, &topic, every, most, wanted))?.map_err(failed)?;
    let whole = |numbers: &[u64]| -> Vec<u8> { numbers.iter().flat_map(|n| n.to_le_bytes()).collect() };
    let (name, kind, text) = &*rows.schema;
    let fields = rows.layout.iter().flat_map(|layout| &layout.fields);
    let fields = fields.map(|f| (f.name.as_str(), f.number().unwrap_or("u8"), f.offset, f.count));
    Ok(table!(python;
        "encoding" => &rows.encoding,
        "schema" => name,
        "schema_encoding" => kind,
        "schema_text" => PyBytes::new(python, text),
        "size" => rows.layout.as_ref().map(|layout| layout.size),
        "fields" => fields.collect::<Vec<_>>(),
        "times" => PyBytes::new(python, &whole(&rows.times)),
        "ends" => PyBytes::new(python, &whole(&rows.ends)),
        "bytes" => PyBytes::new(python, &rows.bytes),
    ))
}

const fn kind_name(kind: PieceKind) -> &'static str {
    match kind {
        PieceKind::Settings => "settings",
        PieceKind::Weights => "weights",
        PieceKind::State => "state",
        PieceKind::Law => "law",
        PieceKind::Preview => "preview",
    }
}

/// Settings, weights, states, builds of the law, previews of another process: kind, daemon, number, bytes.
#[pyfunction]
fn recording_pieces(python: Python<'_>, path: PathBuf, most: u64) -> PyResult<Bound<'_, PyList>> {
    let failed = of_read(path.clone());
    let found = apart(python, move |wanted| {
        let (mut reader, mut found, mut room) = (RecordingReader::open(&path)?, Vec::new(), Room::of(most));
        while wanted.still()
            && let Some(entry) = reader.next_entry()?
        {
            if let RecordingEntry::Message(message) = entry
                && let Content::Thing(thing) = reader.ticks_and_things(&message)?
            {
                room.count(thing.bytes.len(), OF_ALL)?;
                room.take(&mut found, 1, OF_ALL)?;
                found.push(thing);
            }
        }
        Ok(found)
    })?;
    let pieces = PyList::empty(python);
    for piece in found.map_err(failed)? {
        let bytes = PyBytes::new(python, &piece.bytes);
        pieces.append((kind_name(piece.kind), piece.daemon_id, piece.number, bytes))?;
    }
    Ok(pieces)
}

/// Every pen sample that a tick was given: rows of 25 bytes, stamp \[ns\], x and y \[m\], contact.
#[pyfunction]
fn recording_pen(python: Python<'_>, path: PathBuf, most: u64) -> PyResult<Bound<'_, PyBytes>> {
    let failed = of_read(path.clone());
    let rows = apart(python, move |wanted| {
        let (mut reader, mut rows, mut room) = (RecordingReader::open(&path)?, Vec::new(), Room::of(most));
        // Nobody waits for what is not wanted any more.
        let stopped = pen_samples(&mut reader, |seen| {
            if !wanted.still() {
                return Err(None);
            }
            room.take(&mut rows, 25, OF_ALL).map_err(Some)?;
            rows.extend_from_slice(&seen.stamp_ns.to_le_bytes());
            rows.extend_from_slice(&seen.x_m.to_le_bytes());
            rows.extend_from_slice(&seen.y_m.to_le_bytes());
            rows.push(seen.contact.into());
            Ok(())
        })?;
        match stopped {
            Err(Some(failure)) => Err(failure),
            Ok(_) | Err(None) => Ok(rows),
        }
    })?;
    Ok(PyBytes::new(python, &rows.map_err(failed)?))
}

/// The settings of a recording as nested dicts of plain values.
#[pyfunction]
fn toml_table<'py>(python: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    let parsed: Result<toml::Table, _> = text.parse();
    let parsed = parsed.map_err(|error| problem(format_args!("the settings are no TOML: {error}")))?;
    plain(python, toml::Value::Table(parsed))
}

/// TOML's own parser bounds the depth.
fn plain<'py>(python: Python<'py>, value: toml::Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        toml::Value::String(text) => text.into_pyobject(python)?.into_any(),
        toml::Value::Integer(number) => number.into_pyobject(python)?.into_any(),
        toml::Value::Float(number) => number.into_pyobject(python)?.into_any(),
        toml::Value::Boolean(is) => is.into_pyobject(python)?.to_owned().into_any(),
        toml::Value::Datetime(when) => when.to_string().into_pyobject(python)?.into_any(),
        toml::Value::Array(values) => {
            let list = PyList::empty(python);
            for value in values {
                list.append(plain(python, value)?)?;
            }
            list.into_any()
        }
        toml::Value::Table(values) => {
            let table = PyDict::new(python);
            for (key, value) in values {
                table.set_item(key, plain(python, value)?)?;
            }
            table.into_any()
        }
    })
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(recording_info, module)?)?;
    module.add_function(wrap_pyfunction!(recording_rows, module)?)?;
    module.add_function(wrap_pyfunction!(recording_pieces, module)?)?;
    module.add_function(wrap_pyfunction!(recording_pen, module)?)?;
    module.add_function(wrap_pyfunction!(toml_table, module)?)
}
