//! When the pen touches the paper: from whichever column tells it.

use super::events::{EventColumn, PenEvent};
use super::names::Columns;
use super::reading::CsvReading;
use crate::data::Remark;

/// What tells of contact in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ContactTeller {
    Events,
    Contact,
    State,
    Buttons,
    Pressure,
    Nothing,
}

impl ContactTeller {
    /// Events that land or lift the pen; else a column of contact, or a plain state; else buttons, where one
    /// is the tip; else pressure; else events that only tell hovering from motion.
    fn of(readings: &[CsvReading], columns: &Columns) -> Self {
        let any = |says: &dyn Fn(&CsvReading) -> bool| readings.iter().any(says);
        let event = |wanted: PenEvent| any(&|r| matches!(r.event, Some((_, event)) if event == wanted));
        let (lands, lifts) = (event(PenEvent::Down), event(PenEvent::Up));
        // A phase may be that of an experiment: its numbers begin and end strokes, or are none.
        let is_phase = matches!(columns.event, Some((_, EventColumn::Phase)));
        if if is_phase { lands && lifts } else { lands || lifts } {
            Self::Events
        } else if any(&|r| r.contact.is_some()) {
            Self::Contact
        } else if any(&|r| r.state.is_some()) && !any(&|r| r.is_other) {
            Self::State
        } else if any(&|r| r.button == Some(true)) {
            Self::Buttons
        } else if any(&|r| r.pressed == Some(true)) {
            Self::Pressure
        } else if event(PenEvent::Hover) {
            Self::Events
        } else {
            Self::Nothing
        }
    }

    /// The columns that were of use.
    pub(super) fn columns(self, columns: &Columns) -> [Option<usize>; 3] {
        let event = columns.event.map(|(column, _)| column);
        match self {
            Self::Events => [event, columns.buttons, columns.pressure],
            Self::Contact => [columns.contact, columns.hover, None],
            Self::State => [event, None, None],
            Self::Buttons => [columns.buttons, None, None],
            Self::Pressure => [columns.pressure, None, None],
            Self::Nothing => [None; 3],
        }
    }
}

/// Fills in `contact` of all rows.
pub(super) fn touches(
    readings: &mut [CsvReading],
    columns: &Columns,
    remarks: &mut Vec<Remark>,
) -> ContactTeller {
    let teller = ContactTeller::of(readings, columns);
    match teller {
        ContactTeller::Events => by_events(readings),
        ContactTeller::Contact => {}
        ContactTeller::State => readings.iter_mut().for_each(|reading| reading.contact = reading.state),
        ContactTeller::Buttons => readings.iter_mut().for_each(|reading| reading.contact = reading.button),
        ContactTeller::Pressure => {
            // A pen that is away has no pressure.
            let unsaid = readings.iter().filter(|r| r.pressed.is_none() && r.place.is_some()).count();
            remarks.extend(Remark::counted(unsaid as u64, "rows have no pressure, and count as hovering"));
            for reading in readings.iter_mut() {
                reading.contact = Some(reading.pressed.unwrap_or(false));
            }
        }
        ContactTeller::Nothing => {
            remarks
                .push(Remark::new("nothing tells when the pen touches the paper: all samples count as ink"));
        }
    }
    if matches!(teller, ContactTeller::Contact | ContactTeller::State | ContactTeller::Buttons) {
        fill(readings, remarks);
    }
    carry_on(readings);
    teller
}

fn by_events(readings: &mut [CsvReading]) {
    let any = |wanted: PenEvent| readings.iter().any(|r| matches!(r.event, Some((_, e)) if e == wanted));
    let (lands, lifts) = (any(PenEvent::Down), any(PenEvent::Up));
    // Some drivers report no pressure and no buttons at all, or only those on the pen's side.
    let by_button = readings.iter().any(|reading| reading.button == Some(true));
    let by_pressure = readings.iter().any(|reading| reading.pressed == Some(true));
    let mut down: Option<bool> = None;
    for reading in readings.iter_mut() {
        let pressed = reading.button.filter(|_| by_button).or(reading.pressed.filter(|_| by_pressure));
        match reading.event.map(|(_, event)| event) {
            Some(PenEvent::Down) => down = Some(true),
            Some(PenEvent::Up | PenEvent::Hover) => down = Some(false),
            // The motion of a pen that never lands is on the paper where it is not above it.
            Some(PenEvent::Move) if !lands && !lifts => down = Some(true),
            Some(PenEvent::Move) | None => {}
        }
        let moves = matches!(reading.event, None | Some((_, PenEvent::Move)));
        let lifted = moves && pressed == Some(false);
        // A file may begin in the middle of a stroke.
        let unknown = pressed.or(lands.then_some(false));
        reading.contact = if lifted { Some(false) } else { down.or(unknown) };
    }
}

/// Rows that say nothing of contact: the opposite of those that do, where these all say the same; else as
/// the row before.
fn fill(readings: &mut [CsvReading], remarks: &mut Vec<Remark>) {
    let unsaid = |reading: &CsvReading| reading.contact.is_none() && !reading.goes_on;
    let count = readings.iter().filter(|reading| reading.place.is_some() && unsaid(reading)).count() as u64;
    let says = |wanted: bool| readings.iter().any(|reading| reading.contact == Some(wanted));
    let opposite = match (says(true), says(false)) {
        (true, false) => Some(false),
        (false, true) => Some(true),
        _ => None,
    };
    let what = match opposite {
        Some(false) => "rows say nothing of contact where others say contact, and count as hovering",
        Some(true) => "rows say nothing of contact where others say none, and count as ink",
        None => "rows say nothing of contact, and are as the row before",
    };
    remarks.extend(Remark::counted(count, what));
    for reading in readings.iter_mut().filter(|reading| unsaid(reading)) {
        reading.contact = opposite;
    }
}

fn carry_on(readings: &mut [CsvReading]) {
    let mut last = None;
    for reading in readings {
        last = reading.contact.or(last);
        reading.contact = last;
    }
}
