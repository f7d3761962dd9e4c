//! Layout of wire types: the macro that declares them, the field table it makes, and the hash over that
//! table.
//!
//! Contract: a type declared with `wire!` lists its fields once; name, offset, size and type of each enter
//! [`Wire::LAYOUT_HASH`], recursively. Implicit padding does not compile. Bytes written by [`Wire::put`]
//! equal the memory image on a little-endian machine.

use std::fmt::Debug;

use iceoryx2::prelude::ZeroCopySend;

#[cfg(target_endian = "big")]
compile_error!("foretrace messages are defined for little-endian machines");

/// What a wire type is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WireShape {
    /// A number of fixed width, by its name in Rust.
    Number(&'static str),
    /// So many of one shape.
    Array(&'static Self, usize),
    /// A struct, as it was declared.
    Struct(&'static Declaration),
}

/// A struct that `wire!` declared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Declaration {
    /// Name in the source.
    pub name: &'static str,
    /// Its attributes, a line each; documentation is `doc = "..."`.
    pub attributes: &'static str,
    /// Size \[bytes\].
    pub size: usize,
    /// In order of declaration.
    pub fields: &'static [Field],
}

/// One field of a wire type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Name in the source.
    pub name: &'static str,
    /// Its attributes, a line each, as in [`Declaration`].
    pub attributes: &'static str,
    /// What its type is made of.
    pub shape: &'static WireShape,
    /// Bytes from the start of the type.
    pub offset: usize,
    /// Size \[bytes\].
    pub size: usize,
    /// Layout hash of its type.
    pub type_hash: u64,
}

/// A type that may be a field of a message: fixed-width numbers, arrays of them, other wire types.
///
/// `bool`, `char`, enums, references and `usize` are excluded: a foreign writer could store a bit pattern
/// that is undefined behaviour to read, or that has another size in another process.
pub trait Wire: Debug + Copy + PartialEq + ZeroCopySend + 'static {
    /// The fields of a struct in order of declaration; empty for numbers and arrays.
    const FIELDS: &'static [Field];
    /// What it is made of.
    const SHAPE: WireShape;
    /// FNV-1a over names, offsets, sizes and types of all fields.
    const LAYOUT_HASH: u64;
    /// All bytes zero.
    const ZERO: Self;
    /// Appends the little-endian bytes.
    fn put(&self, bytes: &mut Vec<u8>);
    /// Takes the value from the front of `bytes`; `None` if there are too few.
    fn get(bytes: &mut &[u8]) -> Option<Self>;
}

const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

/// 64-bit FNV-1a of `bytes`. Source: draft-eastlake-fnv, section 2.
pub const fn fnv1a(bytes: &[u8]) -> u64 {
    fnv1a_from(FNV_OFFSET, bytes)
}

const fn fnv1a_from(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(FNV_PRIME);
        i += 1;
    }
    hash
}

/// Hash of a whole type: its name, size and every field.
pub const fn layout_hash(name: &str, size: usize, fields: &[Field]) -> u64 {
    let mut hash = fnv1a_from(fnv1a(name.as_bytes()), &(size as u64).to_le_bytes());
    let mut i = 0;
    while i < fields.len() {
        let field = &fields[i];
        hash = fnv1a_from(hash, field.name.as_bytes());
        hash = fnv1a_from(hash, &(field.offset as u64).to_le_bytes());
        hash = fnv1a_from(hash, &(field.size as u64).to_le_bytes());
        hash = fnv1a_from(hash, &field.type_hash.to_le_bytes());
        i += 1;
    }
    hash
}

/// Whether the fields follow each other without a gap and fill `size`.
pub const fn is_gapless(fields: &[Field], size: usize) -> bool {
    let mut end = 0;
    let mut i = 0;
    while i < fields.len() {
        if fields[i].offset != end {
            return false;
        }
        end += fields[i].size;
        i += 1;
    }
    end == size
}

