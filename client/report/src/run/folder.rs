//! The report folder: one page that needs no file beside it, and the same figures as JSON.

use std::fmt::Display;
use std::path::Path;

use super::RunReport;
use foretrace_failure::Failure;

/// Makes sure that `folder` is there and can be written.
pub fn prepare(folder: &Path) -> Result<(), Failure> {
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

/// Writes both files into `out`: a report that fails leaves nothing behind, and what was there stays.
pub fn write(out: &Path, report: &RunReport) -> Result<(), Failure> {
    let unwritable = |error: &dyn Display| {
        Failure::failed(format_args!("cannot write the report: {error}"), "give a writable folder with --out")
    };
    let mut json = serde_json::to_string_pretty(&report.figures).map_err(|error| unwritable(&error))?;
    json.push('\n');
    let page = report.page();
    whole(out, |folder| {
        std::fs::create_dir_all(folder)?;
        [("report.json", &json), ("report.html", &page)]
            .into_iter()
            .try_for_each(|(name, text)| std::fs::write(folder.join(name), text))
    })
    .map_err(|error| unwritable(&error))
}

/// Lets `write` fill a folder of its own inside `out`, then moves the files.
fn whole(out: &Path, write: impl FnOnce(&Path) -> std::io::Result<()>) -> std::io::Result<()> {
    let partial = out.join(format!(".report-{}.partial", std::process::id()));
    let written = write(&partial).and_then(|()| {
        for entry in std::fs::read_dir(&partial)? {
            let entry = entry?;
            std::fs::rename(entry.path(), out.join(entry.file_name()))?;
        }
        Ok(())
    });
    // Empty, or of no use.
    let _ = std::fs::remove_dir_all(&partial);
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_that_fails_leaves_the_old_one_and_nothing_half_written() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("report.html"), "old").unwrap();
        let filled = |text: &'static str, outcome: std::io::Result<()>| {
            whole(folder.path(), |partial| {
                std::fs::create_dir_all(partial).unwrap();
                std::fs::write(partial.join("path.svg"), text).unwrap();
                std::fs::write(partial.join("report.html"), text).unwrap();
                outcome
            })
        };
        let count = || std::fs::read_dir(folder.path()).unwrap().count();
        assert!(filled("new", Err(std::io::Error::other("no room"))).is_err());
        assert_eq!(count(), 1);
        assert_eq!(std::fs::read_to_string(folder.path().join("report.html")).unwrap(), "old");
        filled("new", Ok(())).unwrap();
        assert_eq!(count(), 2);
        assert_eq!(std::fs::read_to_string(folder.path().join("report.html")).unwrap(), "new");
    }
}
