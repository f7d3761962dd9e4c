//! What tells one folder of recordings from another.

use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{Sha256, sha256_of_file};

/// More would be no set.
const FILES_MAX: usize = 200_000;

/// The files of a folder, summed up.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FolderSum {
    pub folder: PathBuf,
    pub files: usize,
    /// SHA-256 of the lines that `sha256sum` prints for the files, sorted by path; hidden ones are left out.
    pub sha256: String,
}

impl FolderSum {
    /// Sums up `folder`, or a single file.
    ///
    /// # Errors
    /// Whatever the file system says.
    pub fn of(folder: &Path) -> io::Result<Self> {
        let mut files = Vec::new();
        if folder.is_dir() {
            walk(folder, ".", &mut files)?;
            files.sort();
        }
        let mut sum = Sha256::default();
        if files.is_empty() {
            let (sha256, files) =
                if folder.is_dir() { (sum.finish(), 0) } else { (sha256_of_file(folder)?, 1) };
            return Ok(Self { folder: folder.to_owned(), files, sha256 });
        }
        for file in &files {
            sum.update(format!("{}  {file}\n", sha256_of_file(&folder.join(file))?).as_bytes());
        }
        Ok(Self { folder: folder.to_owned(), files: files.len(), sha256: sum.finish() })
    }
}

fn walk(root: &Path, below: &str, files: &mut Vec<String>) -> io::Result<()> {
    for entry in std::fs::read_dir(root.join(below))? {
        let entry = entry?;
        // No recording can have a name that is not UTF-8.
        let Ok(name) = entry.file_name().into_string() else { continue };
        if name.starts_with('.') {
            continue;
        }
        let path = format!("{below}/{name}");
        if entry.file_type()?.is_dir() {
            walk(root, &path, files)?;
        } else if root.join(&path).is_file() {
            if files.len() == FILES_MAX {
                return Err(io::Error::other(format!("more than {FILES_MAX} files")));
            }
            files.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn the_sum_is_that_of_the_lines_of_sha256sum() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        std::fs::create_dir_all(root.join("include/b")).unwrap();
        for (name, text) in [("z.dat", "1"), ("A b.dat", "2"), ("include/b/c", ""), (".hidden", "x")] {
            std::fs::write(root.join(name), text).unwrap();
        }
        let found = FolderSum::of(root).unwrap();
        assert_eq!(found.files, 3);
        let lines =
            "find . -type f ! -path '*/.?*' -print0 | LC_ALL=C sort -z | xargs -0 sha256sum | sha256sum";
        let out = Command::new("sh").args(["-c", lines]).current_dir(root).output().unwrap();
        let told = String::from_utf8(out.stdout).unwrap();
        assert_eq!(told.split_whitespace().next().unwrap(), found.sha256, "{told}");
        std::fs::write(root.join("z.dat"), "3").unwrap();
        assert_ne!(FolderSum::of(root).unwrap().sha256, found.sha256);
        assert!(FolderSum::of(&root.join("nobody")).is_err());
    }
}
