//! The formats of recordings: recognised by contents, loaded into one form.

use super::csv::{begins_csv, has_csv_header, parse_csv_recording};
use super::file::{FileError, open, read_limited, unreadable};
use super::hint::what_it_is;
use super::mcap_pen::{begins_mcap, load_mcap, read_mcap};
use super::{CsvUnits, Recording, decoded};
#[cfg(feature = "formats")]
use crate::formats::{parse_inkml, parse_mat, parse_unipen};
use std::fmt;
use std::io::{Cursor, Read as _};
use std::path::Path;

/// Bytes of a file that decide its format.
const SNIFFED_BYTES: usize = 64 << 10;

/// A format of recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Format {
    /// UNIPEN 1.0 text, the pendigits dialect included.
    Unipen,
    /// MATLAB v5 with UCI Character Trajectories.
    Mat,
    /// W3C InkML.
    InkMl,
    /// CSV with columns of time, x and y, foretrace's own recordings included.
    Csv,
    /// MCAP: foretrace's own recordings of everything.
    Mcap,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unipen => "UNIPEN",
            Self::Mat => "MATLAB v5",
            Self::InkMl => "InkML",
            Self::Csv => "CSV",
            Self::Mcap => "MCAP",
        })
    }
}

/// Loads a recording of any known format; contents decide which, names only where contents do not tell.
///
/// # Errors
/// [`FileError`] with file, line and reason; a file of no known format is refused with the formats there are.
pub fn load_recording(path: &Path) -> Result<Recording, FileError> {
    load_recording_in(path, CsvUnits::default())
}

/// As [`load_recording`], with units for columns whose names have none.
///
/// # Errors
/// As [`load_recording`].
pub fn load_recording_in(path: &Path, units: CsvUnits) -> Result<Recording, FileError> {
    match Format::of_file(path)? {
        Some(Format::Mcap) => Format::Mcap.load(path, units),
        _ => parse_in(&read_limited(path)?, path, units),
    }
}

/// Reads a recording from the bytes of a file; `path` stands in messages, and UNIPEN looks for includes
/// around it.
///
/// # Errors
/// As [`load_recording`].
pub fn parse_recording(bytes: &[u8], path: &Path) -> Result<Recording, FileError> {
    parse_in(bytes, path, CsvUnits::default())
}

fn parse_in(bytes: &[u8], path: &Path, units: CsvUnits) -> Result<Recording, FileError> {
    let head = bytes.get(..SNIFFED_BYTES).unwrap_or(bytes);
    match Format::of_contents(head).or_else(|| Format::of_name(path)) {
        Some(format) => format.parse(bytes, path, units),
        None => {
            let what = what_it_is(head).map_or_else(
                || "not a recording in a known format".to_owned(),
                |what| format!("not a recording: {what}"),
            );
            Err(FileError::whole(path, format!("{what}; legal: {}", Format::ALL_NAMES)))
        }
    }
}

impl Format {
    pub(super) const ALL_NAMES: &str = "UNIPEN text, InkML, MATLAB v5 (UCI Character Trajectories), CSV with \
                                        columns of time, x and y, or MCAP of foretrace record";