macro_rules! wire_number {
    ($($t:ident)*) => {$(
        impl Wire for $t {
            const FIELDS: &'static [Field] = &[];
            const SHAPE: WireShape = WireShape::Number(stringify!($t));
            const LAYOUT_HASH: u64 = fnv1a(stringify!($t).as_bytes());
            const ZERO: Self = 0 as $t;

            fn put(&self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }

            fn get(bytes: &mut &[u8]) -> Option<Self> {
                let (head, tail) = bytes.split_first_chunk()?;
                *bytes = tail;
                Some(Self::from_le_bytes(*head))
            }
        }
    )*};
}
wire_number!(u8 u16 u32 u64 i8 i16 i32 i64 f32 f64);

impl<T: Wire, const N: usize> Wire for [T; N] {
    const FIELDS: &'static [Field] = &[];
    const SHAPE: WireShape = WireShape::Array(&T::SHAPE, N);
    const LAYOUT_HASH: u64 = fnv1a_from(T::LAYOUT_HASH, &(N as u64).to_le_bytes());
    const ZERO: Self = [T::ZERO; N];

    fn put(&self, bytes: &mut Vec<u8>) {
        self.iter().for_each(|item| item.put(bytes));
    }

    fn get(bytes: &mut &[u8]) -> Option<Self> {
        let mut items = Self::ZERO;
        for item in &mut items {
            *item = T::get(bytes)?;
        }
        Some(items)
    }
}

