//! The topics of a recording: what is written under which name, and in which encoding.
//!
//! Contract: raw topics hold the messages of shared memory byte for byte, and the layout table that says what
//! the bytes are; the others hold protobuf for readers of others. Times are those of the host's clock since
//! 1970; stamps inside messages stay on the monotonic clock.

use foretrace_shm as shm;
use foretrace_shm::layout::{Field, fnv1a};
use foretrace_shm::{FaultReason, Mode, PEN_PER_PART, PenInput, PieceKind, Rung, Stage, Status, Thing};
use foretrace_shm::{TickInput, TickRecord, TrustReason, Wire};

use crate::proto::{Kind, ProtoFile, Shape, Value, descriptor_set, encode};

/// Encoding of raw topics.
pub const WIRE: &str = "foretrace.wire";

/// A topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Topic {
    /// Inputs of ticks, raw.
    Input,
    /// Tick records, raw.
    TickRaw,
    /// The status, raw.
    StatusRaw,
    /// Settings, weights and states, raw.
    Thing,
    /// Tick records in numbers and words.
    Tick,
    /// Where pen, tool and ghost are.
    Frames,
    /// The recorder's own counts.
    Recorder,
    /// What changed from tick to tick, in words.
    Log,
}

impl Topic {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Input,
        Self::TickRaw,
        Self::StatusRaw,
        Self::Thing,
        Self::Tick,
        Self::Frames,
        Self::Recorder,
        Self::Log,
    ];

    /// Its name in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Input => "/raw/input",
            Self::TickRaw => "/raw/tick",
            Self::StatusRaw => "/raw/status",
            Self::Thing => "/raw/thing",
            Self::Tick => "/tick",
            Self::Frames => "/tf",
            Self::Recorder => "/recorder",
            Self::Log => "/log",
        }
    }

    /// The topic of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|topic| topic.name() == name)
    }

    /// Name, encoding and text of its schema.
    #[must_use]
    pub fn schema(self) -> (String, &'static str, Vec<u8>) {
        let raw = |name: &str, hash: u64, fields: &[Field], size: usize| {
            (name.to_owned(), WIRE, layout_table(hash, fields, size).into_bytes())
        };
        let proto =
            |shape: &Shape, files: &[ProtoFile]| (shape.name.to_owned(), "protobuf", descriptor_set(files));
        match self {
            Self::Input => {
                let (name, encoding, mut table) =
                    raw("TickInput", TickInput::LAYOUT_HASH, TickInput::FIELDS, size_of::<TickInput>());
                table.extend(pen_rows().into_bytes());
                (name, encoding, table)
            }
            Self::TickRaw => {
                raw("TickRecord", TickRecord::LAYOUT_HASH, TickRecord::FIELDS, size_of::<TickRecord>())
            }
            Self::StatusRaw => raw("Status", Status::LAYOUT_HASH, Status::FIELDS, size_of::<Status>()),
            Self::Thing => raw("Thing", THING_LAYOUT, &[], 0),
            Self::Tick => proto(&TICK, &[OURS]),
            Self::Frames => proto(&FRAME_TRANSFORM, &[TIME, FOXGLOVE]),
            Self::Recorder => proto(&RECORDER, &[OURS]),
            Self::Log => proto(&LOG, &[TIME, FOXGLOVE_LOG]),
        }
    }

    /// Its encoding of messages.
    #[must_use]
    pub const fn encoding(self) -> &'static str {
        match self {
            Self::Input | Self::TickRaw | Self::StatusRaw | Self::Thing => WIRE,
            Self::Tick | Self::Frames | Self::Recorder | Self::Log => "protobuf",
        }
    }
}

/// Stands for the layout of a thing: kind, daemon, number, bytes.
const THING_LAYOUT: u64 = fnv1a(b"foretrace.ThingV1");

/// `layout HASH size N`, then `name offset size type` per field.
fn layout_table(hash: u64, fields: &[Field], size: usize) -> String {
    let mut text = format!("layout {hash:016x} size {size}\n");
    for Field { name, offset, size, type_hash } in fields {
        text.push_str(&format!("{name} {offset} {size} {}\n", type_name(*type_hash, *size)));
    }
    text
}

