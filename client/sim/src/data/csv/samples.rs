//! From rows to samples: time from the first sample on, lengths in metres, contact from whatever tells it.

use super::clock::CsvClock;
use super::names::Columns;
use super::pointers::one_pointer;
pub(super) use super::reading::POSITION_MAX_M;
use super::reading::{CsvReading, RowReader};
use super::table::{Header, each_row};
use super::touch::{ContactTeller, touches};
use super::units::CsvUnits;
use crate::data::Remark;
use crate::data::stamps::{StampJudge, StampVerdict, leaps_ahead};
use crate::path::PathSample;

const SAMPLES_MAX: usize = 16 << 20;

/// The samples of a file.
#[derive(Debug, Default)]
pub(super) struct CsvSamples {
    /// Times rise; positions in metres where `metric`, else in the file's own unit, y upwards.
    pub(super) samples: Vec<PathSample>,
    pub(super) metric: bool,
    pub(super) remarks: Vec<Remark>,
}

/// Reads the rows below `header`.
///
/// # Errors
/// Line (0: the whole file) and reason: a field that is no number or out of range, stamps that are no clock.
pub(super) fn samples(header: &Header<'_>, units: CsvUnits) -> Result<CsvSamples, (usize, String)> {
    let columns = &header.columns;
    let place_m = columns.place_m.or(units.length_m.map(|metres| [metres; 2]));
    let mut reader = RowReader::new(columns, place_m);
    let mut readings: Vec<CsvReading> = Vec::new();
    each_row(header, |row| {
        if readings.len() == SAMPLES_MAX {
            return Err(format!("more than {SAMPLES_MAX} rows; cut the file into several"));
        }
        readings.extend(reader.read(row)?);
        Ok(())
    })?;
    let mut remarks = Vec::new();
    if header.above > 0 {
        remarks.push(Remark::new("the lines above the header are passed over"));
    }
    if reader.told_events {
        readings.retain(|reading| !reading.is_other);
        let what = "rows are events of other kinds, and are left out";
        remarks.extend(Remark::counted(reader.other_events, what));
    }
    one_pointer(&mut readings, &mut remarks);
    let teller = touches(&mut readings, columns, &mut remarks);
    remarks.extend(unused(columns, teller));
    // The name of a place that has a unit of length has its own direction, whoever tells the events.
    let of_screen = |reading: &CsvReading| reading.event.is_some_and(|(family, _)| family.is_of_screen());
    let y_down = columns.y_down || (columns.place_m.is_none() && readings.iter().any(of_screen));
    let seen = readings.len();
    readings.retain(|reading| reading.place.is_some());
    let unseen = (seen - readings.len()) as u64 + reader.empty;
    remarks.extend(Remark::counted(unseen, "rows have no position, and are left out"));

    let moments = readings.iter().map(|reading| reading.moment);
    let mut clock = CsvClock::of(moments, columns.t_unit_s.or(units.time_s), &mut remarks);
    let timed = readings.len();
    readings.retain(|reading| clock.has(&reading.moment));
    let untimed = (timed - readings.len()) as u64;
    remarks
        .extend(Remark::counted(untimed, "rows have no time of the clock of the others, and are left out"));
    let times: Vec<f64> = readings.iter().map(|reading| reading.moment.t).collect();
    let ahead = leaps_ahead(&times);
    let mut row = 0;
    readings.retain(|_| {
        row += 1;
        ahead.binary_search(&(row - 1)).is_err()
    });
    clock.begin_at(readings.first().map(|reading| &reading.moment));

    let y_by = if y_down { -1.0 } else { 1.0 };
    let [x_by, y_by] = place_m.map_or([1.0, y_by], |[x, y]| [x, y * y_by]);
    let mut judge = StampJudge::default();
    judge.leave_out_ahead(ahead.len());
    let mut samples: Vec<PathSample> = Vec::new();
    for reading in readings {
        let Some([x, y]) = reading.place else { continue };
        let point = [x * x_by, y * y_by];
        let contact = reading.contact.unwrap_or(true);
        let t_s = clock.seconds(&reading.moment);
        match (judge.judge(t_s), samples.last_mut()) {
            (StampVerdict::Merge(share), Some(last)) => {
                [last.x_m, last.y_m] = judge.merge([last.x_m, last.y_m], point, share);
                // The last word counts: an event that lifts the pen has the stamp of its last motion.
                last.contact = contact;
            }
            (StampVerdict::Backwards, _) => {}
            _ => samples.push(PathSample { t_s, x_m: point[0], y_m: point[1], contact }),
        }
    }
    let of_clock = judge.remarks().map_err(|why| (0, why))?;
    if let Some(coarse) = judge.coarse() {
        return Err((0, coarse));
    }
    remarks.extend(of_clock);
    Ok(CsvSamples { samples, metric: place_m.is_some(), remarks })
}

/// Names the columns that were not needed.
fn unused(columns: &Columns, teller: ContactTeller) -> Option<Remark> {
    let of_pointers = [columns.pointer_type, columns.pointer_id, columns.primary];
    let [x, y] = columns.place;
    let tells = teller.columns(columns).into_iter();
    let used: Vec<usize> = [columns.t, x, y].into_iter().chain(tells.chain(of_pointers).flatten()).collect();
    let spare = columns.names.iter().enumerate().filter(|(at, name)| !used.contains(at) && !name.is_empty());
    let spare: Vec<&str> = spare.map(|(_, name)| name.as_str()).collect();
    let names = crate::data::shortened(&spare.join(", "), 200);
    match spare.len() {
        0 => None,
        1 => Some(Remark::new(format!("the column {names} is not used"))),
        _ => Some(Remark::new(format!("the columns {names} are not used"))),
    }
}
