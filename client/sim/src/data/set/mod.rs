//! A set: a folder of recordings in one format, and the parts it is split into.
//!
//! `split.tsv` beside the files names a part per file. Without it, published sets have the parts that their
//! file names tell, and every other folder is one part.

mod folder;
mod table;

use super::{Character, CsvUnits, FileError, Format, Recording, Split};
use std::path::{Path, PathBuf};

/// The recordings of one part of a set, and what could not be read.
#[derive(Debug, Clone)]
pub struct DataSet {
    /// Name of the folder.
    pub name: String,
    /// One per readable file, in the order of `split.tsv`, or by name without one.
    pub files: Vec<SetFile>,
    /// One per unreadable file; empty after a strict load.
    pub errors: Vec<FileError>,
    /// One per file of which only a beginning could be read, which is among `files`; empty after a strict
    /// load.
    pub damaged: Vec<FileError>,
}

/// A recording of a set.
#[derive(Debug, Clone)]
pub struct SetFile {
    /// Path relative to the set's folder, as written in `split.tsv`.
    pub file: String,
    /// Its part, where the table or its name says one; of a file of several parts the first.
    pub word: Option<String>,
    pub recording: Recording,
}

/// A set that could not be loaded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SetError {
    /// The folder or its `split.tsv` cannot be read.
    #[error("{}: {why}", path.display())]
    Unreadable { path: PathBuf, why: String },
    /// A row or header of `split.tsv` that does not fit.
    #[error("{}:{line}: {why}", file.display())]
    Row {
        file: PathBuf,
        /// Line from 1.
        line: usize,
        /// What does not fit and what would.
        why: String,
    },
    /// No file of a known format.
    #[error("{}: no recording in this folder; a set is a folder of {}{found}", folder.display(), Format::ALL_NAMES)]
    NoFormat {
        folder: PathBuf,
        /// What there is instead, or nothing.
        found: String,
    },
    /// Files of more than one format and no table that says which belong.
    #[error(
        "{}: more than one format in one folder ({found}); keep one format per folder, or name the files in \
         a split.tsv with the columns set and file", folder.display()
    )]
    Ambiguous {
        folder: PathBuf,
        /// The formats, each with a file of it.
        found: String,
    },
    /// A part that the set does not have.
    #[error("{}: no split {wanted:?}; it has: {}", folder.display(), words.join(", "))]
    NoSuchSplit {
        folder: PathBuf,
        wanted: String,
        /// What there is, `all` included; of many and long ones as much as a message holds.
        words: Vec<String>,
    },
    /// A strict load met a bad file.
    #[error(transparent)]
    File(#[from] FileError),
    /// Nothing readable is left.
    #[error("{}: no readable file in this split ({bad} \
             refused{})", folder.display(), first_suffix(first.as_deref()))]
    Empty {
        folder: PathBuf,
        /// How many files were refused.
        bad: usize,
        first: Option<Box<FileError>>,
    },
}

fn first_suffix(first: Option<&FileError>) -> String {
    first.map(|e| format!("; first: {e}")).unwrap_or_default()
}

/// A file of a set before it is loaded.
#[derive(Debug, Clone, PartialEq, Eq)]
struct ListedFile {
    /// Relative to the folder.
    file: String,
    /// The part it belongs to, where the table or its name says one.
    word: Option<String>,
    /// From the table, else empty.
    writer: String,
    /// Known from the folder as a whole; `None`: to be found out from the file.
    format: Option<Format>,
}

impl DataSet {
    /// Loads one part of the set in `folder`.
    ///
    /// Not strict: bad files are listed in `errors` and left out. Strict: the first bad file is the error.
    ///
    /// # Errors
    /// [`SetError`]: the folder or its table is missing or malformed, its format is unknown or ambiguous, it
    /// has no such part, no file of it is readable, or (strict) any file is bad.
    pub fn load(folder: &Path, split: &Split, strict: bool) -> Result<Self, SetError> {
        Self::load_in(folder, split, strict, CsvUnits::default())
    }

