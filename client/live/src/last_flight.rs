//! Where the newest file of a flight recorder is: a note in the instance's folder, which `foretrace status`
//! shows.
//!
//! Contract: the note appears whole; it is the newest one, whatever became of its file. Reading it trusts
//! nothing: its length is bounded, its words are known, control characters are replaced.

use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::flight::{FlightFile, Trigger};
use foretrace_record::RecordError;

/// Name of the note.
const NOTE: &str = "flight";
/// Bytes of a note at most: a path and two short words.
const LONGEST_NOTE: u64 = 8192;

/// The newest file of a flight recorder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LastFlight {
    pub recording: PathBuf,
    /// Why it was written.
    pub trigger: Trigger,
    /// When \[ns since 1970\].
    pub unix_ns: u64,
}

/// Notes in the instance's folder `root` that `written` was written at `unix_ns`.
///
/// # Errors
///
/// The folder cannot be written.
pub fn note(root: &Path, written: &FlightFile, unix_ns: u64) -> Result<(), RecordError> {
    let path = root.join(NOTE);
    let recording = std::path::absolute(&written.recording).unwrap_or_else(|_| written.recording.clone());
    let words = format!("{unix_ns} {} {}", written.trigger.word(), recording.display());
    foretrace_host::whole::write(&path, |out| out.write_all(words.as_bytes()))
        .map_err(|source| RecordError::Write { path, source })
}

/// The newest file that was noted in the instance's folder `root`; `None`: none, or the note is damaged.
#[must_use]
pub fn last(root: &Path) -> Option<LastFlight> {
    let path = root.join(NOTE);
    // A pipe would be waited for.
    if !std::fs::symlink_metadata(&path).is_ok_and(|found| found.is_file()) {
        return None;
    }
    let mut words = String::new();
    std::fs::File::open(&path).ok()?.take(LONGEST_NOTE).read_to_string(&mut words).ok()?;
    let mut parts = words.splitn(3, ' ');
    let unix_ns = parts.next()?.parse().ok()?;
    let trigger = parts.next().and_then(Trigger::from_word)?;
    let shown = |c: char| if c.is_control() { '\u{fffd}' } else { c };
    let recording: String = parts.next()?.chars().map(shown).collect();
    Some(LastFlight { recording: recording.into(), trigger, unix_ns })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_note_is_read_and_damaged_ones_are_none() {
        let folder = tempfile::TempDir::new().unwrap();
        assert_eq!(last(folder.path()), None);
        let written = |name: &str, trigger| FlightFile {
            recording: format!("/box of mine/{name}").into(),
            trace: PathBuf::new(),
            trigger,
            ticks: 1,
        };
        note(folder.path(), &written("1.mcap", Trigger::Stop), 5).unwrap();
        note(folder.path(), &written("2\n\u{1b}[2J.mcap", Trigger::PlanFailed), 7).unwrap();
        let found = last(folder.path()).unwrap();
        assert_eq!((found.trigger, found.unix_ns), (Trigger::PlanFailed, 7));
        assert_eq!(found.recording, Path::new("/box of mine/2\u{fffd}\u{fffd}[2J.mcap"));
        for damaged in ["", "x", "7", "7 stop", "7 lunch /a", "-1 stop /a"] {
            std::fs::write(folder.path().join(NOTE), damaged).unwrap();
            assert_eq!(last(folder.path()), None, "{damaged:?}");
        }
        std::fs::write(folder.path().join(NOTE), [b'9', b' ', 0xff]).unwrap();
        assert_eq!(last(folder.path()), None);
        std::fs::write(folder.path().join(NOTE), vec![b'1'; 1 << 20]).unwrap();
        assert_eq!(last(folder.path()), None);
    }
}
