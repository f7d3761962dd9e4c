//! Tick records as readable messages: one of numbers and words, frames, and lines of a log.

use foretrace_shm as shm;
use foretrace_shm::{FaultReason, Mode, Rung, Stage, TickRecord, TrustReason};

use super::foxglove::{LOG, UPRIGHT, frame_transform, timestamp};
use crate::proto::ProtoKind::{Bool, F64, F64s, Text, U64};
use crate::proto::{ProtoFile, ProtoShape, ProtoValue, encode, shape};

/// Levels of a log, from debug to error.
const LEVELS: [u32; 4] = [1, 2, 3, 4];

/// One tick for readers: names end in their units, unknown numbers are NaN.
pub const TICK: ProtoShape = shape(
    "foretrace.Tick",
    &[
        ("tick", U64),
        ("release_ns", U64),
        ("mode", Text),
        ("stopped_because", Text),
        ("rung", Text),
        ("predictor", Text),
        ("trust", F64),
        ("trust_target", F64),
        ("trust_reason", Text),
        ("pen_m", F64s),
        ("pen_contact", Bool),
        ("pen_age_ms", F64),
        ("reference_m", F64s),
        ("setpoint_m", F64s),
        ("setpoint_mps", F64s),
        ("setpoint_mps2", F64s),
        ("tool_m", F64s),
        ("ghost_tool_m", F64s),
        ("q_rad", F64s),
        ("qd_radps", F64s),
        ("measured_q_rad", F64s),
        ("error_mm", F64),
        ("ghost_error_mm", F64),
        ("predictor_error_mm", F64),
        ("weights_version", U64),
        ("wakeup_us", F64),
        ("step_us", F64),
        ("slack_us", F64),
        ("shed", Bool),
        ("overruns", U64),
        ("health", Text),
    ],
);

/// What the recorder lost, since it began.
pub const RECORDER: ProtoShape = shape(
    "foretrace.Recorder",
    &[
        ("written", U64),
        ("queue_lost", U64),
        ("inputs_lost", U64),
        ("ticks_lost", U64),
        ("things_broken", U64),
        ("refused", U64),
    ],
);

pub(super) const OURS: ProtoFile =
    ProtoFile { name: "foretrace.proto", imports: &[], messages: &[TICK, RECORDER] };

/// `record` for readers.
#[must_use]
pub fn tick(record: &TickRecord) -> Vec<u8> {
    // Negative numbers stand for unknown ones on the wire.
    let mm = |m: f64| if m < 0.0 { f64::NAN } else { m * 1e3 };
    let ms = |ns: u64| if ns == u64::MAX { f64::NAN } else { ns as f64 * 1e-6 };
    let us = |stage: Stage| f64::from(record.stage(stage)) * 1e-3;
    let health = shm::health::labels(record.health).collect::<Vec<_>>().join(", ");
    let fault = FaultReason::try_from(record.fault).map_or("", FaultReason::label);
    let values = [
        ProtoValue::U64(record.tick),
        ProtoValue::U64(record.release_ns),
        ProtoValue::Text(Mode::try_from(record.mode).map_or("unknown", Mode::label)),
        ProtoValue::Text(fault),
        ProtoValue::Text(Rung::try_from(record.rung).map_or("unknown", Rung::label)),
        ProtoValue::Text(record.predictor.as_str().unwrap_or("")),
        ProtoValue::F64(record.trust),
        ProtoValue::F64(record.trust_target),
        ProtoValue::Text(TrustReason::try_from(record.trust_reason).map_or("unknown", TrustReason::label)),
        ProtoValue::F64s(&record.pen_m),
        ProtoValue::Bool(record.pen_flags & shm::pen_flags::CONTACT != 0),
        ProtoValue::F64(ms(record.chain.pen_age_ns)),
        ProtoValue::F64s(&record.reference_m),
        ProtoValue::F64s(&record.setpoint_m),
        ProtoValue::F64s(&record.setpoint_mps),
        ProtoValue::F64s(&record.setpoint_mps2),
        ProtoValue::F64s(&record.tool_m),
        ProtoValue::F64s(&record.ghost_tool_m),
        ProtoValue::F64s(&record.q),
        ProtoValue::F64s(&record.qd),
        ProtoValue::F64s(&record.measured_q),
        ProtoValue::F64(mm(record.error_m)),
        ProtoValue::F64(mm(record.ghost_error_m)),
        ProtoValue::F64(mm(record.predictor_error_m)),
        ProtoValue::U64(record.learner_version),
        ProtoValue::F64(us(Stage::Wakeup)),
        ProtoValue::F64(us(Stage::Step)),
        ProtoValue::F64(record.slack_ns as f64 * 1e-3),
        ProtoValue::Bool(record.shed != 0),
        ProtoValue::U64(record.counters.overruns),
        ProtoValue::Text(&health),
    ];
    encode(&TICK, &values).unwrap_or_default()
}

