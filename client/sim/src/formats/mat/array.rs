//! Variables of a MATLAB v5 file: numbers, texts, cell arrays and structures; compressed or not.
//!
//! Contract: memory is bounded by the limits below whatever the bytes say; nothing panics.
//! Source: "MAT-File Format", The MathWorks, chapter 1 (level 5).

use super::bytes::{Element, Elements, kind};
use flate2::read::ZlibDecoder;
use std::io::Read as _;

pub(super) const HEADER_BYTES: usize = 128;
/// Numbers kept of a file, all variables together.
pub(super) const NUMBERS_MAX: usize = 16 << 20;
const ARRAYS_MAX: usize = 1 << 20;
const DEPTH_MAX: usize = 8;
/// Bytes that all compressed variables together may grow to.
const INFLATED_MAX: u64 = 128 << 20;

/// A variable, cell or field.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Array {
    pub(super) name: String,
    pub(super) dims: Vec<usize>,
    pub(super) content: ArrayContent,
}

/// What an array holds, column after column.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum ArrayContent {
    Numbers(Vec<f64>),
    Text(String),
    Cells(Vec<Array>),
    /// The fields of a structure; of an array of structures, those of the first.
    Fields(Vec<Array>),
    /// A class that nothing here needs.
    Other,
}

impl Array {
    pub(super) fn cells(&self) -> Option<&[Array]> {
        if let ArrayContent::Cells(cells) = &self.content { Some(cells) } else { None }
    }

    pub(super) fn text(&self) -> Option<&str> {
        if let ArrayContent::Text(text) = &self.content { Some(text) } else { None }
    }

    pub(super) fn field(&self, name: &str) -> Option<&Array> {
        if let ArrayContent::Fields(fields) = &self.content {
            fields.iter().find(|f| f.name == name)
        } else {
            None
        }
    }
}

/// What is left of the limits.
struct ReadBudget {
    numbers: usize,
    arrays: usize,
    inflated: u64,
}

/// All variables of a file.
pub(super) fn read_file(file: &[u8]) -> Result<Vec<Array>, String> {
    let (header, body) = file
        .split_first_chunk::<HEADER_BYTES>()
        .ok_or_else(|| format!("{} bytes; a MATLAB file begins with {HEADER_BYTES}", file.len()))?;
    if header.starts_with(b"MATLAB 7.3") {
        return Err("MATLAB 7.3 (HDF5); save it with -v7 or -v6".to_owned());
    }
    let little_endian = match &header[124..] {
        [0, 1, b'I', b'M'] => true,
        [1, 0, b'M', b'I'] => false,
        _ => return Err("not a MATLAB v5 file; save it with -v7 or -v6".to_owned()),
    };
    let mut budget = ReadBudget { numbers: NUMBERS_MAX, arrays: ARRAYS_MAX, inflated: INFLATED_MAX };
    let mut elements = Elements::new(body, little_endian);
    let mut variables = Vec::new();
    while !elements.is_empty() {
        let number = variables.len() + 1;
        let element = elements.next(&format!("variable {number}"))?;
        let variable = if element.kind == kind::COMPRESSED {
            let inflated =
                inflate(element.data, &mut budget).map_err(|why| format!("variable {number}: {why}"))?;
            let mut inside = Elements::new(&inflated, little_endian);
            let element = inside.next(&format!("variable {number}"))?;
            matrix(&inside, element, 0, &mut budget)
        } else {
            matrix(&elements, element, 0, &mut budget)
        };
        variables.push(variable.map_err(|why| format!("variable {number}: {why}"))?);
    }
    Ok(variables)
}

fn inflate(data: &[u8], budget: &mut ReadBudget) -> Result<Vec<u8>, String> {
    let mut inflated = Vec::new();
    ZlibDecoder::new(data)
        .take(budget.inflated + 1)
        .read_to_end(&mut inflated)
        .map_err(|error| format!("the compressed data are damaged: {error}"))?;
    budget.inflated = budget
        .inflated
        .checked_sub(inflated.len() as u64)
        .ok_or_else(|| format!("the compressed data inflate to more than {INFLATED_MAX} bytes"))?;
    Ok(inflated)
}

