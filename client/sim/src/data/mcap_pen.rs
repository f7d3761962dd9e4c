//! The pen of foretrace's MCAP recordings: what the ticks of a loop were given, as a data set.
//!
//! Contract: found by the table of fields that a recording carries, so that recordings of any version are
//! read. Read as a stream: memory is for the samples only, and bounded.

use super::csv::{POSITION_MAX_M, RATE_HZ, recording_of};
use super::file::{FileError, open, unreadable};
use super::mcap_record::parse_mcap_record;
use super::mcap_records::{McapEnd, McapRecords};
use super::stamps::{StampJudge, StampVerdict, leaps_ahead};
use super::{Recording, Remark, shortened};
use crate::path::{PathSample, PenPath};
use mcap::records::Record;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufReader, Read, Seek};
use std::path::Path;

/// The topic of what ticks were given, and the encoding of its messages.
const TOPIC: &str = "/raw/input";
const RAW: &str = "/raw/";
const ENCODING: &str = "foretrace.wire";
/// Schemas and channels of ours at most, and slots for samples in a message.
const CHANNELS_MAX: usize = 256;
const SLOTS_MAX: usize = 64;
/// Samples at most: those of five hours at 200 Hz, 128 MB.
const SAMPLES_MAX: usize = 4 << 20;
/// Topics of others that are named at most, and characters of each.
const NAMED: (usize, usize) = (4, 60);

/// A pen sample as a tick was given it, in the pen's own plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PenSeen {
    /// When the pen was there, on the monotonic clock \[ns\].
    pub stamp_ns: u64,
    /// \[m\]
    pub x_m: f64,
    /// \[m\]
    pub y_m: f64,
    /// It touched the paper.
    pub contact: bool,
}

/// Where the pen samples are in a message about a tick.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PenTable {
    part: usize,
    pen_samples: usize,
    /// Stamp, x, y, contact of each slot for a sample.
    slots: Vec<[usize; 4]>,
}

impl PenTable {
    /// From the table of fields of a recording's schema: a line `name offset size type` each, after the first
    /// line. `None`: it does not tell.
    #[must_use]
    pub fn of(table: &str) -> Option<Self> {
        let mut fields = BTreeMap::new();
        for line in table.lines().skip(1) {
            let mut words = line.split(' ');
            if let (Some(name), Some(offset), Some(_), Some(kind)) =
                (words.next(), words.next(), words.next(), words.next())
            {
                fields.insert(name, (offset.parse::<usize>().ok()?, kind));
            }
        }
        let offset_of = |name: &str, kind: &str| {
            fields.get(name).filter(|(_, found)| *found == kind).map(|(offset, _)| *offset)
        };
        let (part, pen_samples) = (offset_of("part", "u32")?, offset_of("pen_samples", "u32")?);
        let of_sample = |index: usize| {
            let of = |field: &str, kind| offset_of(&format!("pen[{index}].{field}"), kind);
            Some([of("stamp_ns", "u64")?, of("x_m", "f64")?, of("y_m", "f64")?, of("contact", "u32")?])
        };
        let slots: Vec<_> = (0..SLOTS_MAX).map_while(of_sample).collect();
        (!slots.is_empty()).then_some(Self { part, pen_samples, slots })
    }

    /// The samples of `message`, oldest first; `None` if it is too short for its table.
    pub fn samples(&self, message: &[u8], mut use_sample: impl FnMut(PenSeen)) -> Option<()> {
        let before = (whole(message, self.part)? as usize).saturating_mul(self.slots.len());
        let here = (whole(message, self.pen_samples)? as usize).saturating_sub(before);
        for [stamp, x, y, contact] in self.slots.iter().take(here) {
            use_sample(PenSeen {
                stamp_ns: u64::from_le_bytes(bytes(message, *stamp)?),
                x_m: f64::from_le_bytes(bytes(message, *x)?),
                y_m: f64::from_le_bytes(bytes(message, *y)?),
                contact: whole(message, *contact)? != 0,
            });
        }
        Some(())
    }
}

fn bytes<const N: usize>(message: &[u8], at: usize) -> Option<[u8; N]> {
    message.get(at..)?.first_chunk().copied()
}

fn whole(message: &[u8], at: usize) -> Option<u32> {
    bytes(message, at).map(u32::from_le_bytes)
}

/// Whether a file begins as this format does.
pub(super) fn begins_mcap(head: &[u8]) -> bool {
    head.starts_with(mcap::MAGIC)
}

