//! Files that are written whole or not at all: a neighbour is written, then renamed.

use std::ffi::OsString;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::os::unix::fs::MetadataExt as _;
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

/// Creates `part` for this process alone, locked for as long as it is open. What stands there already and is
/// locked by nobody was left by a process that ended early: `leftover` removes or renames it, or refuses.
///
/// # Errors
/// [`ErrorKind::ResourceBusy`]: a living process writes it. [`ErrorKind::AlreadyExists`]: it is not a regular
/// file. Whatever `leftover` and the file system say.
pub fn begin(part: &Path, leftover: impl Fn(&Path) -> io::Result<()>) -> io::Result<File> {
    /// Others may take it away and make it again in between, but not for ever.
    const TRIES: usize = 8;
    let busy = || io::Error::new(ErrorKind::ResourceBusy, "another process is writing it");
    for _ in 0..TRIES {
        let file = match OpenOptions::new().write(true).create_new(true).open(part) {
            Ok(file) => file,
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                // Neither a link, whose target would be emptied, nor a pipe, which would be waited for.
                if !part.symlink_metadata().is_ok_and(|about| about.is_file()) {
                    return Err(error);
                }
                match OpenOptions::new().write(true).open(part) {
                    Ok(old) => {
                        locked(&old, busy)?;
                        if is_at(&old, part) {
                            leftover(part)?;
                        }
                    }
                    Err(error) if error.kind() == ErrorKind::NotFound => {}
                    Err(error) => return Err(error),
                }
                continue;
            }
            Err(error) => return Err(error),
        };
        locked(&file, busy)?;
        // Between its making and its lock another process may have taken it for a leftover.
        if is_at(&file, part) {
            return Ok(file);
        }
    }
    Err(busy())
}

fn locked(file: &File, busy: impl Fn() -> io::Error) -> io::Result<()> {
    match file.try_lock() {
        Ok(()) => Ok(()),
        Err(TryLockError::WouldBlock) => Err(busy()),
        // A file system without locks: as before there were any.
        Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => Ok(()),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

/// Whether `file` is the one at `path`.
fn is_at(file: &File, path: &Path) -> bool {
    let same = |here: std::fs::Metadata, there: std::fs::Metadata| {
        (here.dev(), here.ino()) == (there.dev(), there.ino())
    };
    file.metadata().is_ok_and(|here| path.symlink_metadata().is_ok_and(|there| same(here, there)))
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
    use super::{begin, write};
    use std::io::{Error, ErrorKind, Write};

    #[test]
    fn a_leftover_does_not_block_and_a_living_writer_does() {
        let folder = tempfile::tempdir().unwrap();
        let part = folder.path().join("a.part");
        let removed = |part: &std::path::Path| std::fs::remove_file(part);
        let mut first = begin(&part, removed).unwrap();
        first.write_all(b"first").unwrap();
        assert_eq!(begin(&part, removed).unwrap_err().kind(), ErrorKind::ResourceBusy);
        assert_eq!(std::fs::read(&part).unwrap(), b"first");
        drop(first);
        // Whoever was killed holds no lock.
        let kept = folder.path().join("kept");
        drop(begin(&part, |part| std::fs::rename(part, &kept)).unwrap());
        assert_eq!(
            (std::fs::read(&kept).unwrap(), std::fs::read(&part).unwrap()),
            (b"first".to_vec(), vec![])
        );
        assert_eq!(begin(&part, |_| Err(Error::other("mine"))).unwrap_err().to_string(), "mine");
        drop(begin(&part, removed).unwrap());
        // A link is not followed, a folder not removed.
        std::fs::remove_file(&part).unwrap();
        std::os::unix::fs::symlink(&kept, &part).unwrap();
        assert_eq!(begin(&part, removed).unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!(std::fs::read(&kept).unwrap(), b"first");
        assert_eq!(begin(folder.path(), removed).unwrap_err().kind(), ErrorKind::AlreadyExists);
    }

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
