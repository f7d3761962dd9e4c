//! The shared memory of the instance: enough of it, and all backed by pages before an arm may move.
//!
//! A segment without pages gets them at first touch; if /dev/shm is full by then, the process dies of SIGBUS,
//! possibly in the middle of a motion. Locking memory does not help: mlockall returns success.

use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

use foretrace_shm::{Instance, SHARED_MEMORY, SHARED_MEMORY_LIMIT_BYTES};

use crate::rt::os::{self, Missing, Right};

/// Too little shared memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "/dev/shm has {} KiB free, an instance needs up to {} KiB: remove files there, or give the container \
     more \
     (docker run --shm-size=64m)", free / 1024, needed / 1024
)]
pub struct NoSpace {
    /// Free \[bytes\].
    pub free: u64,
    /// Needed \[bytes\].
    pub needed: u64,
}

/// Checks that an instance fits before anything is created.
///
/// # Errors
/// It does not.
pub fn check_space() -> Result<(), NoSpace> {
    // An error means that there is no /dev/shm at all, which creating the services will report.
    let free = os::free_space(Path::new(SHARED_MEMORY)).unwrap_or(u64::MAX);
    fits(free, SHARED_MEMORY_LIMIT_BYTES)
}

const fn fits(free: u64, needed: u64) -> Result<(), NoSpace> {
    if free >= needed { Ok(()) } else { Err(NoSpace { free, needed }) }
}

/// Reserves as much shared memory as the instance may need beyond its present pages, as [`reserve`] will, and
/// frees it at once; returns the bytes.
///
/// The file has no name: it disappears with this process, however that ends.
///
/// # Errors
/// The file system is full (or a limit on this process's memory is reached), or cannot reserve.
pub fn rehearse_reserve(instance: &Instance) -> Result<u64, ReserveError> {
    let backed = instance.shared_memory().map_or(0, |memory| memory.backed_bytes);
    rehearse_reserve_in(Path::new(SHARED_MEMORY), SHARED_MEMORY_LIMIT_BYTES.saturating_sub(backed).max(1))
}

fn rehearse_reserve_in(folder: &Path, bytes: u64) -> Result<u64, ReserveError> {
    let file = std::fs::OpenOptions::new().write(true).custom_flags(libc::O_TMPFILE).mode(0o600).open(folder);
    match file.and_then(|file| os::reserve(&file, bytes)) {
        Ok(()) => Ok(bytes),
        Err(error) if error.kind() == io::ErrorKind::StorageFull => {
            Err(NoSpace { free: os::free_space(folder).unwrap_or(0), needed: bytes }.into())
        }
        Err(error) => {
            let text = format!("{} bytes in {} cannot be reserved: {error}", bytes, folder.display());
            Err(ReserveError::Refused(Missing { right: Right::SharedMemory, text }))
        }
    }
}

/// Why the segments could not be reserved.
#[derive(Debug, thiserror::Error)]
pub enum ReserveError {
    /// The file system is full.
    #[error("{0}")]
    NoSpace(#[from] NoSpace),
    /// Another reason; the loop may run, at the risk described above.
    #[error("{}", .0.text)]
    Refused(Missing),
}

/// Backs every segment of the instance by pages; returns their total size \[bytes\].
///
/// # Errors
/// The file system is full, or a segment cannot be reserved.
pub fn reserve(instance: &Instance) -> Result<u64, ReserveError> {
    let refused = |what: String| {
        let text = format!(
            "shared memory not reserved ({what}): should /dev/shm become full while the loop runs, it dies \
             of SIGBUS"
        );
        ReserveError::Refused(Missing { right: Right::SharedMemory, text })
    };
    let mut total = 0;
    let entries = std::fs::read_dir(SHARED_MEMORY).map_err(|error| refused(error.to_string()))?;
    for entry in entries.flatten() {
        if !entry.file_name().as_encoded_bytes().starts_with(instance.prefix().as_bytes()) {
            continue;
        }
        let path = entry.path();
        // A peer that leaves removes its segment.
        let Ok(found) = std::fs::metadata(&path) else { continue };
        total += found.size();
        if found.blocks() * 512 >= found.size() {
            continue;
        }
        let reserved = std::fs::OpenOptions::new()
            .write(true)
            .open(&path)
            .and_then(|file| os::reserve(&file, found.size()));
        match reserved {
            Err(error) if error.kind() == io::ErrorKind::StorageFull => {
                let free = os::free_space(Path::new(SHARED_MEMORY)).unwrap_or(0);
                return Err(NoSpace { free, needed: found.size() }.into());
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(refused(format!("{}: {error}", path.display()))),
            Ok(()) => {}
        }
    }
    Ok(total)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_space_is_refused_with_both_numbers() {
        assert_eq!(fits(8 << 20, 8 << 20), Ok(()));
        let text = fits(1 << 20, 8 << 20).unwrap_err().to_string();
        assert!(text.contains("1024 KiB free") && text.contains("8192 KiB"), "{text}");
    }

    #[test]
    fn a_rehearsed_reserve_leaves_nothing_and_is_refused_where_it_cannot_fit() {
        let bytes = 64 << 10;
        assert_eq!(rehearse_reserve_in(Path::new(SHARED_MEMORY), bytes).unwrap(), bytes);
        let error = rehearse_reserve_in(Path::new(SHARED_MEMORY), 1 << 60).unwrap_err();
        assert!(!error.to_string().is_empty());
        let error = rehearse_reserve_in(Path::new("/no/such/folder"), bytes).unwrap_err();
        assert!(
            matches!(&error, ReserveError::Refused(missing) if missing.text.contains("/no/such/folder")),
            "{error}"
        );
    }
}
