//! From rows to samples: time from the first sample on, lengths in metres, contact from whatever tells it.

use super::events::{EventFamily, PenEvent, pen_event};
use super::names::{Columns, CsvUnits};
use super::table::{Header, Row, each_row, number};
use crate::data::Remark;
use crate::data::stamps::{StampJudge, StampVerdict, merged};
use crate::path::PathSample;

/// Times of a clock that counts from its start \[s\]: a longer one counts from 1970.
const CLOCK_MAX_S: f64 = 1e8;
/// No clock counts so far \[s\]: the unit is a thousandth of what was said.
const TIME_MAX_S: f64 = 1e11;
pub(super) const POSITION_MAX_M: f64 = 100.0;
const POSITION_MAX_RAW: f64 = 1e9;
const SAMPLES_MAX: usize = 16 << 20;

/// The samples of a file.
#[derive(Debug, Default)]
pub(super) struct CsvSamples {
    /// Times rise; positions in metres where `metric`, else in the file's own unit, y upwards.
    pub(super) samples: Vec<PathSample>,
    pub(super) metric: bool,
    pub(super) remarks: Vec<Remark>,
}

/// What a row says.
#[derive(Debug, Clone, Copy)]
struct Reading {
    t: f64,
    /// `None`: the pen was not seen.
    place: Option<[f64; 2]>,
    contact: Option<bool>,
    event: Option<(EventFamily, PenEvent)>,
    pressed: Option<bool>,
    pen: bool,
    pointer: u64,
}

/// Reads the rows below `header`.
///
/// # Errors
/// Line (0: the whole file) and reason: a field that is no number or out of range, stamps that are no clock.
pub(super) fn samples(text: &str, header: &Header, units: CsvUnits) -> Result<CsvSamples, (usize, String)> {
    let columns = &header.columns;
    let place_m = columns.place_m.or(units.length_m.map(|metres| [metres; 2]));
    let mut reader = RowReader { columns, place_m, told_events: false, other_events: 0 };
    let mut readings: Vec<Reading> = Vec::new();
    each_row(text, header, |row| {
        if readings.len() == SAMPLES_MAX {
            return Err(format!("more than {SAMPLES_MAX} rows; cut the file into several"));
        }
        readings.extend(reader.read(row)?);
        Ok(())
    })?;
    let (told_events, other_events) = (reader.told_events, reader.other_events);
    let mut remarks = Vec::new();
    if header.above > 0 {
        remarks.push(Remark::new("the lines above the header are passed over"));
    }
    remarks.extend(unused(columns, told_events));
    if told_events {
        remarks.extend(Remark::counted(other_events, "rows are events of other kinds, and are left out"));
        one_pointer(&mut readings, &mut remarks);
    }
    touches(&mut readings, told_events, &mut remarks);
    let unit_s = unit_of_time(&readings, columns.t_unit_s.or(units.time_s), &mut remarks);
    let begin = readings.first().map_or(0.0, |reading| reading.t);
    let begin = if (begin * unit_s).abs() > CLOCK_MAX_S { begin } else { 0.0 };
    let of_screen = |reading: &Reading| reading.event.is_some_and(|(family, _)| family.is_of_screen());
    let y_down = columns.y_down || (place_m.is_none() && readings.iter().any(of_screen));
    let y_by = if y_down { -1.0 } else { 1.0 };
    let [x_by, y_by] = place_m.map_or([1.0, y_by], |[x, y]| [x, y * y_by]);
    let mut judge = StampJudge::default();
    let mut samples: Vec<PathSample> = Vec::new();
    let mut unseen = 0;
    for reading in readings {
        let Some([x, y]) = reading.place else {
            // The pen is away: what follows is not the same stroke.
            unseen += 1;
            continue;
        };
        let point = [x * x_by, y * y_by];
        let contact = reading.contact.unwrap_or(true);
        let t_s = (reading.t - begin) * unit_s;
        match (judge.judge(t_s), samples.last_mut()) {
            (StampVerdict::Merge(share), Some(last)) => {
                [last.x_m, last.y_m] = merged([last.x_m, last.y_m], point, share);
                // The last word counts: an event that lifts the pen has the stamp of its last motion.
                last.contact = contact;
            }
            (StampVerdict::Backwards, _) => {}
            _ => samples.push(PathSample { t_s, x_m: point[0], y_m: point[1], contact }),
        }
    }
    remarks.extend(Remark::counted(unseen, "rows have no position, and are left out"));
    remarks.extend(judge.remarks().map_err(|why| (0, why))?);
    Ok(CsvSamples { samples, metric: place_m.is_some(), remarks })
}

