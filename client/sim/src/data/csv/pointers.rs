//! Of rows of several pointers, those of the pen, one pointer at a time.

use super::events::PenEvent;
use super::reading::CsvReading;
use crate::data::Remark;
use std::collections::{BTreeMap, HashMap};

/// Leaves the rows of one pointer: the pen's where there is one, and one at a time; of events that a browser
/// tells twice, as a pointer's and as a mouse's, the pointer's.
pub(super) fn one_pointer(readings: &mut Vec<CsvReading>, remarks: &mut Vec<Remark>) {
    let before = readings.len();
    readings.retain(|reading| reading.primary);
    if readings.iter().any(|reading| reading.pen == Some(true)) {
        readings.retain(|reading| reading.pen != Some(false));
    }
    let family = readings.iter().filter_map(|reading| reading.event).map(|(family, _)| family).max();
    // A row without an event goes on as the one before.
    readings.retain(|reading| reading.event.is_none_or(|(of, _)| Some(of) == family));
    if readings.iter().any(|reading| matches!(reading.event, Some((_, PenEvent::Down)))) {
        by_events(readings);
    } else {
        by_spans(readings);
    }
    let left_out = (before - readings.len()) as u64;
    remarks.extend(Remark::counted(left_out, "rows are of other pointers, and are left out"));
}

/// A pointer that is down has the word until it is up.
fn by_events(readings: &mut Vec<CsvReading>) {
    let mut down: Option<u64> = None;
    readings.retain(|reading| {
        let kept = reading.pointer.zip(down).is_none_or(|(pointer, down)| pointer == down);
        if kept && let Some((_, event)) = reading.event {
            match event {
                PenEvent::Down => down = reading.pointer,
                PenEvent::Up => down = None,
                PenEvent::Move | PenEvent::Hover => {}
            }
        }
        kept
    });
}

/// Of pointers that are there at the same time, the one with most rows stays, of as many the first.
fn by_spans(readings: &mut Vec<CsvReading>) {
    struct Span {
        first: usize,
        last: usize,
        rows: usize,
    }
    let mut spans: HashMap<u64, Span> = HashMap::new();
    for (row, reading) in readings.iter().enumerate() {
        if let Some(pointer) = reading.pointer {
            let span = spans.entry(pointer).or_insert(Span { first: row, last: row, rows: 0 });
            (span.last, span.rows) = (row, span.rows + 1);
        }
    }
    if spans.len() < 2 {
        return;
    }
    let mut by_rows: Vec<(u64, Span)> = spans.into_iter().collect();
    by_rows.sort_by_key(|(_, span)| (std::cmp::Reverse(span.rows), span.first));
    // From first to last row, and whose: none overlaps another.
    let mut taken: BTreeMap<usize, (usize, u64)> = BTreeMap::new();
    for (pointer, span) in by_rows {
        let before = taken.range(..=span.last).next_back();
        if before.is_none_or(|(_, (last, _))| *last < span.first) {
            taken.insert(span.first, (span.last, pointer));
        }
    }
    let mut row = 0;
    readings.retain(|reading| {
        let here = taken.range(..=row).next_back().map(|(_, (_, pointer))| *pointer);
        row += 1;
        reading.pointer.is_none() || reading.pointer == here
    });
}
