//! Foxglove's `SceneUpdate`: entities, and the shapes that they are made of.
//!
//! Source: the schemas of github.com/foxglove/foxglove-sdk without their newest fields from 100 on.

use super::foxglove::{QUATERNION, TIME, Turn, UPRIGHT, VECTOR, quaternion, timestamp, vector};
use crate::proto::{Kind, ProtoFile, Shape, Value, encode};

/// Foxglove's `SceneUpdate`.
pub const SCENE_UPDATE: Shape = Shape {
    name: "foxglove.SceneUpdate",
    fields: &[
        ("deletions", Kind::Parts("foxglove.SceneEntityDeletion")),
        ("entities", Kind::Parts("foxglove.SceneEntity")),
    ],
};

const DURATION: Shape =
    Shape { name: "google.protobuf.Duration", fields: &[("seconds", Kind::I64), ("nanos", Kind::I32)] };

const POSE_PART: Kind = Kind::Part("foxglove.Pose");
const COLOR_PART: Kind = Kind::Part("foxglove.Color");
const VECTOR_PART: Kind = Kind::Part("foxglove.Vector3");

const POSE: Shape = Shape {
    name: "foxglove.Pose",
    fields: &[("position", VECTOR_PART), ("orientation", Kind::Part("foxglove.Quaternion"))],
};
const COLOR: Shape = Shape {
    name: "foxglove.Color",
    fields: &[("r", Kind::F64), ("g", Kind::F64), ("b", Kind::F64), ("a", Kind::F64)],
};
const POINT: Shape =
    Shape { name: "foxglove.Point3", fields: &[("x", Kind::F64), ("y", Kind::F64), ("z", Kind::F64)] };
const PAIR: Shape =
    Shape { name: "foxglove.KeyValuePair", fields: &[("key", Kind::Text), ("value", Kind::Text)] };
const ARROW: Shape = Shape {
    name: "foxglove.ArrowPrimitive",
    fields: &[
        ("pose", POSE_PART),
        ("shaft_length", Kind::F64),
        ("shaft_diameter", Kind::F64),
        ("head_length", Kind::F64),
        ("head_diameter", Kind::F64),
        ("color", COLOR_PART),
    ],
};
const CUBE: Shape = Shape {
    name: "foxglove.CubePrimitive",
    fields: &[("pose", POSE_PART), ("size", VECTOR_PART), ("color", COLOR_PART)],
};
const SPHERE: Shape = Shape {
    name: "foxglove.SpherePrimitive",
    fields: &[("pose", POSE_PART), ("size", VECTOR_PART), ("color", COLOR_PART)],
};
const CYLINDER: Shape = Shape {
    name: "foxglove.CylinderPrimitive",
    fields: &[
        ("pose", POSE_PART),
        ("size", VECTOR_PART),
        ("bottom_scale", Kind::F64),
        ("top_scale", Kind::F64),
        ("color", COLOR_PART),
    ],
};
const LINE: Shape = Shape {
    name: "foxglove.LinePrimitive",
    fields: &[
        ("type", Kind::Choice("Type", &["LINE_STRIP", "LINE_LOOP", "LINE_LIST"])),
        ("pose", POSE_PART),
        ("thickness", Kind::F64),
        ("scale_invariant", Kind::Bool),
        ("points", Kind::Parts("foxglove.Point3")),
        ("color", COLOR_PART),
        ("colors", Kind::Parts("foxglove.Color")),
        ("indices", Kind::Fixed32s),
    ],
};
const TRIANGLES: Shape = Shape {
    name: "foxglove.TriangleListPrimitive",
    fields: &[
        ("pose", POSE_PART),
        ("points", Kind::Parts("foxglove.Point3")),
        ("color", COLOR_PART),
        ("colors", Kind::Parts("foxglove.Color")),
        ("indices", Kind::Fixed32s),
    ],
};
const TEXT: Shape = Shape {
    name: "foxglove.TextPrimitive",
    fields: &[
        ("pose", POSE_PART),
        ("billboard", Kind::Bool),
        ("font_size", Kind::F64),
        ("scale_invariant", Kind::Bool),
        ("color", COLOR_PART),
        ("text", Kind::Text),
    ],
};
const MODEL: Shape = Shape {
    name: "foxglove.ModelPrimitive",
    fields: &[
        ("pose", POSE_PART),
        ("scale", VECTOR_PART),
        ("color", COLOR_PART),
        ("override_color", Kind::Bool),
        ("url", Kind::Text),
        ("media_type", Kind::Text),
        ("data", Kind::Bytes),
    ],
};
const ENTITY: Shape = Shape {
    name: "foxglove.SceneEntity",
    fields: &[
        ("timestamp", Kind::Part("google.protobuf.Timestamp")),
        ("frame_id", Kind::Text),
        ("id", Kind::Text),
        ("lifetime", Kind::Part("google.protobuf.Duration")),
        ("frame_locked", Kind::Bool),
        ("metadata", Kind::Parts("foxglove.KeyValuePair")),
        ("arrows", Kind::Parts("foxglove.ArrowPrimitive")),
        ("cubes", Kind::Parts("foxglove.CubePrimitive")),
        ("spheres", Kind::Parts("foxglove.SpherePrimitive")),
        ("cylinders", Kind::Parts("foxglove.CylinderPrimitive")),
        ("lines", Kind::Parts("foxglove.LinePrimitive")),
        ("triangles", Kind::Parts("foxglove.TriangleListPrimitive")),
        ("texts", Kind::Parts("foxglove.TextPrimitive")),
        ("models", Kind::Parts("foxglove.ModelPrimitive")),
    ],
};
const DELETION: Shape = Shape {
    name: "foxglove.SceneEntityDeletion",
    fields: &[
        ("timestamp", Kind::Part("google.protobuf.Timestamp")),
        ("type", Kind::Choice("Type", &["MATCHING_ID", "ALL"])),
        ("id", Kind::Text),
    ],
};

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

