//! Foxglove's own messages, as far as they are sent, and the files that describe them whole.
//!
//! Source: the schemas of github.com/foxglove/foxglove-sdk without their newest fields from 100 on.

use crate::proto::ProtoKind::{Choice, F64, Fixed32, I32, I64, Part, Text};
use crate::proto::{ProtoFile, ProtoShape, ProtoValue, encode, shape};

/// A rotation as x, y, z, w of a unit quaternion.
pub(crate) type Turn = [f64; 4];

pub(super) const UPRIGHT: Turn = [0.0, 0.0, 0.0, 1.0];

const TIMESTAMP: ProtoShape = shape("google.protobuf.Timestamp", &[("seconds", I64), ("nanos", I32)]);

pub(super) const VECTOR: ProtoShape = shape("foxglove.Vector3", &[("x", F64), ("y", F64), ("z", F64)]);

pub(super) const QUATERNION: ProtoShape =
    shape("foxglove.Quaternion", &[("x", F64), ("y", F64), ("z", F64), ("w", F64)]);

/// Foxglove's `FrameTransform`.
pub const FRAME_TRANSFORM: ProtoShape = shape(
    "foxglove.FrameTransform",
    &[
        ("timestamp", Part("google.protobuf.Timestamp")),
        ("parent_frame_id", Text),
        ("child_frame_id", Text),
        ("translation", Part("foxglove.Vector3")),
        ("rotation", Part("foxglove.Quaternion")),
    ],
);

/// Foxglove's `Log`.
pub const LOG: ProtoShape = shape(
    "foxglove.Log",
    &[
        ("timestamp", Part("google.protobuf.Timestamp")),
        ("level", Choice("Level", &["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"])),
        ("message", Text),
        ("name", Text),
        ("file", Text),
        ("line", Fixed32),
    ],
);

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
    encode(&TIMESTAMP, &[ProtoValue::I64(seconds), ProtoValue::I32(nanos)]).unwrap_or_default()
}

pub(super) fn vector(at: &[f64; 3]) -> Vec<u8> {
    encode(&VECTOR, &at.map(ProtoValue::F64)).unwrap_or_default()
}

pub(super) fn quaternion(turn: Turn) -> Vec<u8> {
    encode(&QUATERNION, &turn.map(ProtoValue::F64)).unwrap_or_default()
}

/// Where frame `child` is in `parent` \[m\], at `time_ns` since 1970.
pub(crate) fn frame_transform(
    parent: &str,
    child: &str,
    (at, turn): (&[f64; 3], Turn),
    time_ns: u64,
) -> Vec<u8> {
    let (time, position, turn) = (timestamp(time_ns), vector(at), quaternion(turn));
    let values = [
        ProtoValue::Part(&time),
        ProtoValue::Text(parent),
        ProtoValue::Text(child),
        ProtoValue::Part(&position),
        ProtoValue::Part(&turn),
    ];
    encode(&FRAME_TRANSFORM, &values).unwrap_or_default()
}
