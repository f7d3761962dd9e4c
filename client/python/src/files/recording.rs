//! A recording: what is in it, its topics as rows of bytes, its settings and other pieces, its pen.
//!
//! Contract: raw topics are read by the layout that the file itself names, so that recordings of other
//! versions are read too. A row is the host's time of the message, 8 bytes, and the message.

use std::path::PathBuf;

use foretrace_record::RecordError;
use foretrace_record::info::info;
use foretrace_record::pen::pen_samples;
use foretrace_record::read::{Content, RecordingEntry, RecordingReader, Schema};
use foretrace_record::topics::WIRE;
use foretrace_shm::PieceKind;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use super::failed::of_record;
use super::values::table;
use super::work::{StillWanted, apart};
use crate::problem::{invalid, problem};

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

/// All messages of one topic.
#[derive(Default)]
struct TopicRows {
    schema: std::sync::Arc<Schema>,
    encoding: String,
    /// Of the messages \[ns since 1970\], and where each of them ends in `bytes`.
    times: Vec<u64>,
    ends: Vec<u64>,
    bytes: Vec<u8>,
}

/// Every `every`-th message of `topic`; `None`: the file has none, with the topics that it has.
fn rows(
    path: PathBuf,
    topic: &str,
    every: u64,
    wanted: &StillWanted,
) -> Result<Result<TopicRows, PyErr>, RecordError> {
    let mut reader = RecordingReader::open(&path)?;
    let (mut found, mut seen): (Option<TopicRows>, u64) = (None, 0);
    while let Some(entry) = reader.next_entry()? {
        if !wanted.still() {
            break;
        }
        let RecordingEntry::Message(message) = entry else { continue };
        let Some(channel) = reader.channels().get(&message.channel).filter(|c| c.name == topic) else {
            continue;
        };
        let rows = found.get_or_insert_with(|| TopicRows {
            schema: channel.schema.clone(),
            encoding: channel.encoding.clone(),
            ..TopicRows::default()
        });
        if *rows.schema != *channel.schema || rows.encoding != channel.encoding {
            let why = format!("{topic} changes its layout in the middle of the file");
            return Err(RecordError::Format { path, why });
        }
        seen += 1;
        if !(seen - 1).is_multiple_of(every.max(1)) {
            continue;
        }
        if rows.encoding == WIRE {
            rows.bytes.extend_from_slice(&message.time_ns.to_le_bytes());
        }
        rows.bytes.extend_from_slice(&message.data);
        rows.times.push(message.time_ns);
        rows.ends.push(rows.bytes.len() as u64);
    }
    if let Some(rows) = found {
        return Ok(Ok(rows));
    }
    let why = format!("it holds no message of {topic}");
    if let Some(lack) = reader.lack(&why) {
        return Err(lack);
    }
    let mut topics: Vec<&str> = reader.channels().values().map(|channel| channel.name.as_str()).collect();
    topics.sort_unstable();
    topics.dedup();
    Ok(Err(invalid(format_args!("{}: {why}; there are {}", path.display(), topics.join(", ")))))
}

/// Messages of a topic: encoding, name and text of the schema, times, ends, bytes.
#[pyfunction]
fn recording_rows<'py>(
    python: Python<'py>,
    path: PathBuf,
    topic: String,
    every: u64,
) -> PyResult<Bound<'py, PyDict>> {
    if every == 0 {
        return Err(invalid("every is 0; legal: 1 (all messages) and more"));
    }
    let rows = apart(python, move |wanted| rows(path, &topic, every, wanted))?.map_err(of_record)??;
    let whole = |numbers: &[u64]| -> Vec<u8> { numbers.iter().flat_map(|n| n.to_le_bytes()).collect() };
    let (name, kind, text) = &*rows.schema;
    Ok(table!(python;
        "encoding" => &rows.encoding,
        "schema" => name,
        "schema_encoding" => kind,
        "schema_text" => PyBytes::new(python, text),
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
fn recording_pieces(python: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyList>> {
    let found = apart(python, move |wanted| {
        let (mut reader, mut found) = (RecordingReader::open(&path)?, Vec::new());
        while wanted.still()
            && let Some(entry) = reader.next_entry()?
        {
            if let RecordingEntry::Message(message) = entry
                && let Content::Thing(thing) = reader.ticks_and_things(&message)?
            {
                found.push(thing);
            }
        }
        Ok(found)
    })?;
    let pieces = PyList::empty(python);
    for piece in found.map_err(of_record)? {
        let bytes = PyBytes::new(python, &piece.bytes);
        pieces.append((kind_name(piece.kind), piece.daemon_id, piece.number, bytes))?;
    }
    Ok(pieces)
}

/// Every pen sample that a tick was given: rows of 25 bytes, stamp \[ns\], x and y \[m\], contact.
#[pyfunction]
fn recording_pen(python: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyBytes>> {
    let rows = apart(python, move |wanted| {
        let (mut reader, mut rows) = (RecordingReader::open(&path)?, Vec::new());
        let stopped = pen_samples(&mut reader, |seen| {
            rows.extend_from_slice(&seen.stamp_ns.to_le_bytes());
            rows.extend_from_slice(&seen.x_m.to_le_bytes());
            rows.extend_from_slice(&seen.y_m.to_le_bytes());
            rows.push(seen.contact.into());
            if wanted.still() { Ok(()) } else { Err(()) }
        })?;
        // Nobody waits for what is not wanted any more.
        let _ = stopped;
        Ok(rows)
    })?;
    Ok(PyBytes::new(python, &rows.map_err(of_record)?))
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