/// A `SceneUpdate` in which `entities` take the place of all before, at `time_ns` since 1970.
pub(crate) fn update(entities: &[Entity], time_ns: u64) -> Vec<u8> {
    let time = timestamp(time_ns);
    let all = [Value::Part(&time), Value::Choice(1), Value::Text("")];
    let deletion = encode(&DELETION, &all).unwrap_or_default();
    let entities: Vec<Vec<u8>> = entities.iter().map(|entity| encoded(entity, &time)).collect();
    encode(&SCENE_UPDATE, &[Value::Parts(&[deletion]), Value::Parts(&entities)]).unwrap_or_default()
}

fn encoded(entity: &Entity, time: &[u8]) -> Vec<u8> {
    let color = encode(&COLOR, &entity.color.map(Value::F64)).unwrap_or_default();
    let boxes = |shape: &Shape, solids: &[Solid]| -> Vec<Vec<u8>> {
        let encoded = |one: &Solid| {
            let [pose, size] = one.parts();
            encode(shape, &[Value::Part(&pose), Value::Part(&size), Value::Part(&color)])
        };
        solids.iter().filter_map(encoded).collect()
    };
    let cylinder = |one: &Solid| {
        let ([pose, size], whole) = (one.parts(), Value::F64(1.0));
        let values = [Value::Part(&pose), Value::Part(&size), whole, whole, Value::Part(&color)];
        encode(&CYLINDER, &values)
    };
    let (cubes, spheres) = (boxes(&CUBE, &entity.cubes), boxes(&SPHERE, &entity.spheres));
    let cylinders: Vec<Vec<u8>> = entity.cylinders.iter().filter_map(cylinder).collect();
    let lines: Vec<Vec<u8>> = entity.lines.iter().filter_map(|points| line(points, &color)).collect();
    let none = Value::Parts(&[]);
    let values = [
        Value::Part(time),
        Value::Text(&entity.frame),
        Value::Text(&entity.id),
        // It stays for as long as nothing takes its place, and moves with its frame.
        Value::Part(&[]),
        Value::Bool(true),
        none,
        none,
        Value::Parts(&cubes),
        Value::Parts(&spheres),
        Value::Parts(&cylinders),
        Value::Parts(&lines),
        none,
        none,
        none,
    ];
    encode(&ENTITY, &values).unwrap_or_default()
}

/// A line through `points`, two millimetres wide.
fn line(points: &[[f64; 3]], color: &[u8]) -> Option<Vec<u8>> {
    let points: Vec<Vec<u8>> = points.iter().filter_map(|at| encode(&POINT, &at.map(Value::F64))).collect();
    let (none, upright) = (vector(&[0.0; 3]), quaternion(UPRIGHT));
    let pose = encode(&POSE, &[Value::Part(&none), Value::Part(&upright)])?;
    let values = [
        Value::Choice(0),
        Value::Part(&pose),
        Value::F64(0.002),
        Value::Bool(false),
        Value::Parts(&points),
        Value::Part(color),
        Value::Parts(&[]),
        Value::Fixed32s(&[]),
    ];
    encode(&LINE, &values)
}

impl Solid {
    /// Its `Pose` and its size.
    fn parts(&self) -> [Vec<u8>; 2] {
        let (place, turn) = (vector(&self.centre), quaternion(self.turn));
        let pose = encode(&POSE, &[Value::Part(&place), Value::Part(&turn)]);
        [pose.unwrap_or_default(), vector(&self.size)]
    }
}
