//! The report folder: one page that needs no file beside it, and the same figures as JSON.

use std::fmt::Display;
use std::io::Write as _;
use std::path::Path;

use super::figures::Figures;
use crate::failure::Failure;

/// Makes sure that `folder` is there and can be written.
pub(crate) fn prepare(folder: &Path) -> Result<(), Failure> {
    let refused = |error: std::io::Error| {
        Failure::bad_input(
            format_args!("cannot write the report into {}: {error}", folder.display()),
            "give a writable folder with --out",
        )
    };
    std::fs::create_dir_all(folder).map_err(refused)?;
    let probe = folder.join(".writable");
    std::fs::write(&probe, []).and_then(|()| std::fs::remove_file(&probe)).map_err(refused)
}

/// Writes both files into `folder`, each whole or not at all.
pub(crate) fn write(folder: &Path, figures: &Figures, page: &str) -> Result<(), Failure> {
    let unwritable = |error: &dyn Display| {
        Failure::failed(format_args!("cannot write the report: {error}"), "give a writable folder with --out")
    };
    std::fs::create_dir_all(folder).map_err(|error| unwritable(&error))?;
    let mut json = serde_json::to_string_pretty(figures).map_err(|error| unwritable(&error))?;
    json.push('\n');
    for (name, text) in [("report.json", json.as_str()), ("report.html", page)] {
        foretrace_sim::whole::write(&folder.join(name), |out| out.write_all(text.as_bytes()))
            .map_err(|error| unwritable(&error))?;
    }
    Ok(())
}