/// The fields of each pen sample in a `TickInput`, which later versions find by these rows.
fn pen_rows() -> String {
    let mut text = String::new();
    let begin = TickInput::FIELDS.iter().find(|field| field.name == "pen").map_or(0, |field| field.offset);
    for index in 0..PEN_PER_PART {
        let begin = begin + index * size_of::<PenInput>();
        for Field { name, offset, size, type_hash } in PenInput::FIELDS {
            let kind = type_name(*type_hash, *size);
            text.push_str(&format!("pen[{index}].{name} {} {size} {kind}\n", begin + offset));
        }
    }
    text
}

/// Stands for the layouts of all raw topics of this version.
#[must_use]
pub fn layouts() -> u64 {
    let mut heads = Vec::new();
    for topic in Topic::ALL.into_iter().filter(|topic| topic.encoding() == WIRE) {
        heads.extend_from_slice(layout_of(&topic.schema().2));
    }
    fnv1a(&heads)
}

/// The first line of a table, which names the layout.
pub(crate) fn layout_of(table: &[u8]) -> &[u8] {
    table.split(|byte| *byte == b'\n').next().unwrap_or_default()
}

/// The number type of a field, with `*N` for an array; `bytes` for anything else.
fn type_name(hash: u64, size: usize) -> String {
    let numbers: [(&str, u64, usize); 8] = [
        ("u8", u8::LAYOUT_HASH, 1),
        ("u16", u16::LAYOUT_HASH, 2),
        ("u32", u32::LAYOUT_HASH, 4),
        ("u64", u64::LAYOUT_HASH, 8),
        ("i32", i32::LAYOUT_HASH, 4),
        ("i64", i64::LAYOUT_HASH, 8),
        ("f32", f32::LAYOUT_HASH, 4),
        ("f64", f64::LAYOUT_HASH, 8),
    ];
    for (name, of, bytes) in numbers {
        if of == hash {
            return name.to_owned();
        }
        let count = size / bytes;
        if array_hash(of, count) == hash {
            return format!("{name}*{count}");
        }
    }
    "bytes".to_owned()
}

/// As [`Wire::LAYOUT_HASH`] of an array of `count` numbers.
fn array_hash(of: u64, count: usize) -> u64 {
    let mut hash = of;
    for byte in (count as u64).to_le_bytes() {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
    hash
}

const TIME: ProtoFile = ProtoFile {
    name: "google/protobuf/timestamp.proto",
    imports: &[],
    messages: &[Shape {
        name: "google.protobuf.Timestamp",
        fields: &[("seconds", Kind::I64), ("nanos", Kind::I32)],
    }],
};

const VECTOR: Shape =
    Shape { name: "foxglove.Vector3", fields: &[("x", Kind::F64), ("y", Kind::F64), ("z", Kind::F64)] };

const QUATERNION: Shape = Shape {
    name: "foxglove.Quaternion",
    fields: &[("x", Kind::F64), ("y", Kind::F64), ("z", Kind::F64), ("w", Kind::F64)],
};

/// Foxglove's `FrameTransform`.
pub const FRAME_TRANSFORM: Shape = Shape {
    name: "foxglove.FrameTransform",
    fields: &[
        ("timestamp", Kind::Part("google.protobuf.Timestamp")),
        ("parent_frame_id", Kind::Text),
        ("child_frame_id", Kind::Text),
        ("translation", Kind::Part("foxglove.Vector3")),
        ("rotation", Kind::Part("foxglove.Quaternion")),
    ],
};

const FOXGLOVE: ProtoFile = ProtoFile {
    name: "foxglove/FrameTransform.proto",
    imports: &["google/protobuf/timestamp.proto"],
    messages: &[VECTOR, QUATERNION, FRAME_TRANSFORM],
};

/// Foxglove's `Log`.
pub const LOG: Shape = Shape {
    name: "foxglove.Log",
    fields: &[
        ("timestamp", Kind::Part("google.protobuf.Timestamp")),
        ("level", Kind::Choice("Level", &["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"])),
        ("message", Kind::Text),
        ("name", Kind::Text),
        ("file", Kind::Text),
        ("line", Kind::Fixed32),
    ],
};

const FOXGLOVE_LOG: ProtoFile =
    ProtoFile { name: "foxglove/Log.proto", imports: &["google/protobuf/timestamp.proto"], messages: &[LOG] };

/// One tick for people: names end in their units, unknown numbers are NaN.
pub const TICK: Shape = Shape {
    name: "foretrace.Tick",
    fields: &[
        ("tick", Kind::U64),
        ("release_ns", Kind::U64),
        ("mode", Kind::Text),
        ("stopped_because", Kind::Text),
        ("rung", Kind::Text),
        ("predictor", Kind::Text),
        ("trust", Kind::F64),
        ("trust_target", Kind::F64),
        ("trust_reason", Kind::Text),
        ("pen_m", Kind::F64s),
        ("pen_contact", Kind::Bool),
        ("pen_age_ms", Kind::F64),
        ("reference_m", Kind::F64s),
        ("setpoint_m", Kind::F64s),
        ("setpoint_mps", Kind::F64s),
        ("setpoint_mps2", Kind::F64s),
        ("tool_m", Kind::F64s),
        ("ghost_tool_m", Kind::F64s),
        ("q_rad", Kind::F64s),
        ("qd_radps", Kind::F64s),
        ("measured_q_rad", Kind::F64s),
        ("error_mm", Kind::F64),
        ("ghost_error_mm", Kind::F64),
        ("predictor_error_mm", Kind::F64),
        ("weights_version", Kind::U64),
        ("wakeup_us", Kind::F64),
        ("step_us", Kind::F64),
        ("slack_us", Kind::F64),
        ("shed", Kind::Bool),
        ("overruns", Kind::U64),
        ("health", Kind::Text),
    ],
};

/// What the recorder lost, since it began.
pub const RECORDER: Shape = Shape {
    name: "foretrace.Recorder",
    fields: &[
        ("written", Kind::U64),
        ("queue_lost", Kind::U64),
        ("inputs_lost", Kind::U64),
        ("ticks_lost", Kind::U64),
        ("things_broken", Kind::U64),
        ("refused", Kind::U64),
    ],
};

const OURS: ProtoFile = ProtoFile { name: "foretrace.proto", imports: &[], messages: &[TICK, RECORDER] };

/// A thing as the bytes of its topic.
#[must_use]
pub fn thing_bytes(thing: &Thing) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(20 + thing.bytes.len());
    bytes.extend_from_slice(&u32::from(thing.kind).to_le_bytes());
    bytes.extend_from_slice(&thing.daemon_id.to_le_bytes());
    bytes.extend_from_slice(&thing.number.to_le_bytes());
    bytes.extend_from_slice(&thing.bytes);
    bytes
}

