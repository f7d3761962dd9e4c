//! Raw topics as tables of numbers, by the layout that the file itself names.
//!
//! Contract: needs nothing of this program's layouts, so that recordings of other versions are read too. What
//! is not a number (names, nested messages) is left out.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry as Slot;
use std::io::Write;

use foretrace_shm::{PATH_POINTS, Stage};

use crate::RecordError;
use crate::read::{Channel, RecordingEntry, RecordingReader};
use crate::topics::WIRE;

/// A column of numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Field, with an index for arrays, and unit.
    pub name: String,
    offset: usize,
    /// Place of its type in [`NUMBERS`].
    number: usize,
}

impl Column {
    /// Its field, without index and unit.
    fn field(&self) -> &str {
        self.name.split([' ', '[']).next().unwrap_or_default()
    }
}

/// The number at the front of bytes as text; `None` if there are too few.
type AsText = fn(&[u8]) -> Option<String>;

/// Types of numbers: name, size, and how they are read.
const NUMBERS: [(&str, usize, AsText); 8] = [
    ("u8", 1, |bytes| Some(u8::from_le_bytes(*bytes.first_chunk()?).to_string())),
    ("u16", 2, |bytes| Some(u16::from_le_bytes(*bytes.first_chunk()?).to_string())),
    ("u32", 4, |bytes| Some(u32::from_le_bytes(*bytes.first_chunk()?).to_string())),
    ("u64", 8, |bytes| Some(u64::from_le_bytes(*bytes.first_chunk()?).to_string())),
    ("i32", 4, |bytes| Some(i32::from_le_bytes(*bytes.first_chunk()?).to_string())),
    ("i64", 8, |bytes| Some(i64::from_le_bytes(*bytes.first_chunk()?).to_string())),
    ("f32", 4, |bytes| Some(f32::from_le_bytes(*bytes.first_chunk()?).to_string())),
    ("f64", 8, |bytes| Some(f64::from_le_bytes(*bytes.first_chunk()?).to_string())),
];

/// Entries of an array that become columns at most; longer ones are histograms and byte strings.
const LONGEST_ARRAY: usize = 2 * PATH_POINTS;
/// Columns of one topic at most: a forged table must not fill the memory.
const MOST_COLUMNS: usize = 4096;

/// The columns of a raw channel; `None` if it is not one, or its table is damaged.
#[must_use]
pub fn columns(channel: &Channel) -> Option<Vec<Column>> {
    let (_, encoding, table) = &*channel.schema;
    if encoding != WIRE {
        return None;
    }
    let mut columns = Vec::new();
    for line in std::str::from_utf8(table).ok()?.lines().skip(1) {
        let mut words = line.split(' ');
        let (name, offset, _, kind) = (words.next()?, words.next()?, words.next()?, words.next()?);
        let offset: usize = offset.parse().ok()?;
        let (kind, count) = kind.split_once('*').map_or((kind, Some(1)), |(kind, n)| (kind, n.parse().ok()));
        let number = NUMBERS.iter().position(|(name, ..)| *name == kind);
        let (Some(number), Some(count)) = (number, count) else { continue };
        let size = NUMBERS.get(number).map_or(0, |(_, size, _)| *size);
        if count > LONGEST_ARRAY || columns.len() > MOST_COLUMNS {
            continue;
        }
        for index in 0..count {
            let name = format!("{} [{}]", entry(name, count, index), unit(name));
            columns.push(Column { name, offset: offset.checked_add(index * size)?, number });
        }
    }
    Some(columns)
}

/// Entry `index` of a field with `count` of them: by number, or by name where the entries have names.
fn entry(field: &str, count: usize, index: usize) -> String {
    let stage = Stage::ALL.get(index).filter(|_| field == "stage_ns" && count == Stage::ALL.len());
    match stage {
        Some(stage) => format!("{field}[{stage}]"),
        None if count == 1 => field.to_owned(),
        None => format!("{field}[{index}]"),
    }
}