    /// The part that a file's name tells in sets that are published without a table.
    pub(super) fn natural_split(self, file: &str) -> Option<&'static str> {
        let path = Path::new(file);
        let [extension, stem] =
            [path.extension(), path.file_stem()].map(|s| s.and_then(|s| s.to_str()).unwrap_or_default());
        match (self, extension) {
            (Self::Unipen, "tra") => Some("train"),
            (Self::Unipen, "tes") => Some("test"),
            (Self::Mat, _) if stem.ends_with("train") => Some("train"),
            (Self::Mat, _) if stem.ends_with("test") => Some("test"),
            _ => None,
        }
    }

    /// Loads `path` as this format.
    pub(super) fn load(self, path: &Path, units: CsvUnits) -> Result<Recording, FileError> {
        match self {
            // Far larger than its pen.
            Self::Mcap => load_mcap(path),
            _ => self.parse(&read_limited(path)?, path, units),
        }
    }

    fn parse(self, bytes: &[u8], path: &Path, units: CsvUnits) -> Result<Recording, FileError> {
        // Only its name tells this format: it may be something else that is known.
        let head = bytes.get(..SNIFFED_BYTES).unwrap_or(bytes);
        let is_known =
            Self::of_contents(head).is_some() || (self == Self::Csv && has_csv_header(&decoded(head)));
        if !is_known && let Some(what) = what_it_is(head) {
            return Err(FileError::whole(path, format!("not {self}: {what}")));
        }
        match self {
            #[cfg(feature = "formats")]
            Self::Unipen => parse_unipen(bytes, path),
            #[cfg(feature = "formats")]
            Self::Mat => parse_mat(bytes, path),
            #[cfg(feature = "formats")]
            Self::InkMl => parse_inkml(bytes, path),
            #[cfg(not(feature = "formats"))]
            Self::Unipen | Self::Mat | Self::InkMl => Err(FileError::whole(
                path,
                format!(
                    "the reader of {self} is left out of this build; build foretrace with its feature \
                     `formats` (or `lab`, which includes it)"
                ),
            )),
            Self::Csv => parse_csv_recording(bytes, path, units),
            Self::Mcap => read_mcap(Cursor::new(bytes), bytes.len() as u64, path),
        }
    }

    /// The format by a file's first bytes; `None` when it is not a recording. Errors where the file cannot be
    /// read.
    pub(super) fn of_file(path: &Path) -> Result<Option<Self>, FileError> {
        Ok(Self::of_contents(&head_of(path)?))
    }

    fn of_contents(head: &[u8]) -> Option<Self> {
        if begins_mat(head) {
            return Some(Self::Mat);
        }
        if begins_mcap(head) {
            return Some(Self::Mcap);
        }
        if begins_inkml(head) {
            return Some(Self::InkMl);
        }
        let text = decoded(head);
        if begins_csv(&text) {
            return Some(Self::Csv);
        }
        const INK: [&str; 4] = [".SEGMENT", ".PEN_DOWN", ".INCLUDE", ".HIERARCHY"];
        text.lines()
            .any(|line| {
                INK.iter().any(|k| line.split_whitespace().next() == Some(k) && line.starts_with('.'))
            })
            .then_some(Self::Unipen)
    }

    /// What the file's name suggests.
    pub(super) fn of_name(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "dat" | "tra" | "tes" | "upn" => Some(Self::Unipen),
            "mat" => Some(Self::Mat),
            "inkml" => Some(Self::InkMl),
            "csv" | "tsv" => Some(Self::Csv),
            "mcap" => Some(Self::Mcap),
            _ => None,
        }
    }
}

/// The bytes of a file that decide its format.
pub(super) fn head_of(path: &Path) -> Result<Vec<u8>, FileError> {
    let file = open(path)?;
    let mut head = Vec::new();
    file.take(SNIFFED_BYTES as u64).read_to_end(&mut head).map_err(|e| unreadable(path, e))?;
    Ok(head)
}

/// Whether a file begins as MATLAB's do, readable version or not.
fn begins_mat(head: &[u8]) -> bool {
    /// Bytes before the first variable.
    const HEADER_BYTES: usize = 128;
    head.starts_with(b"MATLAB ") && head.len() >= HEADER_BYTES
}

/// Whether a file begins as an InkML document.
fn begins_inkml(head: &[u8]) -> bool {
    /// Characters of the name of an element at most.
    const LONGEST_NAME: usize = 80;
    let text = decoded(head);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    let is_root = |(at, _): (usize, &str)| {
        // A name without an end would be looked for in all of the rest, from every bracket on.
        let rest = text.get(at + 1..).unwrap_or_default();
        let rest = rest.char_indices().nth(LONGEST_NAME).and_then(|(end, _)| rest.get(..end)).unwrap_or(rest);
        let name = rest.split(|c: char| c.is_whitespace() || c == '>' || c == '/').next().unwrap_or_default();
        name == "ink" || name.ends_with(":ink")
    };
    text.starts_with('<') && text.match_indices('<').any(is_root)
}

#[cfg(all(test, not(feature = "formats")))]
mod tests {
    use super::*;

    #[test]
    fn a_format_that_is_left_out_is_named_with_what_brings_it() {
        let mat = [b"MATLAB 5.0 MAT-file".as_slice(), &[b' '; 128]].concat();
        for (bytes, name) in [
            (b"<ink><trace>1 2,3 4</trace></ink>".as_slice(), "InkML"),
            (b".COORD X Y\n.PEN_DOWN\n1 2\n", "UNIPEN"),
            (&mat, "MATLAB v5"),
        ] {
            let error = parse_recording(bytes, Path::new("a.ink")).unwrap_err().to_string();
            assert!(error.starts_with(&format!("a.ink: the reader of {name} is left out")), "{error}");
            assert!(error.contains("`formats`"), "{error}");
        }
    }
}
