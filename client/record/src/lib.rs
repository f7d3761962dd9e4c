//! Recordings: everything that the loop saw and did, in one MCAP file that the tools of others open, and that
//! this program replays bit for bit.
//!
//! Contract: whatever a file holds, reading it ends with a result or a message. No daemon is needed: who
//! listens to one and writes these files is in `foretrace-live`.
//!
//! Rooms, each of which uses only those before it: `proto`, `topics` (what is in a file), `scene` (what
//! stands around the pen), `write`, `read`, `table`, `pen`, `repair`, `info`, `figures`, `explain`, `law`,
//! `replay`, `verdict`, `modelled`, `stretch`, `score`, `what_if`, `picture`, `page` (a run as HTML).
//!
//! Source: MCAP specification 0 (mcap.dev/spec); Foxglove's schemas.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod proto;
pub mod topics;
pub mod scene;
pub mod write;
pub mod read;
pub mod table;
pub mod pen;
pub mod repair;
pub mod info;
pub mod figures;
pub mod explain;
mod law;
pub mod replay;
pub mod verdict;
mod modelled;
mod stretch;
pub mod score;
pub mod what_if;
pub mod picture;
pub mod page;

use std::path::{Path, PathBuf};

/// Why a recording cannot be written or read.
#[derive(thiserror::Error)]
pub enum RecordError {
    /// Nothing is overwritten.
    #[error("{} exists already; give a new name, or remove it", path.display())]
    Exists { path: PathBuf },
    /// Another recorder is at work.
    #[error("{} is being written by another recorder; give another name", path.display())]
    Busy { path: PathBuf },
    /// The disk refuses.
    #[error("cannot write {}: {source}; what was recorded until then can be mended with \
             `foretrace record --repair`", path.display())]
    Write { path: PathBuf, source: std::io::Error },
    /// The disk refuses.
    #[error("cannot read {}: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// Not a recording.
    #[error("{} is no recording: {why}", path.display())]
    NoRecording { path: PathBuf, why: String },
    /// Damaged before anything that is needed.
    #[error("{}: {what}, and it ends early, {damage}; `foretrace record --repair` keeps \
             what comes before", path.display())]
    Unread { path: PathBuf, what: String, damage: String },
    /// Damaged before any message: there is nothing to mend either.
    #[error("{}: {what}, and it ends early, {damage}; no message stands before that: copy it again, or record \
             anew", path.display())]
    NothingBefore { path: PathBuf, what: String, damage: String },
    /// Nothing in it can be saved.
    #[error("{} holds no message that can be read{}; no file was written: copy it again, or record anew",
            path.display(), damage.as_ref().map_or_else(String::new, |damage| format!(": it ends early, {damage}")))]
    NothingToMend { path: PathBuf, damage: Option<String> },
    /// What another program wrote.
    #[error("{}: {what}: none of its topics ({topics}) is one of `foretrace record`, whose recordings are read \
             here", path.display())]
    NoTopics { path: PathBuf, what: String, topics: String },
    /// Made by another version.
    #[error(
        "{}: the messages of {topic} have another layout than this program's; use the version of foretrace \
         that `--info` names", path.display()
    )]
    OtherLayout { path: PathBuf, topic: String },
    /// A message that no recorder wrote.
    #[error("{}: a message of {topic} is damaged; mend the file with `foretrace record --repair`",
            path.display())]
    Damaged { path: PathBuf, topic: String },
    /// The format refuses.
    #[error("{}: {why}", path.display())]
    Format { path: PathBuf, why: String },
}

foretrace_shm::debug_as_display!(RecordError);

impl RecordError {
    /// Of a file that cannot be begun.
    fn of_part(path: &Path, source: std::io::Error) -> Self {
        let path = path.to_path_buf();
        match source.kind() {
            std::io::ErrorKind::ResourceBusy => Self::Busy { path },
            std::io::ErrorKind::AlreadyExists => Self::Exists { path },
            _ => Self::Write { path, source },
        }
    }

    fn of_mcap(path: &Path, error: mcap::McapError) -> Self {
        let path = path.to_path_buf();
        match error {
            mcap::McapError::Io(source) => Self::Write { path, source },
            other => Self::Format { path, why: other.to_string() },
        }
    }
}

/// Gives the finished `part` its name, unless a file has that name.
fn appear(part: &Path, target: &Path) -> Result<(), RecordError> {
    let failed = |source| RecordError::Write { path: target.to_path_buf(), source };
    // A link fails where a rename would overwrite.
    match std::fs::hard_link(part, target) {
        Ok(()) => {}
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
            return Err(RecordError::Exists { path: target.to_path_buf() });
        }
        // Some file systems have no links.
        Err(_) if !target.exists() => return std::fs::rename(part, target).map_err(failed),
        Err(source) => return Err(failed(source)),
    }
    std::fs::remove_file(part).map_err(|source| RecordError::Write { path: part.to_path_buf(), source })
}

/// Name of `target` while it is made of other files: not that of a recorder's part, which holds the only copy
/// of what it recorded and is never replaced.
fn unfinished(target: &Path) -> PathBuf {
    let mut name = target.as_os_str().to_owned();
    name.push(".partial");
    name.into()
}

/// Writes the new file `target`, made of other files, which appears whole or not at all. What an earlier try
/// left is replaced; another process that is at it is not disturbed.
///
/// # Errors
///
/// It exists, another process makes it, the folder cannot be written, or as `write`.
pub fn whole<T>(
    target: &Path,
    write: impl FnOnce(&mut std::fs::File) -> Result<T, RecordError>,
) -> Result<T, RecordError> {
    let part = unfinished(target);
    if target.exists() {
        return Err(RecordError::Exists { path: target.to_path_buf() });
    }
    let left = |part: &Path| std::fs::remove_file(part);
    let mut file =
        foretrace_host::whole::begin(&part, left).map_err(|error| RecordError::of_part(&part, error))?;
    let done = write(&mut file).and_then(|done| appear(&part, target).map(|()| done));
    if done.is_err() {
        // Half a file helps nobody.
        let _ = std::fs::remove_file(&part);
    }
    done
}
