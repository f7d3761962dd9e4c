//! Ticks as a Perfetto trace: threads of the daemon with wake-ups, stages and weights; its peers, with what
//! came from them and when; trust and errors as counters.
//!
//! Contract: says when something happened by the stamp of who did it; what no tick was given is not there.
//! Threads stand by their names: numbers of threads are not recorded.
//!
//! Source: perfetto.dev, `trace_packet.proto`, `track_event.proto`, `track_descriptor.proto`,
//! `process_descriptor.proto`.

use std::io::Write;
use std::path::Path;

use foretrace_shm::{ControlOp, Mode, Stage, TickInput, TickRecord, input_flags};

use foretrace_record::RecordError;
use foretrace_record::proto::{double_field, sized, varint_field};

/// Tracks by their numbers.
const DAEMON: u64 = 7;
const PEERS: u64 = 8;
const WAKEUP: u64 = 1;
const STAGES: u64 = 2;
const MODE: u64 = 3;
const TRUST: u64 = 4;
const ERROR: u64 = 5;
const SLACK: u64 = 6;
const LEARNER: u64 = 9;
const PEN: u64 = 10;
const ARM: u64 = 11;
const DEAD_MAN: u64 = 12;
const OPERATOR: u64 = 13;

const BEGIN: u64 = 1;
const END: u64 = 2;
const INSTANT: u64 = 3;
const COUNTER: u64 = 4;

/// The only writer of a trace.
const SEQUENCE: u64 = 1;

/// Stages in the order in which they run; what lies between them is the tick's own.
const ORDER: [Stage; 7] =
    [Stage::Receive, Stage::Pen, Stage::Predict, Stage::Mpc, Stage::Ik, Stage::Guard, Stage::Send];

/// Writes `ticks` and `inputs` of the daemon with the process number `pid` to `out`, which is `path`.
///
/// # Errors
///
/// The disk refuses.
pub(crate) fn write<'a>(
    pid: u64,
    ticks: impl Iterator<Item = &'a TickRecord>,
    inputs: impl Iterator<Item = &'a TickInput>,
    out: &mut impl Write,
    path: &Path,
) -> Result<(), RecordError> {
    let failed = |source| RecordError::Write { path: path.to_path_buf(), source };
    let mut trace = tracks(pid);
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
        out.write_all(&trace).map_err(failed)?;
        trace.clear();
    }
    if let Some((_, at)) = last {
        event(&mut trace, at, MODE, END, None);
    }
    let mut weights = None;
    for input in inputs {
        given(&mut trace, input, &mut weights);
        out.write_all(&trace).map_err(failed)?;
        trace.clear();
    }
    out.write_all(&trace).map_err(failed)
}

