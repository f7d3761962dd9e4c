//! Foxglove's `SceneUpdate`: entities, and the shapes that they are made of.
//!
//! Source: the schemas of github.com/foxglove/foxglove-sdk without their newest fields from 100 on.

use super::foxglove::{QUATERNION, TIME, Turn, UPRIGHT, VECTOR, quaternion, timestamp, vector};
use crate::proto::ProtoKind::{self, Bool, Bytes, Choice, F64, Fixed32s, I32, I64, Part, Parts, Text};
use crate::proto::{ProtoFile, ProtoShape, ProtoValue, encode, shape};

/// Foxglove's `SceneUpdate`.
pub const SCENE_UPDATE: ProtoShape = shape(
    "foxglove.SceneUpdate",
    &[("deletions", Parts("foxglove.SceneEntityDeletion")), ("entities", Parts("foxglove.SceneEntity"))],
);

const DURATION: ProtoShape = shape("google.protobuf.Duration", &[("seconds", I64), ("nanos", I32)]);

const POSE_PART: ProtoKind = Part("foxglove.Pose");
const COLOR_PART: ProtoKind = Part("foxglove.Color");
const VECTOR_PART: ProtoKind = Part("foxglove.Vector3");

const POSE: ProtoShape =
    shape("foxglove.Pose", &[("position", VECTOR_PART), ("orientation", Part("foxglove.Quaternion"))]);
const COLOR: ProtoShape = shape("foxglove.Color", &[("r", F64), ("g", F64), ("b", F64), ("a", F64)]);
const POINT: ProtoShape = shape("foxglove.Point3", &[("x", F64), ("y", F64), ("z", F64)]);
const PAIR: ProtoShape = shape("foxglove.KeyValuePair", &[("key", Text), ("value", Text)]);
const ARROW: ProtoShape = shape(
    "foxglove.ArrowPrimitive",
    &[
        ("pose", POSE_PART),
        ("shaft_length", F64),
        ("shaft_diameter", F64),
        ("head_length", F64),
        ("head_diameter", F64),
        ("color", COLOR_PART),
    ],
);
const CUBE: ProtoShape =
    shape("foxglove.CubePrimitive", &[("pose", POSE_PART), ("size", VECTOR_PART), ("color", COLOR_PART)]);
const SPHERE: ProtoShape =
    shape("foxglove.SpherePrimitive", &[("pose", POSE_PART), ("size", VECTOR_PART), ("color", COLOR_PART)]);
const CYLINDER: ProtoShape = shape(
    "foxglove.CylinderPrimitive",
    &[
        ("pose", POSE_PART),
        ("size", VECTOR_PART),
        ("bottom_scale", F64),
        ("top_scale", F64),
        ("color", COLOR_PART),
    ],
);
const LINE: ProtoShape = shape(
    "foxglove.LinePrimitive",
    &[
        ("type", Choice("Type", &["LINE_STRIP", "LINE_LOOP", "LINE_LIST"])),
        ("pose", POSE_PART),
        ("thickness", F64),
        ("scale_invariant", Bool),
        ("points", Parts("foxglove.Point3")),
        ("color", COLOR_PART),
        ("colors", Parts("foxglove.Color")),
        ("indices", Fixed32s),
    ],
);
const TRIANGLES: ProtoShape = shape(
    "foxglove.TriangleListPrimitive",
    &[
        ("pose", POSE_PART),
        ("points", Parts("foxglove.Point3")),
        ("color", COLOR_PART),
        ("colors", Parts("foxglove.Color")),
        ("indices", Fixed32s),
    ],
);
const TEXT: ProtoShape = shape(
    "foxglove.TextPrimitive",
    &[
        ("pose", POSE_PART),
        ("billboard", Bool),
        ("font_size", F64),
        ("scale_invariant", Bool),
        ("color", COLOR_PART),
        ("text", Text),
    ],
);
const MODEL: ProtoShape = shape(
    "foxglove.ModelPrimitive",
    &[
        ("pose", POSE_PART),
        ("scale", VECTOR_PART),
        ("color", COLOR_PART),
        ("override_color", Bool),
        ("url", Text),
        ("media_type", Text),
        ("data", Bytes),
    ],
);
const ENTITY: ProtoShape = shape(
    "foxglove.SceneEntity",
    &[
        ("timestamp", Part("google.protobuf.Timestamp")),
        ("frame_id", Text),
        ("id", Text),
        ("lifetime", Part("google.protobuf.Duration")),
        ("frame_locked", Bool),
        ("metadata", Parts("foxglove.KeyValuePair")),
        ("arrows", Parts("foxglove.ArrowPrimitive")),
        ("cubes", Parts("foxglove.CubePrimitive")),
        ("spheres", Parts("foxglove.SpherePrimitive")),
        ("cylinders", Parts("foxglove.CylinderPrimitive")),
        ("lines", Parts("foxglove.LinePrimitive")),
        ("triangles", Parts("foxglove.TriangleListPrimitive")),
        ("texts", Parts("foxglove.TextPrimitive")),
        ("models", Parts("foxglove.ModelPrimitive")),
    ],
);
const DELETION: ProtoShape = shape(
    "foxglove.SceneEntityDeletion",
    &[
        ("timestamp", Part("google.protobuf.Timestamp")),
        ("type", Choice("Type", &["MATCHING_ID", "ALL"])),
        ("id", Text),
    ],
);