struct RowReader<'h> {
    columns: &'h Columns,
    place_m: Option<[f64; 2]>,
    /// A row had an event of a pen.
    told_events: bool,
    other_events: u64,
}

impl RowReader<'_> {
    /// `None`: a row of another kind of event.
    fn read(&mut self, row: &Row<'_>) -> Result<Option<Reading>, String> {
        let columns = self.columns;
        let event = columns.event.map(|column| pen_event(row.cell(column)));
        self.told_events |= matches!(event, Some(Some(_)));
        if matches!(event, Some(None)) {
            self.other_events += 1;
            // A row of a key or a window has no position; in a column that tells no events, all are samples.
            if self.told_events {
                return Ok(None);
            }
        }
        let cell = |column: usize| row.cell(column);
        let name = |column: usize| columns.names.get(column).map_or("", String::as_str);
        let t = number(cell(columns.t)).filter(|t| t.abs() < 1e20);
        let t = t.ok_or_else(|| bad(name(columns.t), cell(columns.t), "a number"))?;
        let [x, y] = columns.place;
        let place = if cell(x).is_empty() && cell(y).is_empty() {
            None
        } else {
            let metres = self.place_m.map_or([None; 2], |m| m.map(Some));
            Some([coordinate(name(x), cell(x), metres[0])?, coordinate(name(y), cell(y), metres[1])?])
        };
        let flag = |column: Option<usize>| {
            column.map(|column| flag(name(column), cell(column))).transpose().map(Option::flatten)
        };
        let contact = flag(columns.contact)?.or(flag(columns.hover)?.map(|hover| !hover));
        let measured = |column: Option<usize>| column.and_then(|column| number(cell(column)));
        let pressed = measured(columns.buttons).map(|buttons| buttons as i64 & 1 == 1);
        let pressed = pressed.or_else(|| measured(columns.pressure).map(|pressure| pressure > 0.0));
        let pen = columns.pointer_type.is_some_and(|column| is_pen(cell(column)));
        let primary = columns.primary.is_none_or(|column| !cell(column).eq_ignore_ascii_case("false"));
        let pointer = columns.pointer_id.map_or(0, |column| fingerprint(cell(column)));
        Ok(primary.then_some(Reading { t, place, contact, event: event.flatten(), pressed, pen, pointer }))
    }
}

fn bad(field: &str, value: &str, legal: &str) -> String {
    format!("{field} is {:?}; legal: {legal}", crate::data::shortened(value, 40))
}

fn coordinate(name: &str, text: &str, metres: Option<f64>) -> Result<f64, String> {
    let most = metres.map_or(POSITION_MAX_RAW, |metres| POSITION_MAX_M / metres);
    let value = number(text).filter(|value| value.abs() <= most);
    value.ok_or_else(|| bad(name, text, &format!("a number in [-{most}, {most}]")))
}

/// Empty cells say nothing.
fn flag(name: &str, text: &str) -> Result<Option<bool>, String> {
    Ok(Some(match text.to_ascii_lowercase().as_str() {
        "" => return Ok(None),
        "1" | "1.0" | "true" | "t" | "yes" | "y" | "on" | "down" | "contact" | "touch" => true,
        "0" | "0.0" | "false" | "f" | "no" | "n" | "off" | "up" | "hover" | "none" => false,
        _ => return Err(bad(name, text, "0, 1, false, true")),
    }))
}

fn is_pen(text: &str) -> bool {
    // TOOL_TYPE_STYLUS of Android is 2.
    matches!(text.to_ascii_lowercase().as_str(), "pen" | "stylus" | "tool_type_stylus" | "2")
}

fn fingerprint(text: &str) -> u64 {
    text.bytes()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}

/// Names the columns that were not needed.
fn unused(columns: &Columns, told_events: bool) -> Option<Remark> {
    let tells = if told_events {
        [columns.event, columns.buttons, columns.pressure]
    } else if columns.contact.is_some() || columns.hover.is_some() {
        [columns.contact.or(columns.hover), None, None]
    } else {
        [columns.buttons.or(columns.pressure), None, None]
    };
    let of_pointers = [columns.pointer_type, columns.pointer_id, columns.primary];
    let [x, y] = columns.place;
    let used: Vec<usize> =
        [columns.t, x, y].into_iter().chain(tells.into_iter().chain(of_pointers).flatten()).collect();
    let spare = columns.names.iter().enumerate().filter(|(at, name)| !used.contains(at) && !name.is_empty());
    let spare: Vec<&str> = spare.map(|(_, name)| name.as_str()).collect();
    let names = crate::data::shortened(&spare.join(", "), 200);
    match spare.len() {
        0 => None,
        1 => Some(Remark::new(format!("the column {names} is not used"))),
        _ => Some(Remark::new(format!("the columns {names} are not used"))),
    }
}