/// What the tracks are: those of the daemon below its process, those of others below their own.
fn tracks(pid: u64) -> Vec<u8> {
    let mut trace = Vec::new();
    let mut process = Vec::new();
    varint_field(&mut process, 1, pid);
    sized(&mut process, 6, b"foretraced");
    descriptor(&mut trace, DAEMON, "foretraced", None, |of| sized(of, 3, &process));
    descriptor(&mut trace, PEERS, "peers", None, |_| {});
    for (track, name, parent) in [
        (WAKEUP, "rt thread: wake-up", DAEMON),
        (STAGES, "rt thread: stages of the tick", DAEMON),
        (MODE, "mode", DAEMON),
        (LEARNER, "learner thread: weights", DAEMON),
        (PEN, "pen: samples", PEERS),
        (ARM, "arm: joint states", PEERS),
        (DEAD_MAN, "dead-man switch", PEERS),
        (OPERATOR, "requests", PEERS),
    ] {
        descriptor(&mut trace, track, name, Some(parent), |_| {});
    }
    for (track, name) in [(TRUST, "trust"), (ERROR, "error [mm]"), (SLACK, "time left to the deadline [us]")]
    {
        descriptor(&mut trace, track, name, Some(DAEMON), |of| sized(of, 8, &[]));
    }
    trace
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

/// What a tick was given by peers and by the learner; `weights` are those in use before.
fn given(trace: &mut Vec<u8>, input: &TickInput, weights: &mut Option<u64>) {
    for sample in input.pen() {
        let name = if sample.contact == 0 { "lifted" } else { "on the paper" };
        event(trace, sample.sent_ns, PEN, INSTANT, Some(name));
    }
    if input.part != 0 {
        return;
    }
    let has = |flag: u32| input.flags & flag != 0;
    if has(input_flags::JOINTS) {
        event(trace, input.joints_ns, ARM, INSTANT, Some("joint state"));
    }
    if has(input_flags::ENABLE) {
        let name = if has(input_flags::ENABLE_STOP) { "released" } else { "held" };
        event(trace, input.enable_ns, DEAD_MAN, INSTANT, Some(name));
    }
    if has(input_flags::REQUEST) {
        let name = ControlOp::try_from(input.request).map_or("unknown", ControlOp::label);
        event(trace, input.now_ns, OPERATOR, INSTANT, Some(name));
    }
    if has(input_flags::WEIGHTS) {
        let name = format!("set {} offered", input.weights_version);
        event(trace, input.now_ns, LEARNER, INSTANT, Some(&name));
    }
    if weights.replace(input.weights_used).is_some_and(|before| before != input.weights_used) {
        let name = format!("set {} in use", input.weights_used);
        event(trace, input.now_ns, LEARNER, INSTANT, Some(&name));
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

fn descriptor(
    trace: &mut Vec<u8>,
    track: u64,
    name: &str,
    parent: Option<u64>,
    more: impl FnOnce(&mut Vec<u8>),
) {
    let mut of = Vec::new();
    varint_field(&mut of, 1, track);
    sized(&mut of, 2, name.as_bytes());
    more(&mut of);
    if let Some(parent) = parent {
        varint_field(&mut of, 5, parent);
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
    use foretrace_shm::PenInput;

    use super::*;

    fn has(out: &[u8], words: &str) -> usize {
        out.windows(words.len()).filter(|part| *part == words.as_bytes()).count()
    }

    #[test]
    fn every_slice_that_begins_ends_and_lies_inside_its_tick() {
        let mut record = TickRecord { release_ns: 1000, error_m: 1e-3, ..Default::default() };
        record.set_stage(Stage::Wakeup, 10);
        record.set_stage(Stage::Mpc, 30);
        let mut out = Vec::new();
        write(1, [record, record].iter(), [].iter(), &mut out, Path::new("x")).unwrap();
        // Kinds are written as field 9 (key 0x48) of an event.
        let kinds = |kind: u8| out.windows(2).filter(|pair| *pair == [0x48, kind]).count();
        assert_eq!((kinds(1), kinds(2)), (5, 5), "two ticks of two slices, one mode");
        assert_eq!(kinds(4), 6);
    }

    #[test]
    fn what_peers_and_learner_gave_is_there_once_at_the_stamp_of_who_gave_it() {
        let mut first = TickInput {
            now_ns: 5_000_000,
            parts: 2,
            pen_samples: 9,
            flags: input_flags::JOINTS | input_flags::REQUEST,
            request: ControlOp::Stop.into(),
            joints_ns: 4_000_000,
            weights_used: 3,
            ..Default::default()
        };
        first.pen = [PenInput { sent_ns: 4_500_000, contact: 1, ..Default::default() }; 8];
        let second = TickInput { part: 1, ..first };
        let next = TickInput {
            pen_samples: 0,
            parts: 1,
            flags: input_flags::WEIGHTS | input_flags::JOINTS | input_flags::REQUEST,
            weights_version: 4,
            weights_used: 4,
            ..first
        };
        let mut out = Vec::new();
        write(1, [].iter(), [first, second, next].iter(), &mut out, Path::new("x")).unwrap();
        assert_eq!(has(&out, "on the paper"), 9);
        assert_eq!((has(&out, "joint state"), has(&out, "arm: joint states")), (2 + 1, 1));
        assert_eq!((has(&out, "set 4 offered"), has(&out, "set 4 in use")), (1, 1));
        assert_eq!((has(&out, "set 3"), has(&out, "held"), has(&out, ControlOp::Stop.label())), (0, 0, 2));
        let mut at = Vec::new();
        varint_field(&mut at, 8, 4_500_000);
        assert_eq!(out.windows(at.len()).filter(|part| *part == at).count(), 9);
    }
}
