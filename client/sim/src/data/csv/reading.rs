//! What a row says, before it is known what the others say.

use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher};

use super::clock::CsvMoment;
use super::events::{EventColumn, EventFamily, PenEvent, pen_event};
use super::names::Columns;
use super::number::{is_blank, number};
use super::table::Row;

pub(super) const POSITION_MAX_M: f64 = 100.0;
const POSITION_MAX_RAW: f64 = 1e9;
/// Of names of pointers, which are only compared.
const HASH: BuildHasherDefault<DefaultHasher> = BuildHasherDefault::new();

/// What a row says.
#[derive(Debug, Clone, Copy)]
pub(super) struct CsvReading {
    pub(super) moment: CsvMoment,
    /// `None`: the pen was not seen.
    pub(super) place: Option<[f64; 2]>,
    /// Of a column of contact, then what is made of all.
    pub(super) contact: Option<bool>,
    /// The column of contact says that nothing changes.
    pub(super) goes_on: bool,
    pub(super) event: Option<(EventFamily, PenEvent)>,
    /// The column of events tells of something else here.
    pub(super) is_other: bool,
    /// 0 or 1 in a column `state`.
    pub(super) state: Option<bool>,
    pub(super) button: Option<bool>,
    pub(super) pressed: Option<bool>,
    pub(super) pen: Option<bool>,
    pub(super) primary: bool,
    pub(super) pointer: Option<u64>,
}

pub(super) struct RowReader<'h> {
    columns: &'h Columns,
    place_m: Option<[f64; 2]>,
    /// A row had an event of a pen.
    pub(super) told_events: bool,
    /// Rows with other events than a pen's.
    pub(super) other_events: u64,
    /// Rows without place and time.
    pub(super) empty: u64,
}

impl<'h> RowReader<'h> {
    /// `place_m`: metres per unit of x and y.
    pub(super) fn new(columns: &'h Columns, place_m: Option<[f64; 2]>) -> Self {
        Self { columns, place_m, told_events: false, other_events: 0, empty: 0 }
    }

    /// `None`: a row of another kind of event, or without contents.
    ///
    /// # Errors
    /// Field, value and what is legal.
    pub(super) fn read(&mut self, row: &Row<'_>) -> Result<Option<CsvReading>, String> {
        let columns = self.columns;
        let filled = |column: usize| Some(row.cell(column)).filter(|cell| !is_blank(cell));
        let told = columns.event.and_then(|(column, kind)| Some((kind, filled(column)?)));
        let event = told.and_then(|(kind, text)| kind.event(text));
        let state = told.filter(|(kind, _)| *kind == EventColumn::State).and_then(|(_, text)| truth(text));
        let is_other = told.is_some() && event.is_none() && state.is_none();
        self.told_events |= event.is_some();
        if is_other {
            self.other_events += 1;
            // A row of a key or a window has no position; in a column that tells no events, all are samples.
            if self.told_events {
                return Ok(None);
            }
        }
        let cell = |column: usize| row.cell(column);
        let name = |column: usize| columns.names.get(column).map_or("", String::as_str);
        let [x, y] = columns.place;
        // Half a position is a fault of the file, none is a pen that was not seen.
        let place = if filled(x).is_none() && filled(y).is_none() {
            None
        } else {
            let metres = self.place_m.map_or([None; 2], |m| m.map(Some));
            Some([coordinate(name(x), cell(x), metres[0])?, coordinate(name(y), cell(y), metres[1])?])
        };
        if place.is_none() && filled(columns.t).is_none() {
            self.empty += 1;
            return Ok(None);
        }
        let t = number(cell(columns.t)).filter(|t| t.abs() < 1e20);
        let t = t.ok_or_else(|| bad(name(columns.t), cell(columns.t), "a number"))?;
        let flag = |column: Option<usize>, inverted: bool| {
            let filled = column.and_then(|column| Some((name(column), filled(column)?)));
            filled.map(|(name, text)| flag(name, text, inverted)).transpose()
        };
        let contact = match flag(columns.contact, false)? {
            None => flag(columns.hover, true)?,
            told => told,
        };
        let measured = |column: Option<usize>| column.and_then(|column| number(cell(column)));
        let of_pointer = |column: Option<usize>| column.and_then(filled);
        let says_no = |text: &str| truth(text) == Some(false);
        Ok(Some(CsvReading {
            moment: CsvMoment::new(t, cell(columns.t)),
            place,
            contact: contact.flatten(),
            goes_on: contact == Some(None),
            event,
            is_other,
            state,
            button: measured(columns.buttons).map(|buttons| buttons as i64 & 1 == 1),
            pressed: measured(columns.pressure).map(|pressure| pressure > 0.0),
            pen: of_pointer(columns.pointer_type).map(is_pen),
            primary: !of_pointer(columns.primary).is_some_and(says_no),
            pointer: of_pointer(columns.pointer_id).map(|id| HASH.hash_one(id)),
        }))
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

/// A word or number of truth.
fn truth(text: &str) -> Option<bool> {
    if let Some(value) = number(text) {
        return [(0.0, false), (1.0, true)].iter().find(|(v, _)| *v == value).map(|(_, truth)| *truth);
    }
    Some(match text.to_ascii_lowercase().as_str() {
        "true" | "t" | "yes" | "y" | "on" => true,
        "false" | "f" | "no" | "n" | "off" | "none" => false,
        _ => return None,
    })
}

/// Whether a cell says that the pen touches the paper; `None`: as before. Words of a pen mean the same in
/// every column, those of truth the opposite where the column is about hovering.
fn flag(name: &str, text: &str, inverted: bool) -> Result<Option<bool>, String> {
    if let Some(truth) = truth(text) {
        return Ok(Some(truth != inverted));
    }
    match pen_event(text) {
        Some((_, PenEvent::Down)) => Ok(Some(true)),
        Some((_, PenEvent::Up | PenEvent::Hover)) => Ok(Some(false)),
        Some((_, PenEvent::Move)) => Ok(None),
        None => Err(bad(name, text, "0, 1, false, true")),
    }
}

fn is_pen(text: &str) -> bool {
    // TOOL_TYPE_STYLUS of Android is 2.
    matches!(text.to_ascii_lowercase().as_str(), "pen" | "stylus" | "tool_type_stylus" | "2")
}
