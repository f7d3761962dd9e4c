//! The safetensors container: names, shapes and bytes of tensors, and text metadata.
//!
//! Contract: accepts and refuses the same files as the format's reference reader (holes, overlaps, duplicate
//! names), with byte positions; borrows from the file's bytes. Writing sorts metadata and tensors, so that
//! equal content gives equal bytes (the `safetensors` crate writes metadata in random order). Only `F32` and
//! `F64` can be turned into numbers; tensors of other types pass through unread. *Source*: format description
//! in the README of `huggingface/safetensors`: header length (u64, little-endian), JSON header, data; offsets
//! count from the end of the header.

use std::collections::BTreeMap;
use std::fmt;

use serde_json::Value;

use super::problem::ModelError;

/// Longest header: thousands of tensors.
const MAX_HEADER: usize = 1 << 20;
const METADATA: &str = "__metadata__";

/// Number formats that are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DType {
    /// `f32`, what PyTorch saves by default.
    F32,
    /// `f64`.
    F64,
}

/// One tensor of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor<'a> {
    /// Number format as written: `F32`, `F64`, `BF16` …
    pub dtype: String,
    /// Rows, columns …; empty = a single number.
    pub shape: Vec<usize>,
    /// Little-endian numbers, row by row.
    pub data: &'a [u8],
}

#[derive(Debug, Clone, PartialEq, Default)]
pub struct Container<'a> {
    pub metadata: BTreeMap<String, String>,
    pub tensors: BTreeMap<String, Tensor<'a>>,
}

impl<'a> Container<'a> {
    /// Reads a whole file; `file` is what messages call it.
    ///
    /// # Errors
    ///
    /// [`ModelError::Format`].
    pub fn read(file: &str, bytes: &'a [u8]) -> Result<Self, ModelError> {
        parse(bytes).map_err(|what| ModelError::Format { file: file.to_owned(), what })
    }
}

impl Tensor<'_> {
    /// The numbers; `None` for a dtype other than `F32` and `F64`.
    #[must_use]
    pub fn numbers(&self) -> Option<Vec<f64>> {
        match self.dtype.as_str() {
            "F32" => {
                Some(self.data.as_chunks().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect())
            }
            "F64" => Some(self.data.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect()),
            _ => None,
        }
    }
}

/// Bytes of a file with these tensors (name, shape, numbers row by row) in the given number format.
#[must_use]
pub fn container_bytes(
    metadata: &BTreeMap<String, String>,
    tensors: &BTreeMap<&str, (Vec<usize>, &[f64])>,
    dtype: DType,
) -> Vec<u8> {
    let quoted = |text: &str| Value::from(text).to_string();
    let mut header = Vec::new();
    if !metadata.is_empty() {
        let pairs: Vec<_> =
            metadata.iter().map(|(key, text)| format!("{}:{}", quoted(key), quoted(text))).collect();
        header.push(format!("{}:{{{}}}", quoted(METADATA), pairs.join(",")));
    }
    let mut data = Vec::new();
    for (name, (shape, numbers)) in tensors {
        let begin = data.len();
        match dtype {
            DType::F32 => data.extend(numbers.iter().flat_map(|x| (*x as f32).to_le_bytes())),
            DType::F64 => data.extend(numbers.iter().flat_map(|x| x.to_le_bytes())),
        }
        let (name, end) = (quoted(name), data.len());
        header.push(format!(
            r#"{name}:{{"dtype":"{dtype}","shape":{shape:?},"data_offsets":[{begin},{end}]}}"#
        ));
    }
    let mut text = format!("{{{}}}", header.join(",")).into_bytes();
    text.resize(text.len().next_multiple_of(8), b' ');
    let mut bytes = (text.len() as u64).to_le_bytes().to_vec();
    bytes.extend(text);
    bytes.extend(data);
    bytes
}

impl fmt::Display for DType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::F32 => "F32",
            Self::F64 => "F64",
        })
    }
}

fn parse(bytes: &[u8]) -> Result<Container<'_>, String> {
    let (length, rest) = bytes
        .split_first_chunk()
        .ok_or_else(|| format!("it has {} bytes, a header alone has 8", bytes.len()))?;
    let length = u64::from_le_bytes(*length);
    let (header, data) = usize::try_from(length)
        .ok()
        .filter(|length| *length <= MAX_HEADER)
        .and_then(|length| rest.split_at_checked(length))
        .ok_or_else(|| {
            format!("its header would have {length} bytes, {} follow and {MAX_HEADER} are legal", rest.len())
        })?;
    let entries: Entries =
        serde_json::from_slice(header).map_err(|error| format!("its header is not legal JSON ({error})"))?;
    let mut container = Container::default();
    let mut pieces = Vec::new();
    for (name, value) in entries.0 {
        if name == METADATA {
            let Value::Object(map) = value else { return Err("its metadata is not an object".to_owned()) };
            for (key, value) in map {
                let Value::String(text) = value else {
                    return Err(format!("its metadata {key:?} is not text"));
                };
                container.metadata.insert(key, text);
            }
            continue;
        }
        let (tensor, [begin, end]) = tensor(&name, &value, data)?;
        pieces.push((begin, end, name.clone()));
        if container.tensors.insert(name.clone(), tensor).is_some() {
            return Err(format!("tensor {name:?} stands in it twice"));
        }
    }
    // No byte belongs to two tensors or to none.
    pieces.sort();
    let mut covered = 0;
    for (begin, end, name) in pieces {
        if begin != covered {
            return Err(format!(
                "tensor {name:?} begins at data byte {begin}, the one before ends at {covered}"
            ));
        }
        covered = end;
    }
    if covered != data.len() {
        return Err(format!("its tensors end at data byte {covered}, its data at {}", data.len()));
    }
    Ok(container)
}

fn tensor<'a>(name: &str, value: &Value, data: &'a [u8]) -> Result<(Tensor<'a>, [usize; 2]), String> {
    let sizes = |key: &str| -> Option<Vec<usize>> {
        value.get(key)?.as_array()?.iter().map(|n| usize::try_from(n.as_u64()?).ok()).collect()
    };
    let dtype = value.get("dtype").and_then(Value::as_str);
    let offsets = sizes("data_offsets").and_then(|offsets| <[usize; 2]>::try_from(offsets).ok());
    let (Some(dtype), Some(shape), Some([begin, end])) = (dtype, sizes("shape"), offsets) else {
        return Err(format!("tensor {name:?} lacks a dtype, a shape, or data_offsets of two numbers"));
    };
    let Some(bytes) = data.get(begin..end) else {
        return Err(format!("tensor {name:?} lies at data bytes {begin} to {end}, there are {}", data.len()));
    };
    let width = match dtype {
        "F32" => Some(4),
        "F64" => Some(8),
        _ => None,
    };
    if let Some(width) = width {
        let wanted = shape.iter().try_fold(width, |bytes: usize, n| bytes.checked_mul(*n));
        if wanted != Some(bytes.len()) {
            return Err(format!(
                "tensor {name:?} of dtype {dtype} and shape {shape:?} has {} bytes",
                bytes.len()
            ));
        }
    }
    Ok((Tensor { dtype: dtype.to_owned(), shape, data: bytes }, [begin, end]))
}

/// The header's entries in order, duplicates included (a JSON map would silently keep the last).
struct Entries(Vec<(String, Value)>);

impl<'de> serde::Deserialize<'de> for Entries {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> serde::de::Visitor<'de> for InOrder {
            type Value = Entries;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of tensors")
            }

            fn visit_map<A: serde::de::MapAccess<'de>>(self, mut map: A) -> Result<Entries, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(Entries(entries))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}