fn matrix(
    all: &Elements<'_>,
    element: Element<'_>,
    depth: usize,
    budget: &mut ReadBudget,
) -> Result<Array, String> {
    if element.kind != kind::MATRIX {
        return Err(format!(
            "an element of type {} where an array must stand (type {})",
            element.kind,
            kind::MATRIX
        ));
    }
    budget.arrays =
        budget.arrays.checked_sub(1).ok_or_else(|| format!("more than {ARRAYS_MAX} arrays in the file"))?;
    if depth > DEPTH_MAX {
        return Err(format!("arrays nested deeper than {DEPTH_MAX}"));
    }
    if element.data.is_empty() {
        return Ok(Array {
            name: String::new(),
            dims: vec![0, 0],
            content: ArrayContent::Numbers(Vec::new()),
        });
    }
    let mut parts = all.inside(element.data);
    let flags = parts.expect(kind::UINT32, "the array's flags")?;
    let flags = parts.numbers(Element { kind: kind::UINT32, data: flags }, 2)?;
    let class = flags.first().map_or(0, |f| *f as u32 & 0xff);
    let dims = dimensions(&mut parts)?;
    let name = String::from_utf8_lossy(parts.expect(kind::INT8, "the array's name")?).into_owned();
    let name: String = name.chars().take(63).collect();
    let content = content(&mut parts, class, &dims, depth, budget)
        .map_err(|why| if name.is_empty() { why } else { format!("{name}: {why}") })?;
    Ok(Array { name, dims, content })
}

fn dimensions(parts: &mut Elements<'_>) -> Result<Vec<usize>, String> {
    let data = parts.expect(kind::INT32, "the array's dimensions")?;
    let dims = parts.numbers(Element { kind: kind::INT32, data }, 32)?;
    if dims.len() < 2 || dims.iter().any(|d| *d < 0.0) {
        return Err(format!("dimensions {dims:?}; legal: two or more, none negative"));
    }
    Ok(dims.into_iter().map(|d| d as usize).collect())
}

fn content(
    parts: &mut Elements<'_>,
    class: u32,
    dims: &[usize],
    depth: usize,
    budget: &mut ReadBudget,
) -> Result<ArrayContent, String> {
    let count = dims.iter().try_fold(1usize, |n, d| n.checked_mul(*d)).unwrap_or(usize::MAX);
    match class {
        1 => {
            let mut cells = Vec::new();
            for index in 1..=count {
                let cell = parts.next(&format!("cell {index} of {count}"))?;
                cells.push(
                    matrix(parts, cell, depth + 1, budget).map_err(|why| format!("cell {index}: {why}"))?,
                );
            }
            Ok(ArrayContent::Cells(cells))
        }
        2 => fields(parts, count, depth, budget),
        4 => {
            let numbers = numbers(parts, count, budget)?;
            let text =
                numbers.iter().map(|n| char::from_u32(*n as u32).unwrap_or(char::REPLACEMENT_CHARACTER));
            Ok(ArrayContent::Text(text.collect()))
        }
        6..=15 => Ok(ArrayContent::Numbers(numbers(parts, count, budget)?)),
        _ => Ok(ArrayContent::Other),
    }
}

/// The real part; an imaginary one is left.
fn numbers(parts: &mut Elements<'_>, count: usize, budget: &mut ReadBudget) -> Result<Vec<f64>, String> {
    let numbers = parts.next("its numbers").and_then(|element| parts.numbers(element, budget.numbers))?;
    if numbers.len() != count {
        return Err(format!("{} numbers where its dimensions say {count}", numbers.len()));
    }
    budget.numbers -= numbers.len();
    Ok(numbers)
}

fn fields(
    parts: &mut Elements<'_>,
    count: usize,
    depth: usize,
    budget: &mut ReadBudget,
) -> Result<ArrayContent, String> {
    let width = parts.expect(kind::INT32, "the length of field names")?;
    let width = parts.numbers(Element { kind: kind::INT32, data: width }, 1)?;
    let width = width.first().map_or(0, |w| *w as usize);
    let names = parts.expect(kind::INT8, "the field names")?;
    if width == 0 || !names.len().is_multiple_of(width) {
        return Err(format!("{} bytes of field names, {width} for each", names.len()));
    }
    let mut fields = Vec::new();
    for name in names.chunks_exact(width).take(if count == 0 { 0 } else { usize::MAX }) {
        let end = name.iter().position(|b| *b == 0).unwrap_or(width);
        let name = String::from_utf8_lossy(name.get(..end).unwrap_or_default()).into_owned();
        let element = parts.next(&format!("field {name}"))?;
        let field = matrix(parts, element, depth + 1, budget).map_err(|why| format!("{name}: {why}"))?;
        fields.push(Array { name, ..field });
    }
    Ok(ArrayContent::Fields(fields))
}
