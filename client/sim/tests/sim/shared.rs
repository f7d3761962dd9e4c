//! The shared data sets, if they are present.

use std::io::Write as _;
use std::path::PathBuf;

/// The folder; `None`, and a message, without it.
pub(crate) fn shared() -> Option<PathBuf> {
    let folder = std::env::var_os("FORETRACE_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared"), PathBuf::from);
    if folder.join("data").is_dir() {
        return Some(folder);
    }
    // Past the capture of the test runner: a skipped test must be seen.
    let _ =
        writeln!(std::io::stderr(), "skipped: no shared data at {} (set FORETRACE_SHARED)", folder.display());
    None
}
