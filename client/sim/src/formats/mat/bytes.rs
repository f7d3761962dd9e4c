//! Data elements of a MATLAB v5 file: a tag with type and length, the data, padding to 8 bytes.

/// Types of data elements that are used here.
pub(super) mod kind {
    pub(in super::super) const INT8: u32 = 1;
    pub(in super::super) const UINT8: u32 = 2;
    pub(in super::super) const INT16: u32 = 3;
    pub(in super::super) const UINT16: u32 = 4;
    pub(in super::super) const INT32: u32 = 5;
    pub(in super::super) const UINT32: u32 = 6;
    pub(in super::super) const SINGLE: u32 = 7;
    pub(in super::super) const DOUBLE: u32 = 9;
    pub(in super::super) const INT64: u32 = 12;
    pub(in super::super) const UINT64: u32 = 13;
    pub(in super::super) const MATRIX: u32 = 14;
    pub(in super::super) const COMPRESSED: u32 = 15;
    pub(in super::super) const UTF8: u32 = 16;
    pub(in super::super) const UTF16: u32 = 17;
    pub(in super::super) const UTF32: u32 = 18;
}

/// A tag and its data.
#[derive(Debug, Clone, Copy)]
pub(super) struct Element<'a> {
    pub(super) kind: u32,
    pub(super) data: &'a [u8],
}

/// Elements one after the other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Elements<'a> {
    data: &'a [u8],
    little_endian: bool,
}

impl<'a> Elements<'a> {
    pub(super) fn new(data: &'a [u8], little_endian: bool) -> Self {
        Self { data, little_endian }
    }

    pub(super) fn inside(&self, data: &'a [u8]) -> Self {
        Self { data, ..*self }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// The next element; `what` is what should stand there.
    pub(super) fn next(&mut self, what: &str) -> Result<Element<'a>, String> {
        let cut = || format!("the data end inside {what}");
        let (tag, rest) = self.data.split_first_chunk::<8>().ok_or_else(cut)?;
        let [low, high] = [self.word(&tag[..4]), self.word(&tag[4..])];
        // Up to four bytes stand inside the tag: their number in the upper half of the first word.
        if low >> 16 != 0 {
            let length = (low >> 16) as usize;
            let data = self.data.get(4..4 + length).filter(|_| length <= 4);
            self.data = rest;
            let data =
                data.ok_or_else(|| format!("a short element of {length} bytes in {what}; at most 4 fit"))?;
            return Ok(Element { kind: low & 0xffff, data });
        }
        let length = high as usize;
        let data = rest.get(..length).ok_or_else(cut)?;
        // Compressed elements are not padded, and the padding after the last one may be missing.
        let padded = if low == kind::COMPRESSED { length } else { length.next_multiple_of(8) };
        self.data = rest.get(padded..).unwrap_or_default();
        Ok(Element { kind: low, data })
    }

    /// The next element, which must be of this kind.
    pub(super) fn expect(&mut self, kind: u32, what: &str) -> Result<&'a [u8], String> {
        let element = self.next(what)?;
        if element.kind == kind {
            return Ok(element.data);
        }
        Err(format!("{what} has data of type {}; expected type {kind}", element.kind))
    }

    /// The numbers of an element, whatever their type; at most `limit`.
    pub(super) fn numbers(&self, element: Element<'a>, limit: usize) -> Result<Vec<f64>, String> {
        let width = match element.kind {
            kind::INT8 | kind::UINT8 | kind::UTF8 => 1,
            kind::INT16 | kind::UINT16 | kind::UTF16 => 2,
            kind::INT32 | kind::UINT32 | kind::SINGLE | kind::UTF32 => 4,
            kind::DOUBLE | kind::INT64 | kind::UINT64 => 8,
            other => return Err(format!("numbers of the unknown type {other}")),
        };
        if !element.data.len().is_multiple_of(width) {
            return Err(format!("{} bytes are no whole number of values of {width}", element.data.len()));
        }
        if element.data.len() / width > limit {
            return Err(format!("more than {} numbers in the file", super::array::NUMBERS_MAX));
        }
        Ok(element.data.chunks_exact(width).map(|bytes| self.number(element.kind, bytes)).collect())
    }

    fn number(&self, kind: u32, bytes: &[u8]) -> f64 {
        let mut all = [0; 8];
        let little = bytes.iter().copied();
        for (to, from) in all.iter_mut().zip(little) {
            *to = from;
        }
        if !self.little_endian {
            all.iter_mut().take(bytes.len()).for_each(|b| *b = 0);
            for (to, from) in all.iter_mut().zip(bytes.iter().rev()) {
                *to = *from;
            }
        }
        let raw = u64::from_le_bytes(all);
        match kind {
            kind::INT8 => f64::from(raw as u8 as i8),
            kind::INT16 => f64::from(raw as u16 as i16),
            kind::INT32 => f64::from(raw as u32 as i32),
            kind::INT64 => raw as i64 as f64,
            kind::SINGLE => f64::from(f32::from_bits(raw as u32)),
            kind::DOUBLE => f64::from_bits(raw),
            _ => raw as f64,
        }
    }

    fn word(&self, bytes: &[u8]) -> u32 {
        bytes.iter().enumerate().fold(0, |word, (index, byte)| {
            let order = if self.little_endian { index } else { 3 - index.min(3) };
            word | u32::from(*byte) << (8 * order)
        })
    }
}