/// What changed from the tick `before` to `record`, at `time_ns` since 1970: mode, stop, late tick, plan,
/// predictor, and why trust is what it is.
#[must_use]
pub fn log(before: &TickRecord, record: &TickRecord, time_ns: u64) -> Vec<Vec<u8>> {
    let [debug, info, warning, error] = LEVELS;
    let mut lines = Vec::new();
    let mut line = |level: u32, words: String| lines.extend(log_line(level, &words, time_ns));
    let mode = Mode::try_from(record.mode);
    if record.mode != before.mode {
        let name = mode.map_or("unknown", Mode::label);
        match (mode, FaultReason::try_from(record.fault)) {
            (Ok(Mode::Stopped | Mode::Fault), Ok(why)) => line(error, format!("{name}: {why}")),
            _ => line(info, format!("mode {name}")),
        }
    }
    if record.counters.overruns > before.counters.overruns {
        let us = f64::from(record.stage(Stage::Step)) * 1e-3;
        line(warning, format!("tick {} ended late after {us:.0} µs of work", record.tick));
    }
    let following = [before.mode, record.mode] == [u32::from(Mode::Following); 2];
    if following && record.rung != before.rung {
        let rung = Rung::try_from(record.rung).map_or("unknown", Rung::label);
        let level = if record.rung == u32::from(Rung::FreshPlan) { info } else { warning };
        line(level, format!("moves by {rung}"));
    }
    if record.predictor != before.predictor {
        line(info, format!("predictor {}", record.predictor.as_str().unwrap_or("")));
    }
    if record.trust_reason != before.trust_reason {
        let reason = TrustReason::try_from(record.trust_reason).map_or("unknown", TrustReason::label);
        line(debug, format!("trust {:.2}: {reason}", record.trust));
    }
    lines
}

/// A line of the log about what a recorder or a server itself cannot do.
pub fn warning(words: &str, time_ns: u64) -> Vec<u8> {
    let [_, _, warning, _] = LEVELS;
    log_line(warning, words, time_ns).unwrap_or_default()
}

fn log_line(level: u32, words: &str, time_ns: u64) -> Option<Vec<u8>> {
    let time = timestamp(time_ns);
    let values = [
        ProtoValue::Part(&time),
        ProtoValue::Choice(level),
        ProtoValue::Text(words),
        ProtoValue::Text("foretrace"),
        ProtoValue::Text(""),
        ProtoValue::Fixed32(0),
    ];
    encode(&LOG, &values)
}

/// Where pen, tool and ghost of `record` are on the paper, at `time_ns` since 1970.
#[must_use]
pub fn frames(record: &TickRecord, time_ns: u64) -> [Vec<u8>; 3] {
    let frame = |child, at| frame_transform("paper", child, (at, UPRIGHT), time_ns);
    [frame("pen", &record.pen_m), frame("tool", &record.tool_m), frame("ghost", &record.ghost_tool_m)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_from_tick_to_tick_are_reported_once_in_words_with_their_weight() {
        let following = TickRecord { mode: Mode::Following.into(), ..TickRecord::default() };
        let told = |before: &TickRecord, record: &TickRecord| -> Vec<(u8, String)> {
            let lines = log(before, record, 1_700_000_000_123_456_789);
            let level =
                |line: &[u8]| line.windows(3).find(|part| part[0] == 0x10 && part[2] == 0x1a).unwrap()[1];
            lines.iter().map(|line| (level(line), String::from_utf8_lossy(line).into_owned())).collect()
        };
        assert!(told(&following, &following).is_empty());
        let stopped =
            TickRecord { mode: Mode::Stopped.into(), fault: FaultReason::Requested.into(), ..following };
        let lines = told(&following, &stopped);
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(
            lines[0].0 == 4 && lines[0].1.contains(&format!("stopped: {}", FaultReason::Requested)),
            "{lines:?}"
        );
        let mut late = TickRecord { tick: 7, trust_reason: TrustReason::ALL[1].into(), ..following };
        late.counters.overruns = 1;
        let lines = told(&following, &late);
        assert_eq!(lines.iter().map(|line| line.0).collect::<Vec<_>>(), [3, 1], "{lines:?}");
        assert!(lines[0].1.contains("tick 7 ended late"), "{lines:?}");
        let without = TickRecord { rung: Rung::Stop.into(), ..following };
        assert!(told(&following, &without)[0].0 == 3 && told(&without, &following)[0].0 == 2);
    }
}
