//! Raw topics as tables of numbers, by the layout that the file itself names.
//!
//! Contract: needs nothing of this program's layouts, so that recordings of other versions are read too. A
//! layout whose fields do not lie in the message, or have one name, is refused. A CSV leaves out what is not
//! a number (names, nested messages).

use std::collections::btree_map::Entry as Slot;
use std::collections::{BTreeMap, HashSet};
use std::io::Write;

use foretrace_shm::{PATH_POINTS, Stage};
use foretrace_sim::data::shortened;

use crate::RecordError;
use crate::read::{Channel, RecordingEntry, RecordingReader};
use crate::topics::WIRE;

/// What the messages of a raw topic are made of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawLayout {
    /// Bytes of a message; 0: they differ in size.
    pub size: usize,
    /// In the order of the table.
    pub fields: Vec<RawField>,
}

/// A field of a raw topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawField {
    pub name: String,
    /// Of its first byte in the message.
    pub offset: usize,
    /// How many numbers it is, or bytes.
    pub count: usize,
    /// Place of its type in [`NUMBERS`]; `None`: bytes that are no numbers.
    number: Option<usize>,
}

impl RawField {
    /// Type of its numbers (`u8` to `u64`, `i32`, `i64`, `f32`, `f64`); `None`: bytes that are no numbers.
    #[must_use]
    pub fn number(&self) -> Option<&'static str> {
        NUMBERS.get(self.number?).map(|(name, ..)| *name)
    }
}

/// A column of numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Column {
    /// Field, with an index for arrays, and unit.
    name: String,
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
/// Columns and fields of one topic at most: a forged table must not fill the memory.
const MOST_COLUMNS: usize = 4096;
/// Characters of a forged name in a message.
const TOLD: usize = 60;

/// The layout of a raw channel, as its file names it; `None`: the channel is not raw.
///
/// # Errors
///
/// What is wrong with it.
pub fn layout(channel: &Channel) -> Result<Option<RawLayout>, String> {
    let (_, encoding, table) = &*channel.schema;
    if encoding != WIRE {
        return Ok(None);
    }
    let text = std::str::from_utf8(table).map_err(|_| "it is no text".to_owned())?;
    let mut lines = text.lines();
    let head = lines.next().unwrap_or_default();
    let size = head.split(' ').nth(3).and_then(|size| size.parse().ok());
    let size: usize = size.ok_or("its first line names no size")?;
    let (mut fields, mut names) = (Vec::new(), HashSet::new());
    for line in lines {
        let named = || shortened(line.split(' ').next().unwrap_or_default(), TOLD);
        let field = field(line, size)
            .ok_or_else(|| format!("its field {:?} does not lie in the message", named()))?;
        if !names.insert(line.split(' ').next()) {
            return Err(format!("it has two fields {:?}", named()));
        }
        if fields.len() == MOST_COLUMNS {
            return Err(format!("it has more than {MOST_COLUMNS} fields"));
        }
        fields.push(field);
    }
    Ok(Some(RawLayout { size, fields }))
}

/// The field of a line `name offset length type`, if it lies in a message of `size`.
fn field(line: &str, size: usize) -> Option<RawField> {
    let mut words = line.split(' ');
    let (name, offset, length, kind) = (words.next()?, words.next()?, words.next()?, words.next()?);
    let (offset, length): (usize, usize) = (offset.parse().ok()?, length.parse().ok()?);
    let (kind, count) = kind.split_once('*').map_or((kind, None), |(kind, count)| (kind, Some(count)));
    let number = NUMBERS.iter().position(|(name, ..)| *name == kind);
    let (count, bytes) = match number.and_then(|number| NUMBERS.get(number)) {
        Some((_, bytes, _)) => (count.map_or(Some(1), |count| count.parse().ok())?, *bytes),
        None => (length, 1),
    };
    let is_in = size == 0 || offset.checked_add(length)? <= size;
    let fits = !name.is_empty() && count > 0 && bytes.checked_mul(count)? == length && is_in;
    fits.then(|| RawField { name: name.to_owned(), offset, count, number })
}

/// The columns of a layout.
fn columns(layout: &RawLayout) -> Vec<Column> {
    let mut columns = Vec::new();
    for RawField { name, offset, count, number } in &layout.fields {
        let Some(number) = *number else { continue };
        let size = NUMBERS.get(number).map_or(0, |(_, size, _)| *size);
        if *count > LONGEST_ARRAY || columns.len() > MOST_COLUMNS {
            continue;
        }
        for index in 0..*count {
            let name = format!("{} [{}]", entry(name, *count, index), unit(name));
            columns.push(Column { name, offset: offset.saturating_add(index * size), number });
        }
    }
    columns
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
    let damaged = |why| format!("the layout of {topic} is damaged: {why}; take its other topics");
    let layout = layout(channel).map_err(damaged)?;
    let layout = layout.ok_or_else(|| format!("{topic} has no table of numbers; raw topics have one"))?;
    let all = columns(&layout);
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
