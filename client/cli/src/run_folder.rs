//! Folders that runs get of their own, named by what was run and when.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use foretrace_host::calendar::UtcMoment;

use crate::failure::Failure;

/// Makes `below`/`name`-`now`; a number follows if another run has that name.
pub(crate) fn new_run_folder(below: &Path, name: &str, now: SystemTime) -> Result<PathBuf, Failure> {
    let stem = format!("{name}-{}", compact(now));
    let refused = |path: &Path, error: &std::io::Error| {
        let what = format!("the folder {} cannot be made: {error}", path.display());
        Failure::failed(what, "give a folder that you may write to (--out DIR)")
    };
    let (mut again, mut gone) = (1, 0);
    loop {
        let folder = below.join(if again == 1 { stem.clone() } else { format!("{stem}-{again}") });
        let made = std::fs::create_dir_all(below).map_err(|error| (below, error));
        match made.and_then(|()| std::fs::create_dir(&folder).map_err(|error| (folder.as_path(), error))) {
            Ok(()) => return Ok(folder),
            Err((path, error)) => match error.kind() {
                ErrorKind::AlreadyExists if path != below && again < 1000 => again += 1,
                // Another run that tried the same place has just removed what it had made of it: `below` may
                // be there when it is to be made, and gone when it is looked at.
                ErrorKind::AlreadyExists | ErrorKind::NotFound if gone < 1000 => gone += 1,
                _ => return Err(refused(path, &error)),
            },
        }
    }
}

/// Whether a folder can be made in `folder`, which is made where it is not there. Leaves nothing but, beside
/// another run that tries the same place, empty folders.
#[cfg(feature = "lab")]
pub(crate) fn try_folder(folder: &Path, now: SystemTime) -> Result<(), Failure> {
    let named = folder.ancestors().filter(|folder| !folder.as_os_str().is_empty());
    let missing: Vec<&Path> = named.take_while(|folder| !folder.exists()).collect();
    let tried = new_run_folder(folder, ".foretrace", now)?;
    for made in std::iter::once(tried.as_path()).chain(missing) {
        // Another run may have put something there in the meantime.
        let _ = std::fs::remove_dir(made);
    }
    Ok(())
}

/// `20261128-194512`, UTC.
fn compact(time: SystemTime) -> String {
    let UtcMoment { date: [year, month, day], clock: [hour, minute, second] } = UtcMoment::of(time);
    format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
}

#[cfg(test)]
mod tests {
    use std::time::UNIX_EPOCH;

    use super::*;

    #[test]
    fn a_second_run_of_the_same_second_gets_a_folder_of_its_own() {
        let below = tempfile::tempdir().unwrap();
        let make = || new_run_folder(&below.path().join("runs"), "bench", UNIX_EPOCH).unwrap();
        let names = [make(), make(), make()].map(|path| path.file_name().unwrap().to_owned());
        assert_eq!(names, ["bench-19700101-000000", "bench-19700101-000000-2", "bench-19700101-000000-3"]);
        let file = below.path().join("file");
        std::fs::write(&file, "").unwrap();
        let told = new_run_folder(&file, "bench", UNIX_EPOCH).unwrap_err().to_string();
        assert!(told.contains("file") && told.contains("--out DIR"), "{told}");
    }

    /// Each removes what the others may be about to use.
    #[cfg(feature = "lab")]
    #[test]
    fn runs_that_try_the_same_place_at_once_do_not_refuse_each_other() {
        let below = tempfile::tempdir().unwrap();
        let place = below.path().join("a/b/c");
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..500).for_each(|_| try_folder(&place, UNIX_EPOCH).unwrap()));
            }
        });
    }
}
