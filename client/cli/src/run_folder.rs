//! Folders that runs get of their own, named by what was run and when.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crate::failure::Failure;

/// Makes `below`/`name`-`now`; a number follows if another run has that name.
pub(crate) fn new_run_folder(below: &Path, name: &str, now: SystemTime) -> Result<PathBuf, Failure> {
    let stem = format!("{name}-{}", compact(now));
    let refused = |path: &Path, error: &std::io::Error| {
        let what = format!("the folder {} cannot be made: {error}", path.display());
        Failure::failed(what, "give a folder that you may write to (--out DIR)")
    };
    std::fs::create_dir_all(below).map_err(|error| refused(below, &error))?;
    let mut again = 1;
    loop {
        let folder = below.join(if again == 1 { stem.clone() } else { format!("{stem}-{again}") });
        match std::fs::create_dir(&folder) {
            Ok(()) => return Ok(folder),
            Err(error) if error.kind() == ErrorKind::AlreadyExists && again < 1000 => again += 1,
            Err(error) => return Err(refused(&folder, &error)),
        }
    }
}

/// `20261128-194512`, UTC.
fn compact(time: SystemTime) -> String {
    let ([year, month, day], [hour, minute, second]) = calendar(time);
    format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
}

/// `2026-11-28T19:45:12Z` (RFC 3339).
#[cfg(feature = "lab")]
pub(crate) fn rfc3339(time: SystemTime) -> String {
    let ([year, month, day], [hour, minute, second]) = calendar(time);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Date and time of day in UTC.
///
/// Source: Howard Hinnant, "chrono-Compatible Low-Level Date Algorithms", `civil_from_days`.
fn calendar(time: SystemTime) -> ([u64; 3], [u64; 3]) {
    let seconds = time.duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs();
    // Years begin in March, so that a leap day ends one; eras of 400 years begin at 0000-03-01.
    let days = seconds / 86_400 + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    ([year, month, day], [seconds / 3600 % 24, seconds / 60 % 60, seconds % 60])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        // The middle ones from RFC 3339's neighbourhood of leap days: `date -u -d @SECONDS`.
        for (seconds, text) in [
            (0, "19700101-000000"),
            (951_782_399, "20000228-235959"),
            (951_782_400, "20000229-000000"),
            (951_868_800, "20000301-000000"),
            (1_709_164_800, "20240229-000000"),
            (4_107_542_399, "21000228-235959"),
            (4_107_542_400, "21000301-000000"),
            (1_795_895_112, "20261128-194512"),
        ] {
            assert_eq!(compact(UNIX_EPOCH + Duration::from_secs(seconds)), text);
        }
    }

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
}
