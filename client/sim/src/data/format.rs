//! The formats of recordings: recognised by contents, loaded into one form.

use super::csv::{begins_csv, parse_csv_recording};
use super::file::{Refusal, open, read_limited, unreadable};
use super::inkml::{begins_inkml, parse_inkml};
use super::mat::{begins_mat, parse_mat};
use super::mcap_pen::{begins_mcap, load_mcap, read_mcap};
use super::unipen::parse_unipen;
use super::{CsvError, Recording, UnipenError};
use std::fmt;
use std::io::Read as _;
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
    /// Plain CSV with `t_s,x_m,y_m,contact`, foretrace's own recordings included.
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

/// A file that could not be read as a recording.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// As UNIPEN.
    #[error(transparent)]
    Unipen(#[from] UnipenError),
    /// As CSV.
    #[error(transparent)]
    Csv(#[from] CsvError),
    /// As any other format, or as none.
    #[error(transparent)]
    Refused(#[from] Refusal),
}

/// Loads a recording of any known format; contents decide which, names only where contents do not tell.
///
/// # Errors
/// [`FileError`] with file, line and reason; a file of no known format is refused with the formats there are.
pub fn load_recording(path: &Path) -> Result<Recording, FileError> {
    match Format::of_file(path)? {
        Some(Format::Mcap) => Format::Mcap.load(path),
        _ => parse_recording(&read_limited(path)?, path),
    }
}

/// Reads a recording from the bytes of a file; `path` stands in messages, and UNIPEN looks for includes
/// around it.
///
/// # Errors
/// As [`load_recording`].
pub fn parse_recording(bytes: &[u8], path: &Path) -> Result<Recording, FileError> {
    let head = bytes.get(..SNIFFED_BYTES).unwrap_or(bytes);
    match Format::of_contents(head).or_else(|| Format::of_name(path)) {
        Some(format) => format.parse(bytes, path),
        None => {
            let why = format!("not a recording in a known format; legal: {}", Format::ALL_NAMES);
            Err(Refusal::whole(path, why).into())
        }
    }
}

impl Format {
    /// For messages.
    pub(super) const ALL_NAMES: &str = "UNIPEN text, InkML, MATLAB v5 (UCI Character Trajectories), CSV with \
                                        the columns t_s,x_m,y_m,contact, or MCAP of foretrace record";

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
    pub(super) fn load(self, path: &Path) -> Result<Recording, FileError> {
        match self {
            // Far larger than its pen.
            Self::Mcap => Ok(load_mcap(path)?),
            _ => self.parse(&read_limited(path)?, path),
        }
    }

    fn parse(self, bytes: &[u8], path: &Path) -> Result<Recording, FileError> {
        match self {
            Self::Unipen => Ok(parse_unipen(bytes, path)?),
            Self::Mat => Ok(parse_mat(bytes, path)?),
            Self::InkMl => Ok(parse_inkml(bytes, path)?),
            Self::Csv => Ok(parse_csv_recording(bytes, path)?),
            Self::Mcap => Ok(read_mcap(bytes, path)?),
        }
    }

    /// The format by a file's first bytes; `None` when it is no recording. Errors where the file cannot be
    /// read.
    pub(super) fn of_file(path: &Path) -> Result<Option<Self>, Refusal> {
        let file = open(path)?;
        let mut head = Vec::new();
        file.take(SNIFFED_BYTES as u64).read_to_end(&mut head).map_err(|e| unreadable(path, e))?;
        Ok(Self::of_contents(&head))
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
        let text = String::from_utf8_lossy(head);
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
            "csv" => Some(Self::Csv),
            "mcap" => Some(Self::Mcap),
            _ => None,
        }
    }
}
