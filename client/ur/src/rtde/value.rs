//! Types and values of RTDE fields, to and from bytes.

/// Type of a field, under the word with which the protocol names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FieldType {
    /// `BOOL`, one byte.
    Bool,
    /// `UINT8`
    Uint8,
    /// `UINT32`
    Uint32,
    /// `UINT64`
    Uint64,
    /// `INT32`
    Int32,
    /// `DOUBLE`
    Double,
    /// `VECTOR3D`, three doubles.
    Vector3d,
    /// `VECTOR6D`, six doubles.
    Vector6d,
    /// `VECTOR6INT32`
    Vector6Int32,
    /// `VECTOR6UINT32`
    Vector6Uint32,
}

impl FieldType {
    pub const ALL: [Self; 10] = [
        Self::Bool,
        Self::Uint8,
        Self::Uint32,
        Self::Uint64,
        Self::Int32,
        Self::Double,
        Self::Vector3d,
        Self::Vector6d,
        Self::Vector6Int32,
        Self::Vector6Uint32,
    ];

    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Bool => "BOOL",
            Self::Uint8 => "UINT8",
            Self::Uint32 => "UINT32",
            Self::Uint64 => "UINT64",
            Self::Int32 => "INT32",
            Self::Double => "DOUBLE",
            Self::Vector3d => "VECTOR3D",
            Self::Vector6d => "VECTOR6D",
            Self::Vector6Int32 => "VECTOR6INT32",
            Self::Vector6Uint32 => "VECTOR6UINT32",
        }
    }

    /// The type that a word names.
    #[must_use]
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.word() == word)
    }

    /// Bytes of one value.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::Bool | Self::Uint8 => 1,
            Self::Uint32 | Self::Int32 => 4,
            Self::Uint64 | Self::Double => 8,
            Self::Vector3d | Self::Vector6Int32 | Self::Vector6Uint32 => 24,
            Self::Vector6d => 48,
        }
    }

    /// Takes one value of this type from the front of `bytes`; `None` where they are too few.
    pub fn take(self, bytes: &mut &[u8]) -> Option<RtdeValue> {
        Some(match self {
            Self::Bool => RtdeValue::Bool(take::<1>(bytes)? != [0]),
            Self::Uint8 => RtdeValue::Uint8(u8::from_be_bytes(take(bytes)?)),
            Self::Uint32 => RtdeValue::Uint32(u32::from_be_bytes(take(bytes)?)),
            Self::Uint64 => RtdeValue::Uint64(u64::from_be_bytes(take(bytes)?)),
            Self::Int32 => RtdeValue::Int32(i32::from_be_bytes(take(bytes)?)),
            Self::Double => RtdeValue::Double(f64::from_be_bytes(take(bytes)?)),
            Self::Vector3d => RtdeValue::Vector3d(several(bytes, f64::from_be_bytes)?),
            Self::Vector6d => RtdeValue::Vector6d(several(bytes, f64::from_be_bytes)?),
            Self::Vector6Int32 => RtdeValue::Vector6Int32(several(bytes, i32::from_be_bytes)?),
            Self::Vector6Uint32 => RtdeValue::Vector6Uint32(several(bytes, u32::from_be_bytes)?),
        })
    }
}

/// Takes `N` bytes from the front; leaves `bytes` alone where they are too few.
pub(crate) fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (head, tail) = bytes.split_first_chunk::<N>()?;
    *bytes = tail;
    Some(*head)
}

