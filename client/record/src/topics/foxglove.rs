//! Foxglove's own messages, as far as they are sent, and the files that describe them whole.
//!
//! Source: the schemas of github.com/foxglove/foxglove-sdk without their newest fields from 100 on.

use crate::proto::{Kind, ProtoFile, Shape, Value, encode};

/// A rotation as x, y, z, w of a unit quaternion.
pub(crate) type Turn = [f64; 4];

/// No rotation.
pub(super) const UPRIGHT: Turn = [0.0, 0.0, 0.0, 1.0];

const TIMESTAMP: Shape =
    Shape { name: "google.protobuf.Timestamp", fields: &[("seconds", Kind::I64), ("nanos", Kind::I32)] };

pub(super) const VECTOR: Shape =
    Shape { name: "foxglove.Vector3", fields: &[("x", Kind::F64), ("y", Kind::F64), ("z", Kind::F64)] };

pub(super) const QUATERNION: Shape = Shape {
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

pub(super) const TIME: ProtoFile =
    ProtoFile { name: "google/protobuf/timestamp.proto", imports: &[], messages: &[TIMESTAMP] };
/// What describes [`FRAME_TRANSFORM`].
pub(super) const FRAME_FILES: &[ProtoFile] = &[
    TIME,
    ProtoFile {
        name: "foxglove/FrameTransform.proto",
        imports: &[TIME.name],
        messages: &[VECTOR, QUATERNION, FRAME_TRANSFORM],
    },
];

/// What describes [`LOG`].
pub(super) const LOG_FILES: &[ProtoFile] =
    &[TIME, ProtoFile { name: "foxglove/Log.proto", imports: &[TIME.name], messages: &[LOG] }];

/// A `Timestamp`.
pub(super) fn timestamp(time_ns: u64) -> Vec<u8> {
    let seconds = i64::try_from(time_ns / 1_000_000_000).unwrap_or(i64::MAX);
    let nanos = (time_ns % 1_000_000_000) as i32;
    encode(&TIMESTAMP, &[Value::I64(seconds), Value::I32(nanos)]).unwrap_or_default()
}

pub(super) fn vector(at: &[f64; 3]) -> Vec<u8> {
    encode(&VECTOR, &at.map(Value::F64)).unwrap_or_default()
}

pub(super) fn quaternion(turn: Turn) -> Vec<u8> {
    encode(&QUATERNION, &turn.map(Value::F64)).unwrap_or_default()
}

/// Where frame `child` is in `parent` \[m\], at `time_ns` since 1970.
pub(crate) fn frame_transform(
    parent: &str,
    child: &str,
    (at, turn): (&[f64; 3], Turn),
    time_ns: u64,
) -> Vec<u8> {
    let (time, place, turn) = (timestamp(time_ns), vector(at), quaternion(turn));
    let values = [
        Value::Part(&time),
        Value::Text(parent),
        Value::Text(child),
        Value::Part(&place),
        Value::Part(&turn),
    ];
    encode(&FRAME_TRANSFORM, &values).unwrap_or_default()
}
