//! A file as bytes, and its refusal: shared by the loaders.

use foretrace_config::files::read_regular;
use std::fmt;
use std::path::{Path, PathBuf};

const FILE_BYTES_MAX: u64 = 128 << 20;
/// Longest reason \[characters\].
const REASON_MAX: usize = 400;

/// What is wrong with a file, and where.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}{}: {reason}", file.display(), LineSuffix(*line))]
pub struct Refusal {
    /// The file.
    pub file: PathBuf,
    /// Line from 1; 0 when it concerns the file as a whole.
    pub line: usize,
    /// What is wrong and what would be right.
    pub reason: String,
}

impl Refusal {
    /// A refusal of `file` as a whole.
    pub(super) fn whole(file: &Path, reason: impl Into<String>) -> Self {
        Self::at(file, 0, &reason.into())
    }

    /// A refusal of a line. The reason may quote the file, and is shortened.
    pub(super) fn at(file: &Path, line: usize, reason: &str) -> Self {
        Self { file: file.to_path_buf(), line, reason: super::shortened(reason, REASON_MAX) }
    }
}

/// `:line`, or nothing for line 0.
struct LineSuffix(usize);

impl fmt::Display for LineSuffix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 0 { Ok(()) } else { write!(f, ":{}", self.0) }
    }
}

pub(super) fn unreadable(path: &Path, why: impl fmt::Display) -> Refusal {
    Refusal::whole(path, format!("cannot read the file: {why}"))
}

/// Opens a regular file: a pipe or device could keep a reader for ever.
pub(super) fn open(path: &Path) -> Result<std::fs::File, Refusal> {
    if !std::fs::metadata(path).map_err(|e| unreadable(path, e))?.is_file() {
        return Err(unreadable(path, "not a regular file"));
    }
    std::fs::File::open(path).map_err(|e| unreadable(path, e))
}

/// The whole of a regular file that is not too large.
pub(super) fn read_limited(path: &Path) -> Result<Vec<u8>, Refusal> {
    read_regular(path, FILE_BYTES_MAX).map_err(|e| unreadable(path, e))
}
