//! The shared memory of the instance: enough of it, and all of it backed by pages before an arm may move.
//!
//! A segment that is not backed takes its pages at first touch; when /dev/shm is full by then, the process that
//! touches dies of SIGBUS, possibly in the middle of a motion. Locking memory does not help: mlockall returns success.

use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use foretrace_shm::{Instance, SHARED_MEMORY_LIMIT_BYTES};

use crate::rt::os::{self, Missing, Right};

const SHARED_MEMORY: &str = "/dev/shm";

/// There is too little of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "/dev/shm has {} KiB free, an instance needs up to {} KiB: remove files there, or give the container more \
     (docker run --shm-size=64m)", free / 1024, needed / 1024
)]
pub struct NoSpace {
    /// Free [bytes].
    pub free: u64,
    /// Needed [bytes].
    pub needed: u64,
}

/// Checks that an instance fits before anything is created.
///
/// # Errors
/// It does not.
pub fn check_space() -> Result<(), NoSpace> {
    // Where the question fails there is no /dev/shm at all; creating the services then says so.
    let free = os::free_space(Path::new(SHARED_MEMORY)).unwrap_or(u64::MAX);
    fits(free, SHARED_MEMORY_LIMIT_BYTES)
}

const fn fits(free: u64, needed: u64) -> Result<(), NoSpace> {
    if free >= needed { Ok(()) } else { Err(NoSpace { free, needed }) }
}

/// Why the segments could not be reserved.
#[derive(Debug, thiserror::Error)]
pub enum ReserveError {
    /// The file system is full.
    #[error("{0}")]
    NoSpace(#[from] NoSpace),
    /// Another reason; the loop may run, at the risk named above.
    #[error("{}", .0.text)]
    Refused(Missing),
}

/// Backs every segment of the instance by pages; returns their size together [bytes].
///
/// # Errors
/// The file system is full, or a segment cannot be reserved.
pub fn reserve(instance: &Instance) -> Result<u64, ReserveError> {
    let refused = |what: String| {
        let text = format!(
            "shared memory not reserved ({what}): should /dev/shm become full while the loop runs, it dies of SIGBUS"
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
        // A peer that leaves takes its segment along.
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
}
