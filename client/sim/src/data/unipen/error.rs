//! Errors of a UNIPEN file, with file, line and reason.

use std::fmt;
use std::path::{Path, PathBuf};

/// A UNIPEN file that could not be read as a recording.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{}{}: {reason}", file.display(), LineSuffix(*line))]
pub struct UnipenError {
    /// The file with the error; may be an included one.
    pub file: PathBuf,
    /// Line from 1; 0 when it concerns the file as a whole.
    pub line: usize,
    /// What is wrong and what would be right.
    pub reason: Reason,
}

/// Why a UNIPEN file was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Reason {
    /// The operating system refused.
    #[error("cannot read the file: {0}")]
    Unreadable(String),
    /// Larger than this reader accepts.
    #[error("the file has {bytes} bytes; at most {limit} are read")]
    TooLarge {
        /// Size found.
        bytes: u64,
        /// Largest size read.
        limit: u64,
    },
    /// `.INCLUDE` of a file that is nowhere to be found.
    #[error(
        "included file {wanted:?} was not found below any include/ folder beside or above this file; \
             keep the set's data/ and include/ folders together"
    )]
    MissingInclude {
        /// As written, shortened.
        wanted: String,
    },
    /// `.INCLUDE` of an absolute path or one with `..`.
    #[error("include {wanted:?} leads out of the include folder; only paths below it are read")]
    EscapingInclude {
        /// As written, shortened.
        wanted: String,
    },
    /// A file that includes itself, directly or through others.
    #[error("include {wanted:?} is cyclic: that file is being read already")]
    CyclicInclude {
        /// As written, shortened.
        wanted: String,
    },
    /// More includes than real files have.
    #[error("more than {files} includes, or nested deeper than {depth}")]
    TooManyIncludes {
        /// Most files read.
        files: usize,
        /// Deepest nesting read.
        depth: usize,
    },
    /// A token that is not a number where one must stand.
    #[error("{token:?} is not a number")]
    NotANumber {
        /// As written, shortened. shortened.
        token: String,
    },
    /// A number outside its legal range.
    #[error("{what} {value} is outside [{low}, {high}]")]
    Illegal {
        /// Which quantity.
        what: &'static str,
        /// As read.
        value: f64,
        /// Smallest legal value.
        low: f64,
        /// Largest legal value.
        high: f64,
    },
    /// Points before any `.COORD`.
    #[error("points before .COORD: the order of the columns is unknown")]
    NoCoord,
    /// `.COORD` that names no X or no Y.
    #[error(".COORD must name X and Y, found {found:?}")]
    CoordWithoutXy {
        /// As written, shortened.
        found: String,
    },
    /// A row of points that ends early.
    #[error("a point has {wanted} numbers (.COORD), the line ends after {found}")]
    ShortRow {
        /// Columns of `.COORD`.
        wanted: usize,
        /// Numbers found.
        found: usize,
    },
    /// Numbers after `.DT` without a pen state.
    #[error("points before any .PEN_DOWN or .PEN_UP")]
    PointsWithoutPen,
    /// No `.POINTS_PER_SECOND` anywhere.
    #[error("no .POINTS_PER_SECOND: the time between points is unknown")]
    NoRate,
    /// No ink at all.
    #[error("no points: neither the file nor its includes have ink")]
    NoPoints,
    /// No `.SEGMENT CHARACTER`.
    #[error("no .SEGMENT CHARACTER line, so nothing says where a character starts and ends")]
    NoCharacters,
    /// A `.SEGMENT` line that does not follow the grammar.
    #[error("malformed segment: {why} (expected: .SEGMENT CHARACTER a-b[:j],... quality \"label\")")]
    Segment {
        /// What does not fit.
        why: String,
    },
    /// A delimiter that names a component or point that is not there.
    #[error("segment out of range: {what} {index} of {count} (counted from 0)")]
    OutOfRange {
        /// `component` or `point`.
        what: &'static str,
        /// Index asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// Segments that repeat the same ink until memory runs out.
    #[error("the segments together have more than {limit} points")]
    TooManyPoints {
        /// Most points kept.
        limit: usize,
    },
}

struct LineSuffix(usize);

impl fmt::Display for LineSuffix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 0 { Ok(()) } else { write!(f, ":{}", self.0) }
    }
}

/// A place in a file, from which errors are made.
#[derive(Debug, Clone)]
pub(super) struct At {
    file: PathBuf,
    line: usize,
}

impl At {
    pub(super) fn new(file: &Path, line: usize) -> Self {
        Self { file: file.to_path_buf(), line }
    }

    pub(super) fn line(&self, line: usize) -> Self {
        Self { file: self.file.clone(), line }
    }

    pub(super) fn fails(&self, reason: Reason) -> UnipenError {
        UnipenError { file: self.file.clone(), line: self.line, reason }
    }
}