/// Leaves the rows of one pointer: the pen's where there is one, and one at a time; of events that a browser
/// tells twice, as a pointer's and as a mouse's, the pointer's.
fn one_pointer(readings: &mut Vec<Reading>, remarks: &mut Vec<Remark>) {
    let before = readings.len();
    if readings.iter().any(|reading| reading.pen) {
        readings.retain(|reading| reading.pen);
    }
    let family = readings.iter().filter_map(|reading| reading.event).map(|(family, _)| family).max();
    readings.retain(|reading| reading.event.map(|(family, _)| family) == family);
    let mut down: Option<u64> = None;
    readings.retain(|reading| {
        let kept = down.is_none_or(|pointer| pointer == reading.pointer);
        if kept && let Some((_, event)) = reading.event {
            match event {
                PenEvent::Down => down = Some(reading.pointer),
                PenEvent::Up => down = None,
                PenEvent::Move | PenEvent::Hover => {}
            }
        }
        kept
    });
    let left_out = (before - readings.len()) as u64;
    remarks.extend(Remark::counted(left_out, "rows are of other pointers, and are left out"));
}

/// Fills in `contact`: what a column of contact says, else events, else buttons or pressure.
fn touches(readings: &mut [Reading], told_events: bool, remarks: &mut Vec<Remark>) {
    // Some drivers report no pressure and no buttons at all.
    let pressure_tells = readings.iter().any(|reading| reading.pressed == Some(true));
    if told_events {
        let lands = readings.iter().any(|reading| matches!(reading.event, Some((_, PenEvent::Down))));
        let mut down: Option<bool> = None;
        for reading in readings.iter_mut() {
            match reading.event.map(|(_, event)| event) {
                Some(PenEvent::Down) => down = Some(true),
                Some(PenEvent::Up | PenEvent::Hover) => down = Some(false),
                Some(PenEvent::Move) | None => {}
            }
            let moves = matches!(reading.event, Some((_, PenEvent::Move)));
            let lifted = moves && pressure_tells && reading.pressed == Some(false);
            // A file may begin in the middle of a stroke.
            let unknown = reading.pressed.filter(|_| pressure_tells).or(lands.then_some(false));
            reading.contact = if lifted { Some(false) } else { down.or(unknown) };
        }
    } else if pressure_tells && readings.iter().all(|reading| reading.contact.is_none()) {
        readings.iter_mut().for_each(|reading| reading.contact = reading.pressed);
    }
    if readings.iter().all(|reading| reading.contact.is_none()) {
        remarks.push(Remark::new("nothing tells when the pen touches the paper: all samples count as ink"));
    } else {
        let mut last = None;
        for reading in readings {
            last = reading.contact.or(last);
            reading.contact = last;
        }
    }
}

/// Seconds per unit of the column of time: as stated, unless no clock counts so far; else by the steps, of
/// which a pen has from 2.5 to 2500 a second.
fn unit_of_time(readings: &[Reading], stated_s: Option<f64>, remarks: &mut Vec<Remark>) -> f64 {
    let farthest = readings.iter().map(|reading| reading.t.abs()).fold(0.0, f64::max);
    let mut unit_s = stated_s.unwrap_or_else(|| {
        let mut steps: Vec<f64> =
            readings.windows(2).map(|w| w[1].t - w[0].t).filter(|step| *step > 0.0).collect();
        steps.sort_by(f64::total_cmp);
        let step = steps.get(steps.len() / 2).copied().unwrap_or(0.0);
        [(0.4, 1.0), (400.0, 1e-3), (4e5, 1e-6)]
            .into_iter()
            .find(|(most, _)| step < *most)
            .map_or(1e-9, |(_, s)| s)
    });
    while farthest * unit_s > TIME_MAX_S {
        unit_s *= 1e-3;
    }
    if stated_s != Some(unit_s) {
        let name = [(1.0, "seconds"), (1e-3, "milliseconds"), (1e-6, "microseconds"), (1e-9, "nanoseconds")];
        let near = |(s, _): &&(f64, &str)| (s / unit_s - 1.0).abs() < 0.01;
        let name = name.iter().find(near).map_or("a smaller unit", |(_, name)| name);
        let why = if stated_s.is_some() {
            "as large as its numbers are"
        } else {
            "by its steps; name it t_s, t_ms, ... or give --unit"
        };
        remarks.push(Remark::new(format!("the time is taken as {name}, {why}")));
    }
    unit_s
}