// `ZeroCopySend` must be imported where this is used: its derive names the trait without a path.
/// Declares a wire type: `wire! { "type.nameV1" pub struct Name { pub field: type, … } }`.
macro_rules! wire {
    ($(#[$meta:meta])* $name:literal pub struct $type:ident {
        $($(#[$field_meta:meta])* pub $field:ident: $field_type:ty),+ $(,)?
    }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
        #[repr(C)]
        #[type_name($name)]
        pub struct $type {
            $($(#[$field_meta])* pub $field: $field_type,)+
        }

        impl $crate::wire::layout::Wire for $type {
            const FIELDS: &'static [$crate::wire::layout::Field] = &[$($crate::wire::layout::Field {
                name: stringify!($field),
                attributes: concat!($(stringify!($field_meta), "\n"),*),
                shape: &<$field_type as $crate::wire::layout::Wire>::SHAPE,
                offset: ::std::mem::offset_of!($type, $field),
                size: ::std::mem::size_of::<$field_type>(),
                type_hash: <$field_type as $crate::wire::layout::Wire>::LAYOUT_HASH,
            }),+];
            const SHAPE: $crate::wire::layout::WireShape =
                $crate::wire::layout::WireShape::Struct(&$crate::wire::layout::Declaration {
                    name: stringify!($type),
                    attributes: concat!($(stringify!($meta), "\n"),*),
                    size: ::std::mem::size_of::<$type>(),
                    fields: Self::FIELDS,
                });
            const LAYOUT_HASH: u64 =
                $crate::wire::layout::layout_hash($name, ::std::mem::size_of::<$type>(), Self::FIELDS);
            const ZERO: Self = Self { $($field: <$field_type as $crate::wire::layout::Wire>::ZERO),+ };

            fn put(&self, bytes: &mut Vec<u8>) {
                $($crate::wire::layout::Wire::put(&self.$field, bytes);)+
            }

            fn get(bytes: &mut &[u8]) -> Option<Self> {
                Some(Self { $($field: <$field_type as $crate::wire::layout::Wire>::get(bytes)?),+ })
            }
        }

        impl Default for $type {
            fn default() -> Self {
                <Self as $crate::wire::layout::Wire>::ZERO
            }
        }

        const _: () = assert!(
            $crate::wire::layout::is_gapless(
                <$type as $crate::wire::layout::Wire>::FIELDS,
                ::std::mem::size_of::<$type>()
            ),
            "a wire type has implicit padding: add an explicit field"
        );
    };
}
pub(crate) use wire;

#[cfg(test)]
#[expect(unreachable_pub, reason = "the macro declares public types, as the crate needs them")]
mod tests {
    use super::*;

    /// Layout hash of a type of this name with these fields.
    macro_rules! hash_of {
        ($($field:ident: $type:ty),+) => {{
            wire! {
                "test.ThingV1"
                pub struct Thing { $(pub $field: $type),+ }
            }
            Thing::LAYOUT_HASH
        }};
    }

    #[test]
    fn fnv1a_gives_the_published_values() {
        // Source: draft-eastlake-fnv, appendix C.
        assert_eq!(fnv1a(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv1a(b"a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(fnv1a(b"foobar"), 0x8594_4171_f739_67e8);
    }

    #[test]
    fn every_change_of_a_layout_changes_the_hash() {
        let changed = [
            hash_of!(a: u64, b: f64),
            hash_of!(b: f64, a: u64),
            hash_of!(a: f64, b: u64),
            hash_of!(a: u64, c: f64),
            hash_of!(a: u64, b: i64),
            hash_of!(a: u64, b: [u32; 2]),
            hash_of!(a: u64, b: [f32; 2]),
            hash_of!(a: [u64; 1], b: f64),
            hash_of!(a: u64, b: f64, c: u64),
        ];
        for (i, hash) in changed.iter().enumerate() {
            assert!(!changed[..i].contains(hash), "variant {i}");
        }
        assert_eq!(hash_of!(a: u64, b: f64), changed[0]);
    }

    #[test]
    fn a_change_inside_a_nested_type_changes_the_outer_hash() {
        mod one {
            use super::*;
            wire! { "test.InnerV1" pub struct Inner { pub x: u32, pub y: f32 } }
            wire! { "test.OuterV1" pub struct Outer { pub inner: Inner } }
        }
        mod two {
            use super::*;
            wire! { "test.InnerV1" pub struct Inner { pub x: f32, pub y: u32 } }
            wire! { "test.OuterV1" pub struct Outer { pub inner: Inner } }
        }
        assert_ne!(one::Outer::LAYOUT_HASH, two::Outer::LAYOUT_HASH);
    }

    #[test]
    fn implicit_padding_is_recognised() {
        let (name, attributes, shape) = ("x", "", &WireShape::Number("u8"));
        let field = |offset, size| Field { name, attributes, shape, offset, size, type_hash: 0 };
        assert!(is_gapless(&[field(0, 4), field(4, 8)], 12));
        assert!(!is_gapless(&[field(0, 4), field(8, 8)], 16));
        assert!(!is_gapless(&[field(0, 8), field(8, 4)], 16));
    }

    #[test]
    fn numbers_and_arrays_come_back_from_their_little_endian_bytes() {
        let mut bytes = Vec::new();
        [0x0102_u16, 0x0304].put(&mut bytes);
        (-1.5_f64).put(&mut bytes);
        assert_eq!(bytes[..4], [2, 1, 4, 3]);
        let mut rest = &bytes[..];
        assert_eq!(<[u16; 2]>::get(&mut rest), Some([0x0102, 0x0304]));
        assert_eq!((f64::get(&mut rest), rest.len()), (Some(-1.5), 0));
        assert_eq!((u8::get(&mut rest), <[u8; 2]>::get(&mut &bytes[..1])), (None, None));
    }

    #[test]
    fn a_layout_fills_its_type_and_has_no_overlap() {
        let (name, attributes, shape) = ("x", "", &WireShape::Number("u8"));
        let field = |offset, size| Field { name, attributes, shape, offset, size, type_hash: 0 };
        assert!(is_gapless(&[], 0) && !is_gapless(&[], 1));
        assert!(!is_gapless(&[field(0, 4), field(2, 4)], 8) && !is_gapless(&[field(4, 4)], 8));
        let hash = |name, size, fields: &[Field]| layout_hash(name, size, fields);
        let one = hash("a", 4, &[field(0, 4)]);
        assert!(one != hash("b", 4, &[field(0, 4)]) && one != hash("a", 8, &[field(0, 4)]));
        assert_ne!(hash("a", 4, &[field(0, 4), field(4, 4)]), hash("a", 4, &[field(0, 4), field(5, 4)]));
    }
}
