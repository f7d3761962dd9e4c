//! Limits of a shell or a service manager on this process (`ulimit`): checked at start, and named in errors
//! that they may cause.
//!
//! Contract: reads `/proc/self/limits` and changes nothing but the disposition of SIGXFSZ. If that file
//! cannot be read, nothing is refused.

use std::fmt::Write;
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use signal_hook::consts::SIGXFSZ;

/// Open files needed by a daemon with an arm, a pen and watching programs, with margin (53 measured).
const FILES: u64 = 96;
/// Largest file that a daemon makes, its shared memory, with margin (1 MB measured).
const FILE_BYTES: u64 = 4 << 20;
/// A main thread with a smaller stack gets another.
const STACK_BYTES: u64 = 4 << 20;
/// Size of that stack.
const ROOM_BYTES: usize = 8 << 20;

/// Size of a page, as `/proc` counts them; where they are larger, more memory counts as left.
const PAGE_BYTES: u64 = 4096;

/// A limit, by its name in `/proc/self/limits`.
struct KnownLimit {
    name: &'static str,
    words: &'static str,
    option: &'static str,
    /// Below this it may be the cause of a failure.
    low: u64,
    /// Bytes per unit of `ulimit`.
    unit: u64,
}

const KNOWN: [KnownLimit; 4] = [
    KnownLimit { name: "Max open files", words: "open files", option: "-n", low: 256, unit: 1 },
    KnownLimit {
        name: "Max file size",
        words: "size of a file in KiB",
        option: "-f",
        low: 256 << 20,
        unit: 1024,
    },
    KnownLimit {
        name: "Max address space",
        words: "address space in KiB",
        option: "-v",
        low: 1 << 30,
        unit: 1024,
    },
    KnownLimit { name: "Max processes", words: "processes and threads", option: "-u", low: 128, unit: 1 },
];

/// Why a daemon was not started.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the limit of this process on {words} is {now} (ulimit {option}), the daemon needs {least}: \
     raise it before starting, for example `ulimit {option} {least}`"
)]
pub struct TooLow {
    words: &'static str,
    option: &'static str,
    now: u64,
    least: u64,
}

/// Checks the limits that a daemon needs, before it creates anything.
///
/// # Errors
///
/// The first limit that is too low.
pub fn check() -> Result<(), TooLow> {
    check_in(&table())
}

fn check_in(table: &str) -> Result<(), TooLow> {
    for (known, least) in KNOWN.iter().zip([FILES, FILE_BYTES]) {
        if let Some(now) = soft(table, known.name).filter(|now| *now < least) {
            let KnownLimit { words, option, unit, .. } = *known;
            return Err(TooLow { words, option, now: now / unit, least: least / unit });
        }
    }
    Ok(())
}

/// Limits that may be the cause of a failure, in one sentence; none if all are high.
#[must_use]
pub fn low() -> Option<String> {
    low_in(&table())
}

fn low_in(table: &str) -> Option<String> {
    let mut list = String::new();
    for KnownLimit { name, words, option, low, unit } in &KNOWN {
        if let Some(now) = soft(table, name).filter(|now| now < low) {
            let comma = if list.is_empty() { "" } else { ", " };
            // Writing to a string does not fail.
            let _ = write!(list, "{comma}{words} {} (ulimit {option})", now / unit);
        }
    }
    (!list.is_empty())
        .then(|| format!("limits of this process are low and may be the reason: {list}; raise them"))
}

/// From now on a file that grows beyond the limit is an error for its writer, instead of the end of the
/// process.
pub fn ignore_sigxfsz() {
    // If this fails, the process ends as by default.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
}

/// Runs `work` on the main thread's stack, or on a larger one if that is small (`ulimit -s`).
///
/// # Errors
///
/// The system starts no thread.
pub fn with_large_stack<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> io::Result<T> {
    if soft(&table(), "Max stack size").is_none_or(|bytes| bytes >= STACK_BYTES) {
        return Ok(work());
    }
    let thread =
        std::thread::Builder::new().name("foretrace-main".into()).stack_size(ROOM_BYTES).spawn(work)?;
    thread.join().map_err(|_| io::Error::other("the program failed"))
}

/// Address space that this process may still map \[bytes\]; `None`: as much as it wants.
#[must_use]
pub fn address_space_left() -> Option<u64> {
    let most = soft(&table(), "Max address space")?;
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: u64 = pages.split(' ').next()?.parse().ok()?;
    Some(most.saturating_sub(pages.saturating_mul(PAGE_BYTES)))
}

fn table() -> String {
    std::fs::read_to_string("/proc/self/limits").unwrap_or_default()
}

/// The soft limit; `None` if unlimited or unknown.
fn soft(table: &str, name: &str) -> Option<u64> {
    table.lines().find_map(|line| line.strip_prefix(name))?.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(files: &str, file: &str, space: &str) -> String {
        format!(
            "Limit                     Soft Limit           Hard Limit           Units     \n\
             Max file size             {file}            unlimited            bytes     \n\
             Max stack size            262144              unlimited            bytes     \n\
             Max processes             96365                96365                processes \n\
             Max open files            {files}                20000                files     \n\
             Max address space         {space}            unlimited            bytes     \n"
        )
    }

    #[test]
    fn what_is_too_low_is_named_with_its_option_and_the_least() {
        let words = check_in(&table("32", "unlimited", "unlimited")).unwrap_err().to_string();
        assert!(words.contains("open files is 32 (ulimit -n)") && words.contains("ulimit -n 96"), "{words}");
        let words = check_in(&table("1024", "8192", "unlimited")).unwrap_err().to_string();
        assert!(words.contains("in KiB is 8 (ulimit -f)") && words.contains("ulimit -f 4096"), "{words}");
        assert_eq!(check_in(&table("1024", "unlimited", "unlimited")), Ok(()));
        assert_eq!(check_in(""), Ok(()));
    }

    #[test]
    fn limits_that_may_be_the_reason_are_listed() {
        let words = low_in(&table("100", "unlimited", "60000000")).unwrap();
        assert!(
            words.contains("open files 100 (ulimit -n), address space in KiB 58593 (ulimit -v)"),
            "{words}"
        );
        assert_eq!(low_in(&table("1024", "unlimited", "unlimited")), None);
        assert_eq!(low_in(""), None);
    }

    #[test]
    fn work_is_done_whatever_the_stack() {
        assert_eq!(with_large_stack(|| 7).unwrap(), 7);
    }
}
