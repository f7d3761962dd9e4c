//! Lines and records of a text with separators, one after the other, without a copy of what needs none.
//!
//! A library's reader would take all cells of a record before any bound, and knows no quote behind a blank
//! (`1, "2"`), which exports write.

use std::borrow::Cow;

pub(super) const COLUMNS_MAX: usize = 1000;
/// Bytes of a quoted cell at most: a quote that is never closed would take all of the rest.
const QUOTED_MAX: usize = 64 << 10;
/// Bytes of a record with quotes at most.
const RECORD_MAX: usize = 1 << 20;

pub(super) type RowCells<'t> = Vec<Cow<'t, str>>;

/// A place in a text.
#[derive(Debug, Clone, Copy)]
pub(super) struct Walk<'t> {
    rest: &'t str,
    /// Of the next line, from 1.
    line: usize,
}

/// A record that is neither empty nor a comment.
pub(super) struct CsvRecord<'t> {
    /// Its first line, from 1.
    pub(super) line: usize,
    /// [`COLUMNS_MAX`] and one more at most; an error: a quote that is not closed, or too long a record.
    pub(super) cells: Result<RowCells<'t>, String>,
}

impl<'t> Walk<'t> {
    pub(super) fn new(text: &'t str) -> Self {
        Self { rest: text.trim_start_matches('\u{feff}'), line: 1 }
    }

    #[cfg(test)]
    pub(super) fn line(&self) -> usize {
        self.line
    }

    pub(super) fn is_at_end(&self) -> bool {
        self.rest.is_empty()
    }

    /// Number and text of the next line, which ends with a line feed, a carriage return, or both.
    pub(super) fn next_line(&mut self) -> Option<(usize, &'t str)> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.find(['\n', '\r']).unwrap_or(self.rest.len());
        let (text, behind) = self.rest.split_at(end);
        self.rest = behind.strip_prefix("\r\n").or(behind.strip_prefix(['\n', '\r'])).unwrap_or(behind);
        self.line += 1;
        Some((self.line - 1, text))
    }

    pub(super) fn next_record(&mut self, separator: char) -> Option<CsvRecord<'t>> {
        loop {
            let begin = self.rest;
            let (line, text) = self.next_line()?;
            let trimmed = text.trim();
            if trimmed.is_empty() || trimmed.starts_with('#') {
                continue;
            }
            if !text.contains('"') {
                let cells = text.split(separator).take(COLUMNS_MAX + 1).map(Cow::Borrowed).collect();
                return Some(CsvRecord { line, cells: Ok(cells) });
            }
            let cells = quoted(begin, separator).map(|(cells, length)| {
                // Lines within the quotes belong to the record.
                while begin.len() - self.rest.len() < length && self.next_line().is_some() {}
                cells
            });
            return Some(CsvRecord { line, cells });
        }
    }
}

/// The cells of the record that `text` begins with, and its length \[bytes\].
fn quoted(text: &str, separator: char) -> Result<(RowCells<'_>, usize), String> {
    let ends = [separator, '\n', '\r'];
    let mut cells: RowCells<'_> = Vec::new();
    let mut rest = text;
    loop {
        let (cell, behind) = match rest.trim_start_matches(' ').strip_prefix('"') {
            Some(inner) => {
                let (cell, behind) = unquoted(inner)?;
                // Whatever stands behind the closing quote is no part of the cell.
                (cell, behind.get(behind.find(ends).unwrap_or(behind.len())..).unwrap_or_default())
            }
            None => {
                let (cell, behind) = rest.split_at(rest.find(ends).unwrap_or(rest.len()));
                (Cow::Borrowed(cell), behind)
            }
        };
        cells.push(cell);
        let length = text.len() - behind.len();
        if cells.len() > COLUMNS_MAX || length > RECORD_MAX {
            return Err(format!("a record of more than {COLUMNS_MAX} fields or {RECORD_MAX} bytes"));
        }
        match behind.strip_prefix(separator) {
            Some(next) => rest = next,
            None => return Ok((cells, length)),
        }
    }
}

/// What stands before the closing quote, doubled ones as one, and what stands behind it.
fn unquoted(inner: &str) -> Result<(Cow<'_, str>, &str), String> {
    let mut from = 0;
    let mut doubled = false;
    let within = inner.as_bytes().get(..QUOTED_MAX).unwrap_or(inner.as_bytes());
    let next = |from: usize| Some(from + within.get(from..)?.iter().position(|byte| *byte == b'"')?);
    while let Some(at) = next(from) {
        let (cell, behind) = inner.split_at(at);
        let behind = behind.get(1..).unwrap_or_default();
        if !behind.starts_with('"') {
            let cell = if doubled { Cow::Owned(cell.replace("\"\"", "\"")) } else { Cow::Borrowed(cell) };
            return Ok((cell, behind));
        }
        (from, doubled) = (at + 2, true);
    }
    Err(format!("a cell has no closing quote within {QUOTED_MAX} bytes; double the quotes inside of quotes"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_takes_no_more_than_its_bounds() {
        fn cells(text: &str) -> Result<RowCells<'_>, String> {
            Walk::new(text).next_record(',').unwrap().cells
        }
        assert_eq!(cells(&",".repeat(1 << 20)).unwrap().len(), COLUMNS_MAX + 1);
        let long = "a".repeat(QUOTED_MAX - 1);
        assert_eq!(cells(&format!("\"{long}\",2")).unwrap(), [&long, "2"]);
        for (text, wanted) in [
            (format!("\"{long}a\",2"), "no closing quote"),
            ("1,\"open".to_owned(), "no closing quote"),
            ("\"\",".repeat(1 << 20), "more than 1000 fields"),
            (format!("\"{long}\",").repeat(20), "or 1048576 bytes"),
        ] {
            let why = cells(&text).unwrap_err();
            assert!(why.contains(wanted), "{why}");
        }
    }
}
