//! Lines and records of a text with separators, one after the other, without a copy of what needs none.
//!
//! A library's reader would take all cells of a record before any bound, and knows no quote behind a blank
//! (`1, "2"`), which exports write.

use std::borrow::Cow;

pub(super) const COLUMNS_MAX: usize = 1000;
/// Bytes of a quoted cell at most: a quote that is never closed would take all of the rest.
const QUOTED_MAX: usize = 64 << 10;

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
    /// [`COLUMNS_MAX`] and one more at most; a quote that is not closed is an error.
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
        if cells.len() <= COLUMNS_MAX {
            cells.push(cell);
        }
        match behind.strip_prefix(separator) {
            Some(next) => rest = next,
            None => return Ok((cells, text.len() - behind.len())),
        }
    }
}

/// What stands before the closing quote, doubled ones as one, and what stands behind it.
fn unquoted(inner: &str) -> Result<(Cow<'_, str>, &str), String> {
    let mut from = 0;
    let mut doubled = false;
    while let Some(at) = inner.get(from..).and_then(|rest| rest.find('"')).map(|at| from + at) {
        if at > QUOTED_MAX {
            break;
        }
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
