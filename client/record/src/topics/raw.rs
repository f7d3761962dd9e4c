//! Raw topics: the table that says what their bytes are, and the bytes of a thing.

use foretrace_shm::layout::{Field, fnv1a};
use foretrace_shm::{PEN_PER_PART, PenInput, PieceKind, Thing, TickInput, Wire};

/// Stands for the layout of a thing: kind, daemon, number, bytes.
pub(super) const THING_LAYOUT: u64 = fnv1a(b"foretrace.ThingV1");

/// `layout HASH size N`, then `name offset size type` per field.
pub(super) fn layout_table(hash: u64, fields: &[Field], size: usize) -> String {
    let mut text = format!("layout {hash:016x} size {size}\n");
    for Field { name, offset, size, type_hash, .. } in fields {
        text.push_str(&format!("{name} {offset} {size} {}\n", type_name(*type_hash, *size)));
    }
    text
}

/// The fields of each pen sample in a `TickInput`, which later versions find by these rows.
pub(super) fn pen_rows() -> String {
    let mut text = String::new();
    let begin = TickInput::FIELDS.iter().find(|field| field.name == "pen").map_or(0, |field| field.offset);
    for index in 0..PEN_PER_PART {
        let begin = begin + index * size_of::<PenInput>();
        for Field { name, offset, size, type_hash, .. } in PenInput::FIELDS {
            let kind = type_name(*type_hash, *size);
            text.push_str(&format!("pen[{index}].{name} {} {size} {kind}\n", begin + offset));
        }
    }
    text
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topics::RecordingTopic;

    #[test]
    fn layout_tables_say_what_the_numbers_are() {
        let (_, _, table) = RecordingTopic::Input.schema();
        let table = String::from_utf8(table).unwrap();
        for line in [
            "tick 32 8 u64",
            "q 336 48 f64*6",
            "mode 448 4 u32",
            "pen[0].x_m 472 8 f64",
            "pen[7].y_m 872 8 f64",
        ] {
            assert!(table.lines().any(|found| found == line), "{line} in {table}");
        }
        assert!(table.starts_with(&format!("layout {:016x} size 912\n", TickInput::LAYOUT_HASH)));
    }

    #[test]
    fn a_thing_comes_back_from_its_bytes_and_nothing_from_others() {
        let thing = Thing { kind: PieceKind::Weights, number: 3, daemon_id: 9, bytes: vec![1, 2] };
        assert_eq!(thing_of(&thing_bytes(&thing)), Some(thing));
        assert_eq!(thing_of(&[0; 19]), None);
        assert_eq!(thing_of(&[9; 40]), None);
    }
}
