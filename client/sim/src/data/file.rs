//! A file as bytes, and what is wrong with it: shared by the loaders.

use foretrace_config::files::read_regular;
use std::fmt;
use std::path::{Path, PathBuf};

const FILE_BYTES_MAX: u64 = 128 << 20;
/// Longest reason \[characters\].
const REASON_MAX: usize = 400;

/// A file that could not be read as a recording: what is wrong, and where.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}{}: {reason}", file.display(), LineSuffix(*line))]
pub struct FileError {
    /// May be one that the recording includes.
    pub file: PathBuf,
    /// Line from 1; 0 when it concerns the file as a whole.
    pub line: usize,
    /// What is wrong and what would be right.
    pub reason: String,
}

impl FileError {
    pub(crate) fn whole(file: &Path, reason: impl Into<String>) -> Self {
        Self::at(file, 0, &reason.into())
    }

    /// The reason may quote the file, and is shortened.
    pub(crate) fn at(file: &Path, line: usize, reason: &str) -> Self {
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

pub(super) fn unreadable(path: &Path, why: impl fmt::Display) -> FileError {
    FileError::whole(path, format!("cannot read the file: {why}"))
}

/// Opens a regular file: a pipe or device could keep a reader for ever.
pub(super) fn open(path: &Path) -> Result<std::fs::File, FileError> {
    if !std::fs::metadata(path).map_err(|e| unreadable(path, e))?.is_file() {
        return Err(unreadable(path, "not a regular file"));
    }
    std::fs::File::open(path).map_err(|e| unreadable(path, e))
}

/// The whole of a regular file that is not too large.
pub(super) fn read_limited(path: &Path) -> Result<Vec<u8>, FileError> {
    read_regular(path, FILE_BYTES_MAX).map_err(|e| unreadable(path, e))
}
