//! Files read whole, if they are regular ones of a bounded size; and sets of files that are read once only.
//!
//! Contract: settings may come from a recording of somebody else, so that no path makes a program wait or
//! fill its memory: devices and pipes are refused before they are opened, large files before they are read.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Error, ErrorKind, Read as _, Result};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::encoding::xml_text;

/// Longest settings file \[bytes\]: fifty times the longest preset.
pub const LONGEST_SETTINGS: u64 = 1 << 20;

/// The bytes of the regular file `path`, which has at most `most`.
///
/// # Errors
///
/// It cannot be read, is not a regular file, or is longer: before a byte is read where its size says so, and
/// after `most` bytes where it has none (`/proc`) or grows.
pub fn read_regular(path: &Path, most: u64) -> Result<Vec<u8>> {
    let long = |bytes: &dyn std::fmt::Display| {
        Error::new(ErrorKind::InvalidData, format!("it has {bytes} bytes, {most} are the most that are read"))
    };
    // A pipe without a writer blocks whoever opens it.
    let about = std::fs::metadata(path)?;
    if !about.is_file() {
        let what = if about.is_dir() { "a directory, not a regular file" } else { "not a regular file" };
        return Err(Error::new(ErrorKind::InvalidInput, what));
    }
    if about.len() > most {
        return Err(long(&about.len()));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(long(&format_args!("more than {most}")));
    }
    Ok(bytes)
}

/// As [`read_regular`], as UTF-8.
///
/// # Errors
///
/// As [`read_regular`], or it is not UTF-8.
pub fn read_text(path: &Path, most: u64) -> Result<String> {
    text(read_regular(path, most)?)
}

/// As [`read_regular`], of an XML file: UTF-8, or UTF-16 or ISO-8859-1 where it says so.
///
/// # Errors
///
/// As [`read_regular`], or it is in another encoding.
pub fn read_xml(path: &Path, most: u64) -> Result<String> {
    xml_text(read_regular(path, most)?)
}

fn text(bytes: Vec<u8>) -> Result<String> {
    String::from_utf8(bytes)
        .map_err(|error| Error::new(ErrorKind::InvalidData, error.utf8_error().to_string()))
}

/// A path for a message, in about `most` characters: what is left out is at its front, and never of the name
/// at its end, which has 255 at most where it is one.
#[must_use]
pub fn shortened_path(path: &str, most: usize) -> String {
    const LONGEST_NAME: usize = 255;
    let all = path.chars().count();
    if all <= most {
        return path.to_owned();
    }
    let name = path.trim_end_matches('/').rsplit('/').next().unwrap_or(path);
    let kept = most.saturating_sub(1).max(name.chars().count().min(LONGEST_NAME));
    format!("…{}", path.chars().skip(all.saturating_sub(kept)).collect::<String>())
}

/// Bytes by the path that names them.
pub type Taken = BTreeMap<PathBuf, Vec<u8>>;

/// Where settings find the files that they name.
#[derive(Debug, Clone, Default)]
pub enum Files {
    #[default]
    Disk,
    /// On the disk; what was read is kept.
    Kept(Arc<Mutex<Taken>>),
    /// Among these only: what another process has read and judged is not read again.
    Only(Arc<Taken>),
}

impl Files {
    /// On the disk; [`Files::taken`] tells what was read.
    #[must_use]
    pub fn kept() -> Self {
        Self::Kept(Arc::default())
    }

    /// What was read, of files that are kept.
    #[must_use]
    pub fn taken(&self) -> Taken {
        match self {
            Self::Disk => Taken::new(),
            Self::Kept(taken) => taken.lock().unwrap_or_else(PoisonError::into_inner).clone(),
            Self::Only(taken) => Taken::clone(taken),
        }
    }