const SPAN: ProtoFile =
    ProtoFile { name: "google/protobuf/duration.proto", imports: &[], messages: &[DURATION] };

/// What describes [`SCENE_UPDATE`], with all kinds of shapes that a viewer may look for.
pub(super) const SCENE_FILES: &[ProtoFile] = &[
    TIME,
    SPAN,
    ProtoFile {
        name: "foxglove/SceneUpdate.proto",
        imports: &[TIME.name, SPAN.name],
        messages: &[
            VECTOR,
            QUATERNION,
            POSE,
            COLOR,
            POINT,
            PAIR,
            ARROW,
            CUBE,
            SPHERE,
            CYLINDER,
            LINE,
            TRIANGLES,
            TEXT,
            MODEL,
            ENTITY,
            DELETION,
            SCENE_UPDATE,
        ],
    },
];

/// Red, green, blue and opacity, each from 0 to 1.
pub(crate) type Color = [f64; 4];

/// What has one place and moves with one frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Entity {
    pub(crate) frame: String,
    pub(crate) id: String,
    pub(crate) color: Color,
    pub(crate) cubes: Vec<Solid>,
    pub(crate) spheres: Vec<Solid>,
    pub(crate) cylinders: Vec<Solid>,
    /// Points of each line \[m\].
    pub(crate) lines: Vec<Vec<[f64; 3]>>,
}

/// A cube, sphere or cylinder: its centre and turn in the entity's frame, and its size along its own axes
/// \[m\]. A cylinder stands along its z axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Solid {
    pub(crate) centre: [f64; 3],
    pub(crate) turn: Turn,
    pub(crate) size: [f64; 3],
}

/// A `SceneUpdate` in which `entities` replace all before, at `time_ns` since 1970.
pub(crate) fn update(entities: &[Entity], time_ns: u64) -> Vec<u8> {
    let time = timestamp(time_ns);
    let all = [ProtoValue::Part(&time), ProtoValue::Choice(1), ProtoValue::Text("")];
    let deletion = encode(&DELETION, &all).unwrap_or_default();
    let entities: Vec<Vec<u8>> = entities.iter().map(|entity| encoded(entity, &time)).collect();
    encode(&SCENE_UPDATE, &[ProtoValue::Parts(&[deletion]), ProtoValue::Parts(&entities)]).unwrap_or_default()
}

fn encoded(entity: &Entity, time: &[u8]) -> Vec<u8> {
    let color = encode(&COLOR, &entity.color.map(ProtoValue::F64)).unwrap_or_default();
    let boxes = |shape: &ProtoShape, solids: &[Solid]| -> Vec<Vec<u8>> {
        let encoded = |one: &Solid| {
            let [pose, size] = one.parts();
            encode(shape, &[ProtoValue::Part(&pose), ProtoValue::Part(&size), ProtoValue::Part(&color)])
        };
        solids.iter().filter_map(encoded).collect()
    };
    let cylinder = |one: &Solid| {
        let ([pose, size], whole) = (one.parts(), ProtoValue::F64(1.0));
        let values =
            [ProtoValue::Part(&pose), ProtoValue::Part(&size), whole, whole, ProtoValue::Part(&color)];
        encode(&CYLINDER, &values)
    };
    let (cubes, spheres) = (boxes(&CUBE, &entity.cubes), boxes(&SPHERE, &entity.spheres));
    let cylinders: Vec<Vec<u8>> = entity.cylinders.iter().filter_map(cylinder).collect();
    let lines: Vec<Vec<u8>> = entity.lines.iter().filter_map(|points| line(points, &color)).collect();
    let none = ProtoValue::Parts(&[]);
    let values = [
        ProtoValue::Part(time),
        ProtoValue::Text(&entity.frame),
        ProtoValue::Text(&entity.id),
        // It stays for as long as nothing takes its place, and moves with its frame.
        ProtoValue::Part(&[]),
        ProtoValue::Bool(true),
        none,
        none,
        ProtoValue::Parts(&cubes),
        ProtoValue::Parts(&spheres),
        ProtoValue::Parts(&cylinders),
        ProtoValue::Parts(&lines),
        none,
        none,
        none,
    ];
    encode(&ENTITY, &values).unwrap_or_default()
}

/// A line through `points`, two millimetres wide.
fn line(points: &[[f64; 3]], color: &[u8]) -> Option<Vec<u8>> {
    let points: Vec<Vec<u8>> =
        points.iter().filter_map(|at| encode(&POINT, &at.map(ProtoValue::F64))).collect();
    let (none, upright) = (vector(&[0.0; 3]), quaternion(UPRIGHT));
    let pose = encode(&POSE, &[ProtoValue::Part(&none), ProtoValue::Part(&upright)])?;
    let values = [
        ProtoValue::Choice(0),
        ProtoValue::Part(&pose),
        ProtoValue::F64(0.002),
        ProtoValue::Bool(false),
        ProtoValue::Parts(&points),
        ProtoValue::Part(color),
        ProtoValue::Parts(&[]),
        ProtoValue::Fixed32s(&[]),
    ];
    encode(&LINE, &values)
}

impl Solid {
    /// Its `Pose` and its size.
    fn parts(&self) -> [Vec<u8>; 2] {
        let (position, turn) = (vector(&self.centre), quaternion(self.turn));
        let pose = encode(&POSE, &[ProtoValue::Part(&position), ProtoValue::Part(&turn)]);
        [pose.unwrap_or_default(), vector(&self.size)]
    }
}
