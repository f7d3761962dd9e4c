//! Ticks as a Perfetto trace: wake-up and stages as slices, trust and errors as counters.
//!
//! Source: perfetto.dev, `trace_packet.proto`, `track_event.proto`, `track_descriptor.proto`.

use std::io::Write;
use std::path::Path;

use foretrace_shm::{Mode, Stage, TickRecord};

use crate::RecordError;
use crate::proto::{double_field, sized, varint_field};

/// Tracks by their numbers.
const WAKEUP: u64 = 1;
const STAGES: u64 = 2;
const MODE: u64 = 3;
const TRUST: u64 = 4;
const ERROR: u64 = 5;
const SLACK: u64 = 6;

/// Kinds of events.
const BEGIN: u64 = 1;
const END: u64 = 2;
const COUNTER: u64 = 4;

/// The only writer of a trace.
const SEQUENCE: u64 = 1;

/// Stages in the order in which they run; what lies between them is the tick's own.
const ORDER: [Stage; 7] =
    [Stage::Receive, Stage::Pen, Stage::Predict, Stage::Mpc, Stage::Ik, Stage::Guard, Stage::Send];

/// Writes `ticks` to `out`, which is `path`.
///
/// # Errors
///
/// The disk refuses.
pub(crate) fn write<'a>(
    ticks: impl Iterator<Item = &'a TickRecord>,
    out: &mut impl Write,
    path: &Path,
) -> Result<(), RecordError> {
    let mut trace = Vec::new();
    for (track, name, counts) in [
        (WAKEUP, "wake-up", false),
        (STAGES, "stages of the tick", false),
        (MODE, "mode", false),
        (TRUST, "trust", true),
        (ERROR, "error [mm]", true),
        (SLACK, "time left to the deadline [us]", true),
    ] {
        descriptor(&mut trace, track, name, counts);
    }
    let mut last: Option<(u32, u64)> = None;
    for record in ticks {
        tick(&mut trace, record);
        let at = record.release_ns;
        if last.is_none_or(|(mode, _)| mode != record.mode) {
            if last.is_some() {
                event(&mut trace, at, MODE, END, None);
            }
            let name = Mode::try_from(record.mode).map_or("unknown", Mode::label);
            event(&mut trace, at, MODE, BEGIN, Some(name));
        }
        last = Some((record.mode, at));
        out.write_all(&trace).map_err(|source| RecordError::Write { path: path.to_path_buf(), source })?;
        trace.clear();
    }
    if let Some((_, at)) = last {
        event(&mut trace, at, MODE, END, None);
    }
    out.write_all(&trace).map_err(|source| RecordError::Write { path: path.to_path_buf(), source })
}

fn tick(trace: &mut Vec<u8>, record: &TickRecord) {
    let mut at = record.release_ns;
    let wakeup = u64::from(record.stage(Stage::Wakeup));
    slice(trace, &mut at, WAKEUP, "late", wakeup);
    for stage in ORDER {
        slice(trace, &mut at, STAGES, stage.label(), u64::from(record.stage(stage)));
    }
    counter(trace, record.release_ns, TRUST, record.trust);
    counter(trace, record.release_ns, SLACK, record.slack_ns as f64 * 1e-3);
    if record.error_m >= 0.0 {
        counter(trace, record.release_ns, ERROR, record.error_m * 1e3);
    }
}

/// A slice of `ns` from `at` on, which moves to its end; none of no length.
fn slice(trace: &mut Vec<u8>, at: &mut u64, track: u64, name: &str, ns: u64) {
    if ns > 0 {
        event(trace, *at, track, BEGIN, Some(name));
        *at = at.saturating_add(ns);
        event(trace, *at, track, END, None);
    }
}

fn descriptor(trace: &mut Vec<u8>, track: u64, name: &str, counts: bool) {
    let mut of = Vec::new();
    varint_field(&mut of, 1, track);
    sized(&mut of, 2, name.as_bytes());
    if counts {
        sized(&mut of, 8, &[]);
    }
    let mut packet = Vec::new();
    varint_field(&mut packet, 10, SEQUENCE);
    sized(&mut packet, 60, &of);
    sized(trace, 1, &packet);
}

fn event(trace: &mut Vec<u8>, at: u64, track: u64, kind: u64, name: Option<&str>) {
    let mut of = Vec::new();
    varint_field(&mut of, 9, kind);
    varint_field(&mut of, 11, track);
    if let Some(name) = name {
        sized(&mut of, 23, name.as_bytes());
    }
    packet(trace, at, &of);
}

fn counter(trace: &mut Vec<u8>, at: u64, track: u64, value: f64) {
    let mut of = Vec::new();
    varint_field(&mut of, 9, COUNTER);
    varint_field(&mut of, 11, track);
    double_field(&mut of, 44, value);
    packet(trace, at, &of);
}

fn packet(trace: &mut Vec<u8>, at: u64, event: &[u8]) {
    let mut packet = Vec::new();
    varint_field(&mut packet, 8, at);
    varint_field(&mut packet, 10, SEQUENCE);
    sized(&mut packet, 11, event);
    sized(trace, 1, &packet);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_slice_that_begins_ends_and_lies_inside_its_tick() {
        let mut record = TickRecord { release_ns: 1000, error_m: 1e-3, ..Default::default() };
        record.set_stage(Stage::Wakeup, 10);
        record.set_stage(Stage::Mpc, 30);
        let mut out = Vec::new();
        write([record, record].iter(), &mut out, Path::new("x")).unwrap();
        // Kinds are written as field 9 (key 0x48) of an event.
        let kinds = |kind: u8| out.windows(2).filter(|pair| *pair == [0x48, kind]).count();
        assert_eq!((kinds(1), kinds(2)), (5, 5), "two ticks of two slices, one mode");
        assert_eq!(kinds(4), 6);
    }
}