    /// As [`read_regular`].
    ///
    /// # Errors
    ///
    /// As [`read_regular`], or it is not among these.
    pub fn read(&self, path: &Path, most: u64) -> Result<Vec<u8>> {
        match self {
            Self::Disk => read_regular(path, most),
            Self::Kept(taken) => {
                let bytes = read_regular(path, most)?;
                let mut taken = taken.lock().unwrap_or_else(PoisonError::into_inner);
                // The first reading counts: a file may change between two.
                Ok(taken.entry(path.to_path_buf()).or_insert(bytes).clone())
            }
            Self::Only(taken) => taken
                .get(path)
                .cloned()
                .ok_or_else(|| Error::new(ErrorKind::NotFound, "it was not read before")),
        }
    }

    /// As [`read_text`].
    ///
    /// # Errors
    ///
    /// As [`Files::read`], or it is not UTF-8.
    pub fn read_text(&self, path: &Path, most: u64) -> Result<String> {
        text(self.read(path, most)?)
    }

    /// As [`read_xml`], where these are.
    ///
    /// # Errors
    ///
    /// As [`Files::read`], or it is in another encoding.
    pub fn read_xml(&self, path: &Path, most: u64) -> Result<String> {
        xml_text(self.read(path, most)?)
    }

    /// Whether there is something of this name.
    #[must_use]
    pub fn has(&self, path: &Path) -> bool {
        match self {
            Self::Disk | Self::Kept(_) => path.exists(),
            Self::Only(taken) => taken.contains_key(path),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_path_keeps_its_name() {
        let name = format!("{}.mcap", "n".repeat(100));
        for (path, most, wanted) in [
            ("/a/b.mcap".to_owned(), 60, "/a/b.mcap".to_owned()),
            (format!("/{}/run.mcap", "folder/".repeat(50)), 20, "…older//run.mcap".to_owned()),
            (format!("/a/{name}"), 60, format!("…{name}")),
            (format!("/{}/bag/", "x".repeat(100)), 10, "…xxxx/bag/".to_owned()),
            ("é".repeat(5000), 60, format!("…{}", "é".repeat(255))),
        ] {
            let told = shortened_path(&path, most);
            assert!(told.ends_with(wanted.trim_start_matches('…')), "{told}");
            assert!(
                told.chars().count() <= most.max(257) && (path.len() < 12 || told.starts_with('…')),
                "{told}"
            );
        }
    }

    #[test]
    fn devices_folders_and_long_files_are_refused_with_a_reason() {
        let refusal = |path: &str, most| read_text(Path::new(path), most).unwrap_err().to_string();
        assert_eq!(refusal("/dev/zero", 10), "not a regular file");
        assert_eq!(refusal("/", 10), "a directory, not a regular file");
        let own = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml");
        let bytes = std::fs::metadata(own).unwrap().len();
        assert_eq!(refusal(own, 10), format!("it has {bytes} bytes, 10 are the most that are read"));
        // Says that it has no bytes.
        let endless = refusal("/proc/self/smaps", 10);
        assert_eq!(endless, "it has more than 10 bytes, 10 are the most that are read");
        assert!(read_text(Path::new(own), 1 << 20).unwrap().contains("foretrace-config"));
    }

    #[test]
    fn files_that_were_kept_are_the_only_ones_and_do_not_change() {
        let folder = tempfile::tempdir().unwrap();
        let [path, other] = ["a", "b"].map(|name| folder.path().join(name));
        std::fs::write(&path, "one").unwrap();
        let kept = Files::kept();
        assert_eq!(kept.read_text(&path, 10).unwrap(), "one");
        std::fs::write(&path, "two").unwrap();
        std::fs::write(&other, "three").unwrap();
        assert_eq!(kept.read_text(&path, 10).unwrap(), "one");
        let only = Files::Only(Arc::new(kept.taken()));
        assert_eq!(only.read_text(&path, 10).unwrap(), "one");
        assert!(only.has(&path) && !only.has(&other) && kept.has(&other));
        assert_eq!(only.read(&other, 10).unwrap_err().to_string(), "it was not read before");
        assert!(Files::Disk.taken().is_empty());
    }
}