/// Loads a recording: one character without a label, a component per change of contact and per gap.
pub(super) fn load_mcap(path: &Path) -> Result<Recording, FileError> {
    let file = open(path)?;
    let length = file.metadata().map_err(|error| unreadable(path, error))?.len();
    read_mcap(BufReader::with_capacity(1 << 16, file), length, path)
}

/// The same from its `length` bytes.
pub(super) fn read_mcap(from: impl Read + Seek, length: u64, path: &Path) -> Result<Recording, FileError> {
    let failed = |error| unreadable(path, error);
    let begun = McapRecords::begin(from, length).map_err(failed)?;
    let mut records = begun.map_err(|why| FileError::whole(path, why))?;
    let mut pen = Pen {
        path,
        tables: BTreeMap::new(),
        channels: BTreeMap::new(),
        others: BTreeSet::new(),
        samples: Vec::new(),
        from_ns: None,
        nowhere: 0,
    };
    let mut refused = None;
    while refused.is_none()
        && let Some((kind, body)) = records.next_record().map_err(failed)?
    {
        match parse_mcap_record(kind, body) {
            Ok(record) => pen.take(record)?,
            Err(why) => refused = Some(why),
        }
    }
    if let Some(why) = refused {
        records.refuse(why);
    }
    let damage = records.end().and_then(McapEnd::damage);
    let (samples, remarks) = pen.in_order()?;
    if samples.len() < 2 {
        return Err(FileError::whole(path, pen.lack(samples.len(), damage)));
    }
    let pen = PenPath::from_samples(samples);
    if !RATE_HZ.contains(&pen.rate_hz) {
        let why =
            format!("the median step in time gives a rate of {} Hz; legal: 0.001 to 1000000", pen.rate_hz);
        return Err(FileError::whole(path, why));
    }
    let mut recording = recording_of(&pen, pen.rate_hz, String::new(), path);
    recording.remarks = remarks;
    recording.damage = damage.map(|damage| {
        format!(
            "it ends early, {damage}; what comes before is read, and `foretrace record --repair` makes a whole \
             file of it"
        )
    });
    Ok(recording)
}

/// Collects the samples of a file.
struct Pen<'a> {
    path: &'a Path,
    /// By the numbers of their schemas.
    tables: BTreeMap<u16, Option<PenTable>>,
    channels: BTreeMap<u16, PenTable>,
    /// Names of other topics, one more than are told.
    others: BTreeSet<String>,
    /// As they come, in whatever order.
    samples: Vec<PathSample>,
    from_ns: Option<u64>,
    /// Samples that are not in this world.
    nowhere: u64,
}

