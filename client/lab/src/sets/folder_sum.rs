//! What tells one folder of recordings from another.

use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use foretrace_host::sha256::{Sha256, sha256_of_file};
use serde::Serialize;

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
    /// Sums up `folder`, or a single file. Links count as what they lead to, like the recordings that are
    /// read through them.
    ///
    /// # Errors
    /// Whatever the file system says.
    pub fn of(folder: &Path) -> io::Result<Self> {
        let mut walk = FolderWalk { root: folder, above: Vec::new(), entered: 0, files: Vec::new() };
        if folder.is_dir() {
            walk.enter(".")?;
        }
        let mut files = walk.files;
        files.sort();
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

/// A way through a folder.
struct FolderWalk<'a> {
    root: &'a Path,
    /// The folders on the way down: one of them again is a link back up, which has no end.
    above: Vec<(u64, u64)>,
    /// Folders that were entered: links between few make many ways.
    entered: usize,
    files: Vec<String>,
}

impl FolderWalk<'_> {
    fn enter(&mut self, below: &str) -> io::Result<()> {
        let own = std::fs::metadata(self.root.join(below))?;
        let own = (own.dev(), own.ino());
        if self.above.contains(&own) {
            return Ok(());
        }
        self.entered += 1;
        if self.entered > FILES_MAX {
            return Err(io::Error::other(format!("more than {FILES_MAX} folders")));
        }
        self.above.push(own);
        for entry in std::fs::read_dir(self.root.join(below))? {
            // No recording can have a name that is not UTF-8.
            let Ok(name) = entry?.file_name().into_string() else { continue };
            if name.starts_with('.') {
                continue;
            }
            let path = format!("{below}/{name}");
            // A link to nothing is no file.
            let Ok(found) = std::fs::metadata(self.root.join(&path)) else { continue };
            if found.is_dir() {
                self.enter(&path)?;
            } else if found.is_file() {
                if self.files.len() == FILES_MAX {
                    return Err(io::Error::other(format!("more than {FILES_MAX} files")));
                }
                self.files.push(path);
            }
        }
        self.above.pop();
        Ok(())
    }
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
        let elsewhere = tempfile::tempdir().unwrap();
        std::fs::write(elsewhere.path().join("far.dat"), "4").unwrap();
        // A file and a folder that lie elsewhere, a way back up, and one to nothing.
        let links = [
            ("y.dat", "z.dat"),
            ("d", elsewhere.path().to_str().unwrap()),
            ("include/up", ".."),
            ("e", "no"),
        ];
        for (name, to) in links {
            std::os::unix::fs::symlink(to, root.join(name)).unwrap();
        }
        let found = FolderSum::of(root).unwrap();
        assert_eq!(found.files, 5);
        let lines =
            "find -L . -type f ! -path '*/.?*' -print0 | LC_ALL=C sort -z | xargs -0 sha256sum | sha256sum";
        let out = Command::new("sh").args(["-c", lines]).current_dir(root).output().unwrap();
        let told = String::from_utf8(out.stdout).unwrap();
        assert_eq!(told.split_whitespace().next().unwrap(), found.sha256, "{told}");
        std::fs::write(elsewhere.path().join("far.dat"), "3").unwrap();
        assert_ne!(FolderSum::of(root).unwrap().sha256, found.sha256);
        assert!(FolderSum::of(&root.join("nobody")).is_err());
    }
}