/// The thing of these bytes.
#[must_use]
pub fn thing_of(mut bytes: &[u8]) -> Option<Thing> {
    let kind = PieceKind::try_from(u32::get(&mut bytes)?).ok()?;
    let daemon_id = u64::get(&mut bytes)?;
    let number = u64::get(&mut bytes)?;
    Some(Thing { kind, number, daemon_id, bytes: bytes.to_vec() })
}

/// `record` for people.
#[must_use]
pub fn tick(record: &TickRecord) -> Vec<u8> {
    // Negative numbers stand for unknown ones on the wire.
    let mm = |m: f64| if m < 0.0 { f64::NAN } else { m * 1e3 };
    let ms = |ns: u64| if ns == u64::MAX { f64::NAN } else { ns as f64 * 1e-6 };
    let us = |stage: Stage| f64::from(record.stage(stage)) * 1e-3;
    let health = shm::health::labels(record.health).collect::<Vec<_>>().join(", ");
    let fault = FaultReason::try_from(record.fault).map_or("", FaultReason::label);
    let values = [
        Value::U64(record.tick),
        Value::U64(record.release_ns),
        Value::Text(Mode::try_from(record.mode).map_or("unknown", Mode::label)),
        Value::Text(fault),
        Value::Text(Rung::try_from(record.rung).map_or("unknown", Rung::label)),
        Value::Text(record.predictor.as_str().unwrap_or("")),
        Value::F64(record.trust),
        Value::F64(record.trust_target),
        Value::Text(TrustReason::try_from(record.trust_reason).map_or("unknown", TrustReason::label)),
        Value::F64s(&record.pen_m),
        Value::Bool(record.pen_flags & shm::pen_flags::CONTACT != 0),
        Value::F64(ms(record.chain.pen_age_ns)),
        Value::F64s(&record.reference_m),
        Value::F64s(&record.setpoint_m),
        Value::F64s(&record.setpoint_mps),
        Value::F64s(&record.setpoint_mps2),
        Value::F64s(&record.tool_m),
        Value::F64s(&record.ghost_tool_m),
        Value::F64s(&record.q),
        Value::F64s(&record.qd),
        Value::F64s(&record.measured_q),
        Value::F64(mm(record.error_m)),
        Value::F64(mm(record.ghost_error_m)),
        Value::F64(mm(record.predictor_error_m)),
        Value::U64(record.learner_version),
        Value::F64(us(Stage::Wakeup)),
        Value::F64(us(Stage::Step)),
        Value::F64(record.slack_ns as f64 * 1e-3),
        Value::Bool(record.shed != 0),
        Value::U64(record.counters.overruns),
        Value::Text(&health),
    ];
    encode(&TICK, &values).unwrap_or_default()
}