    /// As [`DataSet::load`], with units for columns whose names have none.
    ///
    /// # Errors
    /// As [`DataSet::load`].
    pub fn load_in(folder: &Path, split: &Split, strict: bool, units: CsvUnits) -> Result<Self, SetError> {
        let rows = rows(folder)?;
        if let Split::Named(wanted) = split
            && !rows.iter().any(|row| split.takes(row.word.as_deref()))
        {
            let (folder, wanted) = (folder.to_path_buf(), wanted.clone());
            return Err(SetError::NoSuchSplit { folder, wanted, words: shown(words(&rows)) });
        }
        let mut set = Self { name: name(folder), files: Vec::new(), errors: Vec::new(), damaged: Vec::new() };
        let mut seen = std::collections::HashSet::new();
        for row in rows.into_iter().filter(|row| split.takes(row.word.as_deref())) {
            // A file may stand in several parts; of all together it is one.
            if !seen.insert(row.file.clone()) {
                continue;
            }
            match row.load(folder, units) {
                Ok(file) => {
                    let damage = file.recording.damage.as_ref();
                    let damage = damage.map(|damage| FileError::whole(&file.recording.source, damage));
                    match damage {
                        Some(error) if strict => return Err(error.into()),
                        damage => set.damaged.extend(damage),
                    }
                    set.files.push(file);
                }
                Err(error) if strict => return Err(error.into()),
                Err(error) => set.errors.push(error),
            }
        }
        if set.files.is_empty() {
            let (bad, first) = (set.errors.len(), set.errors.first().cloned().map(Box::new));
            return Err(SetError::Empty { folder: folder.to_path_buf(), bad, first });
        }
        Ok(set)
    }

    /// The words that [`DataSet::load`] takes for this folder: its parts in order of appearance, then `all`.
    ///
    /// # Errors
    /// [`SetError`]: the folder or its table is missing or malformed, or its format unknown or ambiguous.
    pub fn splits(folder: &Path) -> Result<Vec<String>, SetError> {
        Ok(words(&rows(folder)?))
    }

    /// What of the files was not taken as it stands: a line per damaged file, then one per kind.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        Self::remarks_of([self])
    }

    /// The same of several parts of a set together.
    #[must_use]
    pub fn remarks_of<'a>(parts: impl IntoIterator<Item = &'a Self>) -> Vec<String> {
        let parts: Vec<&Self> = parts.into_iter().collect();
        let damaged = parts.iter().flat_map(|set| &set.damaged).map(ToString::to_string);
        let files = parts.iter().flat_map(|set| &set.files);
        let kinds = super::remarks(files.map(|file| (file.file.as_str(), &file.recording.remarks[..])));
        damaged.chain(kinds).collect()
    }

    /// All characters of the loaded files, in order.
    pub fn characters(&self) -> impl Iterator<Item = &Character> {
        self.files.iter().flat_map(|f| &f.recording.segments)
    }
}

/// The folder's own name, also where it is given as `.`.
fn name(folder: &Path) -> String {
    let named = folder.file_name().map(|n| n.to_string_lossy().into_owned());
    named
        .or_else(|| Some(folder.canonicalize().ok()?.file_name()?.to_string_lossy().into_owned()))
        .unwrap_or_default()
}

fn rows(folder: &Path) -> Result<Vec<ListedFile>, SetError> {
    let table = folder.join("split.tsv");
    if table.symlink_metadata().is_ok() { table::read(&table) } else { folder::find(folder) }
}

fn words(rows: &[ListedFile]) -> Vec<String> {
    let mut seen = std::collections::HashSet::new();
    let all = rows.iter().filter_map(|row| row.word.as_deref()).filter(|word| *word != "all");
    let words = all.filter(|word| seen.insert(*word)).chain(["all"]);
    words.map(str::to_owned).collect()
}

/// As much of the words of [`words`] as a message holds.
fn shown(mut words: Vec<String>) -> Vec<String> {
    /// Words, and characters of each.
    const MOST: (usize, usize) = (20, 40);
    if words.len() > MOST.0 + 1 {
        words.splice(MOST.0..words.len() - 1, ["…".to_owned()]);
    }
    words.iter().map(|word| word.chars().take(MOST.1).collect()).collect()
}

impl ListedFile {
    fn load(self, folder: &Path, units: CsvUnits) -> Result<SetFile, FileError> {
        let path = folder.join(&self.file);
        let mut recording = match self.format {
            Some(format) => format.load(&path, units)?,
            None => super::load_recording_in(&path, units)?,
        };
        if !self.writer.is_empty() {
            for character in &mut recording.segments {
                character.writer.clone_from(&self.writer);
            }
        }
        Ok(SetFile { file: self.file, word: self.word, recording })
    }
}
