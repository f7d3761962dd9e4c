//! Protobuf, as far as a recording needs it: messages of numbers, text and other messages, and their
//! descriptors.
//!
//! Contract: a [`ProtoShape`] alone says what a message is; its field `i` has the number `i + 1`.
//! [`encode()`] writes the fields in that order and refuses to leave one out; [`descriptor_set`] describes
//! the shapes to readers that do not know them.
//!
//! Source: protobuf encoding guide; `google/protobuf/descriptor.proto`.

/// Kind of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProtoKind {
    /// `uint64`
    U64,
    /// `int64`
    I64,
    /// `uint32`
    U32,
    /// `int32`
    I32,
    /// `double`
    F64,
    /// `bool`
    Bool,
    /// `string`
    Text,
    /// `repeated double`
    F64s,
    /// A message of this full name.
    Part(&'static str),
    /// Any number of messages of this full name.
    Parts(&'static str),
    /// `fixed32`
    Fixed32,
    /// `repeated fixed32`
    Fixed32s,
    /// `bytes`, which are described only: no value has this kind.
    Bytes,
    /// An `enum` inside the message, of this name, with these values from 0.
    Choice(&'static str, &'static [&'static str]),
}

impl ProtoKind {
    /// Number of the type, and of the label (1: one, 3: many), in a descriptor.
    const fn codes(self) -> (u64, u64) {
        match self {
            Self::F64 => (1, 1),
            Self::F64s => (1, 3),
            Self::I64 => (3, 1),
            Self::U64 => (4, 1),
            Self::I32 => (5, 1),
            Self::Bool => (8, 1),
            Self::Text => (9, 1),
            Self::Part(_) => (11, 1),
            Self::Parts(_) => (11, 3),
            Self::Fixed32 => (7, 1),
            Self::Fixed32s => (7, 3),
            Self::Bytes => (12, 1),
            Self::U32 => (13, 1),
            Self::Choice(..) => (14, 1),
        }
    }
}

/// A message: its full name, and its fields in order of their numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ProtoShape {
    pub name: &'static str,
    /// Name and kind of each field.
    pub fields: &'static [(&'static str, ProtoKind)],
}

