//! A data-set folder: `split.tsv`, `data/`, `include/`.
//!
//! `split.tsv` is tab-separated with a header that names at least the columns `set` and `file`
//! (optional `writer`); `file` is relative to the folder.

use super::{Character, Recording, UnipenError, load_unipen};
use std::path::{Path, PathBuf};

/// Which part of a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Split {
    /// Writers to fit and tune on.
    Train,
    /// Writers held out.
    Test,
    /// Both.
    All,
}

/// The recordings of one split, and what could not be read.
#[derive(Debug, Clone)]
pub struct DataSet {
    /// Name of the folder.
    pub name: String,
    /// One per readable file, in the order of `split.tsv`.
    pub files: Vec<SetFile>,
    /// One per unreadable file; empty after a strict load.
    pub errors: Vec<UnipenError>,
}

/// A recording with its row of `split.tsv`.
#[derive(Debug, Clone)]
pub struct SetFile {
    /// Path relative to the set's folder, as written in `split.tsv`.
    pub file: String,
    /// Writer, empty where the table has none.
    pub writer: String,
    /// The ink.
    pub recording: Recording,
}

/// A set that could not be loaded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SetError {
    /// `split.tsv` is missing or unreadable.
    #[error("{}: cannot read the split table: {why}; a set folder has split.tsv, data/ and include/", file.display())]
    Table {
        /// The table.
        file: PathBuf,
        /// The system's reason.
        why: String,
    },
    /// A row or header that does not fit.
    #[error("{}:{line}: {why}", file.display())]
    Row {
        /// The table.
        file: PathBuf,
        /// Line from 1.
        line: usize,
        /// What does not fit and what would.
        why: String,
    },
    /// A strict load met a bad file.
    #[error(transparent)]
    File(#[from] UnipenError),
    /// Nothing readable is left.
    #[error("{}: no readable file in this split ({bad} refused{})", folder.display(), first_suffix(first.as_ref()))]
    Empty {
        /// The set.
        folder: PathBuf,
        /// How many files were refused.
        bad: usize,
        /// The first refusal.
        first: Option<UnipenError>,
    },
}

fn first_suffix(first: Option<&UnipenError>) -> String {
    first.map(|e| format!("; first: {e}")).unwrap_or_default()
}

impl DataSet {
    /// Loads one split of the set in `folder`.
    ///
    /// Not strict: bad files are listed in `errors` and left out. Strict: the first bad file is the error.
    ///
    /// # Errors
    /// [`SetError`]: the table is missing or malformed, no file is readable, or (strict) any file is bad.
    pub fn load(folder: &Path, split: Split, strict: bool) -> Result<Self, SetError> {
        let name = folder.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let mut set = Self { name, files: Vec::new(), errors: Vec::new() };
        for row in read_table(&folder.join("split.tsv"))? {
            if split != Split::All && row.split != split {
                continue;
            }
            match load_unipen(&folder.join(&row.file)) {
                Ok(recording) => set.files.push(SetFile { file: row.file, writer: row.writer, recording }),
                Err(error) if strict => return Err(error.into()),
                Err(error) => set.errors.push(error),
            }
        }
        if set.files.is_empty() {
            let (bad, first) = (set.errors.len(), set.errors.first().cloned());
            return Err(SetError::Empty { folder: folder.to_path_buf(), bad, first });
        }
        Ok(set)
    }

    /// All characters of the loaded files, in order.
    pub fn characters(&self) -> impl Iterator<Item = &Character> {
        self.files.iter().flat_map(|f| &f.recording.segments)
    }
}

struct Row {
    split: Split,
    writer: String,
    file: String,
}

fn read_table(path: &Path) -> Result<Vec<Row>, SetError> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| SetError::Table { file: path.to_path_buf(), why: e.to_string() })?;
    let bad = |line: usize, why: String| SetError::Row { file: path.to_path_buf(), line, why };
    let mut lines = text.lines().enumerate().map(|(i, l)| (i + 1, l));
    let header: Vec<&str> = lines.next().map(|(_, l)| l.split('\t').collect()).unwrap_or_default();
    let column = |name: &str| header.iter().position(|h| *h == name);
    let (Some(set), Some(file)) = (column("set"), column("file")) else {
        return Err(bad(1, format!("the header must name the columns set and file, found {header:?}")));
    };
    let mut rows = Vec::new();
    for (line, text) in lines.filter(|(_, l)| !l.trim().is_empty()) {
        let cells: Vec<&str> = text.split('\t').collect();
        let cell = |i: usize| cells.get(i).copied().unwrap_or_default();
        let split = match cell(set) {
            "train" => Split::Train,
            "test" => Split::Test,
            other => return Err(bad(line, format!("set is {other:?}; legal: train, test"))),
        };
        let relative = Path::new(cell(file));
        if cell(file).is_empty()
            || !relative.components().all(|p| matches!(p, std::path::Component::Normal(_)))
        {
            return Err(bad(line, format!("file {:?} is not a path below the set's folder", cell(file))));
        }
        let writer = column("writer").map(cell).unwrap_or_default().to_owned();
        rows.push(Row { split, writer, file: cell(file).to_owned() });
    }
    Ok(rows)
}