/// A `Timestamp`.
fn timestamp(time_ns: u64) -> Vec<u8> {
    let seconds = i64::try_from(time_ns / 1_000_000_000).unwrap_or(i64::MAX);
    let nanos = (time_ns % 1_000_000_000) as i32;
    let shape = TIME.messages.first();
    shape.and_then(|shape| encode(shape, &[Value::I64(seconds), Value::I32(nanos)])).unwrap_or_default()
}

/// What changed from the tick `before` to `record`, at `time_ns` since 1970: mode, stop, late tick, plan,
/// predictor, and why trust is what it is.
#[must_use]
pub fn log(before: &TickRecord, record: &TickRecord, time_ns: u64) -> Vec<Vec<u8>> {
    let [debug, info, warning, error] = [1, 2, 3, 4];
    let mut lines = Vec::new();
    let mut line = |level: u32, words: String| {
        let time = timestamp(time_ns);
        let values = [
            Value::Part(&time),
            Value::Choice(level),
            Value::Text(&words),
            Value::Text("foretrace"),
            Value::Text(""),
            Value::Fixed32(0),
        ];
        lines.extend(encode(&LOG, &values));
    };
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

/// Where pen, tool and ghost of `record` are on the paper, at `time_ns` since 1970.
#[must_use]
pub fn frames(record: &TickRecord, time_ns: u64) -> [Vec<u8>; 3] {
    let frame = |child: &str, at: &[f64; 3]| {
        let [x, y, z] = at.map(Value::F64);
        let time = timestamp(time_ns);
        let place = encode(&VECTOR, &[x, y, z]);
        let upright = [0.0, 0.0, 0.0, 1.0].map(Value::F64);
        let turn = encode(&QUATERNION, &upright);
        let [place, turn] = [place, turn].map(Option::unwrap_or_default);
        let values = [
            Value::Part(&time),
            Value::Text("paper"),
            Value::Text(child),
            Value::Part(&place),
            Value::Part(&turn),
        ];
        encode(&FRAME_TRANSFORM, &values).unwrap_or_default()
    };
    [frame("pen", &record.pen_m), frame("tool", &record.tool_m), frame("ghost", &record.ghost_tool_m)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_message_has_exactly_the_fields_of_its_shape() {
        assert!(!tick(&TickRecord::default()).is_empty());
        for frame in frames(&TickRecord::default(), 1_700_000_000_123_456_789) {
            assert!(!frame.is_empty());
        }
    }

    #[test]
    fn changes_from_tick_to_tick_are_told_once_in_words_with_their_weight() {
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

    #[test]
    fn layout_tables_say_what_the_numbers_are() {
        let (_, _, table) = Topic::Input.schema();
        let table = String::from_utf8(table).unwrap();
        for line in [
            "tick 32 8 u64",
            "q 280 48 f64*6",
            "mode 392 4 u32",
            "pen[0].x_m 416 8 f64",
            "pen[7].y_m 816 8 f64",
        ] {
            assert!(table.lines().any(|found| found == line), "{line} in {table}");
        }
        assert!(table.starts_with(&format!("layout {:016x} size 856\n", TickInput::LAYOUT_HASH)));
    }

    #[test]
    fn a_thing_comes_back_from_its_bytes_and_nothing_from_others() {
        let thing = Thing { kind: PieceKind::Weights, number: 3, daemon_id: 9, bytes: vec![1, 2] };
        assert_eq!(thing_of(&thing_bytes(&thing)), Some(thing));
        assert_eq!(thing_of(&[0; 19]), None);
        assert_eq!(thing_of(&[9; 40]), None);
    }
}