/// The message `name` with these fields.
pub(crate) const fn shape(name: &'static str, fields: &'static [(&'static str, ProtoKind)]) -> ProtoShape {
    ProtoShape { name, fields }
}

/// A `.proto` file: its name, what it imports, its messages.
#[derive(Debug, Clone, Copy)]
pub struct ProtoFile {
    /// Path that others import it by.
    pub name: &'static str,
    /// Files that it needs.
    pub imports: &'static [&'static str],
    /// Its messages, all of one package.
    pub messages: &'static [ProtoShape],
}

/// Value of a field.
#[derive(Debug, Clone, Copy)]
pub enum ProtoValue<'a> {
    /// See [`ProtoKind`].
    U64(u64),
    /// See [`ProtoKind`].
    I64(i64),
    /// See [`ProtoKind`].
    U32(u32),
    /// See [`ProtoKind`].
    I32(i32),
    /// See [`ProtoKind`].
    F64(f64),
    /// See [`ProtoKind`].
    Bool(bool),
    /// See [`ProtoKind`].
    Text(&'a str),
    /// See [`ProtoKind`].
    F64s(&'a [f64]),
    /// An encoded message of the kind's name.
    Part(&'a [u8]),
    /// Encoded messages of the kind's name.
    Parts(&'a [Vec<u8>]),
    /// See [`ProtoKind`].
    Fixed32(u32),
    /// See [`ProtoKind`].
    Fixed32s(&'a [u32]),
    /// Number of one of the kind's values.
    Choice(u32),
}

/// `values` as a message of `shape`; `None` if they are not its fields.
#[must_use]
pub fn encode(shape: &ProtoShape, values: &[ProtoValue<'_>]) -> Option<Vec<u8>> {
    if shape.fields.len() != values.len() {
        return None;
    }
    let mut bytes = Vec::with_capacity(16 * values.len());
    for (number, ((_, kind), value)) in (1..).zip(shape.fields.iter().zip(values)) {
        match (kind, *value) {
            (ProtoKind::U64, ProtoValue::U64(v)) => varint_field(&mut bytes, number, v),
            (ProtoKind::I64, ProtoValue::I64(v)) => varint_field(&mut bytes, number, v as u64),
            (ProtoKind::U32, ProtoValue::U32(v)) => varint_field(&mut bytes, number, v.into()),
            (ProtoKind::I32, ProtoValue::I32(v)) => varint_field(&mut bytes, number, i64::from(v) as u64),
            (ProtoKind::Bool, ProtoValue::Bool(v)) => varint_field(&mut bytes, number, v.into()),
            (ProtoKind::F64, ProtoValue::F64(v)) => double_field(&mut bytes, number, v),
            (ProtoKind::Text, ProtoValue::Text(v)) => sized(&mut bytes, number, v.as_bytes()),
            (ProtoKind::F64s, ProtoValue::F64s(v)) => {
                sized(&mut bytes, number, &v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>());
            }
            (ProtoKind::Part(_), ProtoValue::Part(v)) => sized(&mut bytes, number, v),
            (ProtoKind::Parts(_), ProtoValue::Parts(v)) => {
                v.iter().for_each(|v| sized(&mut bytes, number, v))
            }
            (ProtoKind::Fixed32, ProtoValue::Fixed32(v)) => {
                key(&mut bytes, number, 5);
                bytes.extend_from_slice(&v.to_le_bytes());
            }
            (ProtoKind::Fixed32s, ProtoValue::Fixed32s(v)) => {
                sized(&mut bytes, number, &v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>());
            }
            (ProtoKind::Choice(_, values), ProtoValue::Choice(v)) if (v as usize) < values.len() => {
                varint_field(&mut bytes, number, v.into());
            }
            _ => return None,
        }
    }
    Some(bytes)
}

/// The `FileDescriptorSet` of `files`.
#[must_use]
pub fn descriptor_set(files: &[ProtoFile]) -> Vec<u8> {
    let mut set = Vec::new();
    for file in files {
        let mut bytes = Vec::new();
        sized(&mut bytes, 1, file.name.as_bytes());
        let package = file.messages.first().and_then(|shape| shape.name.rsplit_once('.'));
        sized(&mut bytes, 2, package.map_or("", |(package, _)| package).as_bytes());
        for import in file.imports {
            sized(&mut bytes, 3, import.as_bytes());
        }
        for shape in file.messages {
            sized(&mut bytes, 4, &described(shape));
        }
        sized(&mut bytes, 12, b"proto3");
        sized(&mut set, 1, &bytes);
    }
    set
}

fn described(shape: &ProtoShape) -> Vec<u8> {
    let mut bytes = Vec::new();
    let name = shape.name.rsplit_once('.').map_or(shape.name, |(_, name)| name);
    sized(&mut bytes, 1, name.as_bytes());
    for (number, (name, kind)) in (1_u64..).zip(shape.fields) {
        let mut field = Vec::new();
        sized(&mut field, 1, name.as_bytes());
        varint_field(&mut field, 3, number);
        let (code, label) = kind.codes();
        varint_field(&mut field, 4, label);
        varint_field(&mut field, 5, code);
        match kind {
            ProtoKind::Part(of) | ProtoKind::Parts(of) => sized(&mut field, 6, format!(".{of}").as_bytes()),
            ProtoKind::Choice(of, _) => sized(&mut field, 6, format!(".{}.{of}", shape.name).as_bytes()),
            _ => {}
        }
        sized(&mut bytes, 2, &field);
        if let ProtoKind::Choice(of, values) = kind {
            let mut choice = Vec::new();
            sized(&mut choice, 1, of.as_bytes());
            for (number, value) in (0_u64..).zip(*values) {
                let mut described = Vec::new();
                sized(&mut described, 1, value.as_bytes());
                varint_field(&mut described, 2, number);
                sized(&mut choice, 2, &described);
            }
            sized(&mut bytes, 4, &choice);
        }
    }
    bytes
}

/// Appends field `number` with this `double`.
pub fn double_field(bytes: &mut Vec<u8>, number: u64, value: f64) {
    key(bytes, number, 1);
    bytes.extend_from_slice(&value.to_le_bytes());
}

fn key(bytes: &mut Vec<u8>, number: u64, wire: u64) {
    varint(bytes, (number << 3) | wire);
}

/// Appends field `number` with this whole number.
pub fn varint_field(bytes: &mut Vec<u8>, number: u64, value: u64) {
    key(bytes, number, 0);
    varint(bytes, value);
}

/// Appends field `number` with these bytes, text or message.
pub fn sized(bytes: &mut Vec<u8>, number: u64, content: &[u8]) {
    key(bytes, number, 2);
    varint(bytes, content.len() as u64);
    bytes.extend_from_slice(content);
}

fn varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

#[cfg(test)]
mod tests {
    use super::*;

    const THING: ProtoShape = ProtoShape {
        name: "test.Thing",
        fields: &[("a", ProtoKind::I32), ("b", ProtoKind::Text), ("c", ProtoKind::F64s)],
    };

    #[test]
    fn bytes_are_those_of_the_encoding_guide() {
        // Source: protobuf.dev/programming-guides/encoding, "Test1" and "Test2".
        let one = ProtoShape { name: "t.Test1", fields: &[("a", ProtoKind::I32)] };
        assert_eq!(encode(&one, &[ProtoValue::I32(150)]).unwrap(), [0x08, 0x96, 0x01]);
        let all =
            encode(&THING, &[ProtoValue::I32(-1), ProtoValue::Text("testing"), ProtoValue::F64s(&[1.0])])
                .unwrap();
        let mut wanted = vec![0x08];
        wanted.extend([0xff; 9]);
        wanted.extend([0x01, 0x12, 7, b't', b'e', b's', b't', b'i', b'n', b'g', 0x1a, 8]);
        wanted.extend(1.0_f64.to_le_bytes());
        assert_eq!(all, wanted);
    }

    #[test]
    fn values_that_are_not_the_fields_make_no_message() {
        assert!(encode(&THING, &[ProtoValue::I32(1)]).is_none());
        assert!(encode(&THING, &[ProtoValue::U64(1), ProtoValue::Text(""), ProtoValue::F64s(&[])]).is_none());
    }

    #[test]
    fn an_enumeration_and_a_fixed_number_are_as_their_guide_says_and_unknown_values_make_no_message() {
        const SHAPE: ProtoShape = ProtoShape {
            name: "t.Log",
            fields: &[
                ("level", ProtoKind::Choice("Level", &["UNKNOWN", "DEBUG"])),
                ("line", ProtoKind::Fixed32),
            ],
        };
        let bytes = encode(&SHAPE, &[ProtoValue::Choice(1), ProtoValue::Fixed32(258)]);
        assert_eq!(bytes.as_deref(), Some(&[0x08, 1, 0x15, 2, 1, 0, 0][..]));
        assert_eq!(encode(&SHAPE, &[ProtoValue::Choice(2), ProtoValue::Fixed32(0)]), None);
        let set = descriptor_set(&[ProtoFile { name: "t.proto", imports: &[], messages: &[SHAPE] }]);
        for text in [".t.Log.Level", "UNKNOWN", "DEBUG"] {
            assert!(set.windows(text.len()).any(|part| part == text.as_bytes()), "{text}");
        }
    }

    #[test]
    fn a_descriptor_names_package_message_and_fields() {
        let set = descriptor_set(&[ProtoFile { name: "test.proto", imports: &[], messages: &[THING] }]);
        for text in ["test.proto", "Thing", "proto3"] {
            assert!(set.windows(text.len()).any(|part| part == text.as_bytes()), "{text}");
        }
    }
}