impl Pen<'_> {
    /// The samples in order of time, and what became of the others.
    fn in_order(&mut self) -> Result<(Vec<PathSample>, Vec<Remark>), FileError> {
        let samples = std::mem::take(&mut self.samples);
        let ahead = leaps_ahead(&samples.iter().map(|sample| sample.t_s).collect::<Vec<f64>>());
        let mut judge = StampJudge::default();
        judge.leave_out_ahead(ahead.len());
        let mut taken: Vec<PathSample> = Vec::new();
        for (_, sample) in samples.into_iter().enumerate().filter(|(k, _)| ahead.binary_search(k).is_err()) {
            match (judge.judge(sample.t_s), taken.last_mut()) {
                (StampVerdict::Merge(share), Some(last)) => {
                    let point = judge.merge([last.x_m, last.y_m], [sample.x_m, sample.y_m], share);
                    ([last.x_m, last.y_m], last.contact) = (point, sample.contact);
                }
                (StampVerdict::Backwards, _) => {}
                _ => taken.push(sample),
            }
        }
        let refused = |why: String| FileError::whole(self.path, why);
        let of_stamps = judge.remarks().map_err(refused)?;
        if let Some(coarse) = judge.coarse() {
            return Err(refused(coarse));
        }
        let what =
            format!("samples are no position within {POSITION_MAX_M} m of the origin, and are left out");
        let nowhere = Remark::counted(self.nowhere, &what);
        Ok((taken, of_stamps.into_iter().chain(nowhere).collect()))
    }

    /// Why there is no path: of a damaged file its damage, of another program's its topics.
    fn lack(&self, count: usize, damage: Option<String>) -> String {
        if let Some(damage) = damage {
            return format!("it ends early, {damage}; {count} pen samples stand before that, a path needs 2");
        }
        if !self.channels.is_empty() {
            return format!("it holds {count} pen samples, a path needs 2; record while the pen writes");
        }
        let mut names: Vec<&str> = self.others.iter().take(NAMED.0).map(String::as_str).collect();
        match self.others.len() {
            0 => names.push("it has none"),
            more if more > NAMED.0 => names.push("…"),
            _ => {}
        }
        let names = names.join(", ");
        if self.others.iter().any(|name| name.starts_with(RAW)) {
            return format!(
                "it holds no topic {TOPIC}, where `foretrace record` keeps the pen (its topics: {names}); \
                 record with that topic"
            );
        }
        format!(
            "none of its topics ({names}) is one of `foretrace record`, whose pen is read here; a pen path of \
             another program can be given as CSV with the columns t_s,x_m,y_m,contact"
        )
    }

    fn sample(&mut self, seen: &PenSeen) {
        // A NaN is beyond every bound.
        if !(seen.x_m.abs() <= POSITION_MAX_M && seen.y_m.abs() <= POSITION_MAX_M) {
            self.nowhere += 1;
            return;
        }
        let from_ns = *self.from_ns.get_or_insert(seen.stamp_ns);
        let (ahead, behind) = (seen.stamp_ns.saturating_sub(from_ns), from_ns.saturating_sub(seen.stamp_ns));
        let t_s = if behind > 0 { -(behind as f64) } else { ahead as f64 } * 1e-9;
        self.samples.push(PathSample { t_s, x_m: seen.x_m, y_m: seen.y_m, contact: seen.contact });
    }

    fn take(&mut self, record: Record<'_>) -> Result<(), FileError> {
        if self.tables.len().max(self.channels.len()) > CHANNELS_MAX {
            let why = format!("more than {CHANNELS_MAX} schemas or channels of {TOPIC}");
            return Err(FileError::whole(self.path, why));
        }
        match record {
            Record::Schema { header, data } if header.encoding == ENCODING => {
                self.tables.insert(header.id, std::str::from_utf8(&data).ok().and_then(PenTable::of));
            }
            Record::Channel(channel) if channel.topic == TOPIC => {
                let table = self.tables.get(&channel.schema_id).cloned().flatten().ok_or_else(|| {
                    FileError::whole(self.path, format!("{TOPIC} does not tell where its pen samples are"))
                })?;
                self.channels.insert(channel.id, table);
            }
            Record::Channel(channel) if self.others.len() <= NAMED.0 => {
                self.others.insert(shortened(&channel.topic, NAMED.1));
            }
            Record::Message { header, data } => {
                let Some(table) = self.channels.get(&header.channel_id) else { return Ok(()) };
                let mut here = Vec::with_capacity(SLOTS_MAX);
                table.samples(&data, |seen| here.push(seen)).ok_or_else(|| {
                    FileError::whole(self.path, format!("a message of {TOPIC} is too short"))
                })?;
                here.iter().for_each(|seen| self.sample(seen));
                if self.samples.len() > SAMPLES_MAX {
                    let why = format!("more than {SAMPLES_MAX} pen samples, which is the most that is read");
                    return Err(FileError::whole(self.path, why));
                }
            }
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_found_by_the_table_whatever_else_is_in_it() {
        let table = "layout 0 size 72\npen_samples 0 4 u32\npart 4 4 u32\nnew 8 8 bytes\npen[0].contact 16 4 u32\n\
                     pen[0].y_m 20 8 f64\npen[0].x_m 28 8 f64\npen[0].stamp_ns 36 8 u64\n";
        let found = PenTable::of(table).unwrap();
        let mut message = vec![0; 44];
        message[0] = 3;
        message[16] = 1;
        message[20..28].copy_from_slice(&0.25_f64.to_le_bytes());
        message[28..36].copy_from_slice(&(-0.5_f64).to_le_bytes());
        message[36] = 9;
        let mut seen = Vec::new();
        assert_eq!(found.samples(&message, |sample| seen.push(sample)), Some(()));
        assert_eq!(seen, [PenSeen { stamp_ns: 9, x_m: -0.5, y_m: 0.25, contact: true }]);
        // The part after the last sample, and a message that is too short.
        message[4] = 3;
        assert_eq!(found.samples(&message, |_| panic!("none is left")), Some(()));
        message[4] = 0;
        assert_eq!(found.samples(&message[..40], |_| ()), None);
        for wrong in
            ["", "layout\npart 4 4 u32\n", &table.replace("f64", "f32"), &table.replace("pen[0]", "p")]
        {
            assert_eq!(PenTable::of(wrong), None, "{wrong}");
        }
    }
}
