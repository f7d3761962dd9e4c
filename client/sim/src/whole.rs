//! Files that are written whole or not at all: a neighbour is written, then renamed.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Neighbours that are being written at the moment.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// For a program that is about to end: removes what is half-written. Later writers block until the program
/// ends.
pub fn give_up() {
    let unfinished = unfinished();
    for partial in unfinished.iter() {
        // A file that cannot be removed now is left.
        let _ = std::fs::remove_file(partial);
    }
    std::mem::forget(unfinished);
}

fn unfinished() -> MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A neighbour that is being written.
struct Partial(PathBuf);

impl Partial {
    fn begin(path: PathBuf) -> Self {
        unfinished().push(path.clone());
        Self(path)
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        unfinished().retain(|path| *path != self.0);
    }
}

/// Fills `file` by `write`, so that no reader ever sees half of it. A special file (a device, a pipe) is
/// written in place.
///
/// # Errors
/// Whatever the file system or `write` says; the file is then as it was.
pub fn write(file: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    if file.metadata().is_ok_and(|about| !about.is_file() && !about.is_dir()) {
        return fill(file, write);
    }
    let partial = Partial::begin(neighbour(file));
    fill(&partial.0, write).and_then(|()| std::fs::rename(&partial.0, file)).inspect_err(|_| {
        // The first error is reported; a left-over file does no harm.
        let _ = std::fs::remove_file(&partial.0);
    })
}

fn fill(file: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::new(File::create(file)?);
    write(&mut out)?;
    out.flush()
}

fn neighbour(file: &Path) -> PathBuf {
    let mut name: OsString = file.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.partial", std::process::id()));
    file.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::write;
    use std::io::{Error, Write};

    #[test]
    fn failure_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.csv");
        write(&file, |out| out.write_all(b"old")).unwrap();
        let failed = write(&file, |out| out.write_all(b"new").and(Err(Error::other("no more"))));
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&file).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        write(&file, |out| out.write_all(b"new")).unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"new");
    }
}