fn several<T: Copy + Default, const N: usize, const M: usize>(
    bytes: &mut &[u8],
    read: fn([u8; N]) -> T,
) -> Option<[T; M]> {
    let mut values = [T::default(); M];
    for value in &mut values {
        *value = read(take(bytes)?);
    }
    Some(values)
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RtdeValue {
    /// `BOOL`
    Bool(bool),
    /// `UINT8`
    Uint8(u8),
    /// `UINT32`
    Uint32(u32),
    /// `UINT64`
    Uint64(u64),
    /// `INT32`
    Int32(i32),
    /// `DOUBLE`
    Double(f64),
    /// `VECTOR3D`
    Vector3d([f64; 3]),
    /// `VECTOR6D`
    Vector6d([f64; 6]),
    /// `VECTOR6INT32`
    Vector6Int32([i32; 6]),
    /// `VECTOR6UINT32`
    Vector6Uint32([u32; 6]),
}

impl RtdeValue {
    #[must_use]
    pub const fn field_type(self) -> FieldType {
        match self {
            Self::Bool(_) => FieldType::Bool,
            Self::Uint8(_) => FieldType::Uint8,
            Self::Uint32(_) => FieldType::Uint32,
            Self::Uint64(_) => FieldType::Uint64,
            Self::Int32(_) => FieldType::Int32,
            Self::Double(_) => FieldType::Double,
            Self::Vector3d(_) => FieldType::Vector3d,
            Self::Vector6d(_) => FieldType::Vector6d,
            Self::Vector6Int32(_) => FieldType::Vector6Int32,
            Self::Vector6Uint32(_) => FieldType::Vector6Uint32,
        }
    }

    pub fn put(self, bytes: &mut Vec<u8>) {
        match self {
            Self::Bool(value) => bytes.push(u8::from(value)),
            Self::Uint8(value) => bytes.push(value),
            Self::Uint32(value) => bytes.extend_from_slice(&value.to_be_bytes()),
            Self::Uint64(value) => bytes.extend_from_slice(&value.to_be_bytes()),
            Self::Int32(value) => bytes.extend_from_slice(&value.to_be_bytes()),
            Self::Double(value) => bytes.extend_from_slice(&value.to_be_bytes()),
            Self::Vector3d(values) => bytes.extend(values.iter().flat_map(|value| value.to_be_bytes())),
            Self::Vector6d(values) => bytes.extend(values.iter().flat_map(|value| value.to_be_bytes())),
            Self::Vector6Int32(values) => bytes.extend(values.iter().flat_map(|value| value.to_be_bytes())),
            Self::Vector6Uint32(values) => bytes.extend(values.iter().flat_map(|value| value.to_be_bytes())),
        }
    }

    /// A `DOUBLE`, else `None`.
    #[must_use]
    pub const fn double(self) -> Option<f64> {
        if let Self::Double(value) = self { Some(value) } else { None }
    }

    /// An `INT32`, else `None`.
    #[must_use]
    pub const fn int32(self) -> Option<i32> {
        if let Self::Int32(value) = self { Some(value) } else { None }
    }

    /// A `UINT32`, else `None`.
    #[must_use]
    pub const fn uint32(self) -> Option<u32> {
        if let Self::Uint32(value) = self { Some(value) } else { None }
    }

    /// A `UINT8`, else `None`.
    #[must_use]
    pub const fn uint8(self) -> Option<u8> {
        if let Self::Uint8(value) = self { Some(value) } else { None }
    }

    /// A `BOOL`, else `None`.
    #[must_use]
    pub const fn bool(self) -> Option<bool> {
        if let Self::Bool(value) = self { Some(value) } else { None }
    }

    /// A `VECTOR6D`, else `None`.
    #[must_use]
    pub const fn vector6d(self) -> Option<[f64; 6]> {
        if let Self::Vector6d(value) = self { Some(value) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_the_size_of_their_type_and_come_back() {
        let values = [
            RtdeValue::Bool(true),
            RtdeValue::Uint8(0xa5),
            RtdeValue::Uint32(0x0102_0304),
            RtdeValue::Uint64(0x0102_0304_0506_0708),
            RtdeValue::Int32(-2),
            RtdeValue::Double(-0.1),
            RtdeValue::Vector3d([1.0, -2.0, 3.5]),
            RtdeValue::Vector6d([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            RtdeValue::Vector6Int32([-1, 2, -3, 4, -5, 6]),
            RtdeValue::Vector6Uint32([1, 2, 3, 4, 5, u32::MAX]),
        ];
        assert_eq!(values.map(RtdeValue::field_type), FieldType::ALL);
        for value in values {
            let kind = value.field_type();
            let mut bytes = Vec::new();
            value.put(&mut bytes);
            assert_eq!(bytes.len(), kind.size());
            let mut short = &bytes[..bytes.len() - 1];
            assert_eq!(kind.take(&mut short), None);
            let mut all = &bytes[..];
            assert_eq!(kind.take(&mut all), Some(value));
            assert!(all.is_empty());
            assert_eq!(FieldType::from_word(kind.word()), Some(kind));
        }
    }

    #[test]
    fn numbers_are_big_endian() {
        let mut bytes = Vec::new();
        RtdeValue::Int32(-2).put(&mut bytes);
        RtdeValue::Double(1.0).put(&mut bytes);
        assert_eq!(bytes, [0xff, 0xff, 0xff, 0xfe, 0x3f, 0xf0, 0, 0, 0, 0, 0, 0]);
    }
}