/// The unit of a field, which is the end of its name for most.
fn unit(field: &str) -> &'static str {
    match field {
        "q" | "joints_q" | "measured_q" => "rad",
        "qd" | "joints_qd" => "rad/s",
        _ => match field.rsplit('_').next() {
            Some("ns") => "ns",
            Some("s") => "s",
            Some("m") => "m",
            Some("mps") => "m/s",
            Some("mps2") => "m/s²",
            Some("mps3") => "m/s³",
            Some("rad") => "rad",
            Some("radps") => "rad/s",
            Some("hz") => "Hz",
            _ => "1",
        },
    }
}

/// The columns of `channel` whose field is in `fields`, or all.
fn chosen(channel: &Channel, fields: &[String]) -> Result<Vec<Column>, String> {
    let topic = &channel.name;
    let all =
        columns(channel).ok_or_else(|| format!("{topic} has no table of numbers; raw topics have one"))?;
    let known: Vec<&str> = all.iter().map(Column::field).collect();
    if let Some(unknown) = fields.iter().find(|field| !known.contains(&field.as_str())) {
        let mut names = known.clone();
        names.dedup();
        return Err(format!("{topic} has no field {unknown}; there are: {}", names.join(", ")));
    }
    let wanted = |column: &Column| fields.is_empty() || fields.iter().any(|field| field == column.field());
    Ok(all.into_iter().filter(wanted).collect())
}

/// Writes every `every`-th message of the raw topic `topic` as CSV, with the columns whose field is in
/// `fields`, or all. Returns how many rows there are.
///
/// # Errors
///
/// No such topic or field; the file or the output fails.
pub fn csv(
    reader: &mut RecordingReader,
    topic: &str,
    every: u64,
    fields: &[String],
    out: &mut impl Write,
) -> Result<u64, RecordError> {
    let path = reader.path().to_path_buf();
    let wrong = |why: String| RecordError::Format { path: path.clone(), why };
    let failed = |source| RecordError::Write { path: "the CSV".into(), source };
    let mut tables: BTreeMap<u16, Vec<Column>> = BTreeMap::new();
    let mut header: Option<Vec<String>> = None;
    let (mut seen, mut rows) = (0_u64, 0);
    while let Some(entry) = reader.next_entry()? {
        let RecordingEntry::Message(message) = entry else { continue };
        let Some(channel) = reader.channels().get(&message.channel) else { continue };
        if channel.name != topic {
            continue;
        }
        let table = match tables.entry(message.channel) {
            Slot::Occupied(known) => known.into_mut(),
            Slot::Vacant(new) => {
                let table = chosen(channel, fields).map_err(wrong)?;
                let names: Vec<String> = table.iter().map(|column| column.name.clone()).collect();
                match &header {
                    None => {
                        writeln!(out, "time [ns since 1970],{}", names.join(",")).map_err(failed)?;
                        header = Some(names);
                    }
                    Some(first) if *first == names => {}
                    Some(_) => {
                        return Err(wrong(format!("{topic} changes its layout in the middle of the file")));
                    }
                }
                new.insert(table)
            }
        };
        seen += 1;
        if !(seen - 1).is_multiple_of(every.max(1)) {
            continue;
        }
        let mut row = message.time_ns.to_string();
        for column in table.iter() {
            let bytes = message.data.get(column.offset..).unwrap_or_default();
            row.push(',');
            row.extend(NUMBERS.get(column.number).and_then(|(.., as_text)| as_text(bytes)));
        }
        writeln!(out, "{row}").map_err(failed)?;
        rows += 1;
    }
    out.flush().map_err(failed)?;
    if header.is_none() {
        let why = format!("it holds no message of {topic}");
        let otherwise = || wrong(format!("{why}; `foretrace record --info` lists its topics"));
        return Err(reader.lack(&why).unwrap_or_else(otherwise));
    }
    Ok(rows)
}
