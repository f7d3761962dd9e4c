//! The machine's description of itself in /proc and /sys, read below a root that tests replace.
//!
//! Contract: every file may be missing, unreadable or garbage, and each of these is distinguished; nothing
//! here fails or panics, and no file is read beyond a bound.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::PathBuf;
use std::str::FromStr;

/// More than /proc/interrupts of the largest machine.
const LONGEST: u64 = 16 << 20;
/// More CPUs than Linux can be built for.
const CPUS: u32 = 1 << 14;

/// Where the kernel's files are.
#[derive(Debug, Clone)]
pub(crate) struct KernelFiles {
    root: PathBuf,
}

/// Why a file gave no value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Silent {
    /// Absent: the kernel does not have this feature.
    Missing,
    /// It is there, and this is what is wrong with it, its path included.
    Wrong(String),
}

impl KernelFiles {
    pub(crate) fn here() -> Self {
        Self::below("/")
    }

    /// What lies below `root`.
    pub(crate) fn below(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The text of `path` (without a leading slash), trimmed; bytes that are not UTF-8 are replaced.
    pub(crate) fn text(&self, path: &str) -> Result<String, Silent> {
        let mut bytes = Vec::new();
        let read =
            File::open(self.root.join(path)).and_then(|file| file.take(LONGEST).read_to_end(&mut bytes));
        match read {
            Ok(_) => Ok(String::from_utf8_lossy(&bytes).trim().to_owned()),
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                Err(Silent::Missing)
            }
            Err(error) => Err(Silent::Wrong(format!("/{path} cannot be read: {error}"))),
        }
    }

    /// The one value in `path`.
    pub(crate) fn value<T: FromStr>(&self, path: &str) -> Result<T, Silent> {
        let text = self.text(path)?;
        text.parse().map_err(|_| garbage(path, &text))
    }

    /// The CPUs listed in `path`, ascending; none for an empty file.
    pub(crate) fn cpus(&self, path: &str) -> Result<Vec<u32>, Silent> {
        let text = self.text(path)?;
        cpu_list(&text).ok_or_else(|| garbage(path, &text))
    }

    /// The CPUs that run.
    pub(crate) fn online(&self) -> Result<Vec<u32>, Silent> {
        self.cpus("sys/devices/system/cpu/online")
    }

    /// The CPU of the loop, or, where it is not pinned, all that run; CPU 0 if unknown.
    pub(crate) fn cpus_of_loop(&self, pinned: Option<u32>) -> Vec<u32> {
        pinned.map(|cpu| vec![cpu]).or_else(|| self.online().ok()).unwrap_or_else(|| vec![0])
    }

    /// The names in a folder, in order; none where there is no such folder.
    pub(crate) fn names(&self, path: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.root.join(path)).into_iter().flatten().flatten();
        let mut names: Vec<String> =
            entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        names.sort();
        names
    }

    /// Whether a hypervisor runs this machine; not known counts as no.
    pub(crate) fn is_virtual(&self) -> bool {
        let text = self.text("proc/cpuinfo").unwrap_or_default();
        let mut flags = text.lines().filter(|line| line.starts_with("flags"));
        flags.any(|line| line.split_whitespace().any(|flag| flag == "hypervisor"))
    }
}

/// `text` was found where something else was expected.
pub(crate) fn garbage(path: &str, text: &str) -> Silent {
    let shown: String = text.chars().take(40).filter(|c| !c.is_control()).collect();
    Silent::Wrong(format!("/{path} says `{shown}`, which is not understood"))
}

/// The kernel's notation of sets of CPUs: `0-3,5`.
pub(crate) fn cpu_list(text: &str) -> Option<Vec<u32>> {
    let mut cpus = Vec::new();
    for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last): (u32, u32) = (first.parse().ok()?, last.parse().ok()?);
        if first > last || last >= CPUS {
            return None;
        }
        cpus.extend(first..=last);
    }
    cpus.sort_unstable();
    cpus.dedup();
    Some(cpus)
}

/// The inverse of [`cpu_list`].
pub(crate) fn listed(cpus: &[u32]) -> String {
    let mut runs: Vec<(u32, u32)> = Vec::new();
    for cpu in cpus {
        match runs.last_mut() {
            Some((_, last)) if *last + 1 == *cpu => *last = *cpu,
            _ => runs.push((*cpu, *cpu)),
        }
    }
    let run = |(first, last): &(u32, u32)| {
        if first == last { first.to_string() } else { format!("{first}-{last}") }
    };
    runs.iter().map(run).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
pub(crate) mod made_up {
    use super::KernelFiles;

    /// A root with these files; dropped, it is gone.
    pub(crate) struct MadeUp(tempfile::TempDir);

    impl MadeUp {
        pub(crate) fn new(files: &[(&str, &[u8])]) -> Self {
            let made = Self(tempfile::tempdir().unwrap());
            for (path, bytes) in files {
                made.put(path, bytes);
            }
            made
        }

        pub(crate) fn put(&self, path: &str, bytes: &[u8]) {
            let file = self.0.path().join(path);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, bytes).unwrap();
        }

        pub(crate) fn machine(&self) -> KernelFiles {
            KernelFiles::below(self.0.path())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::made_up::MadeUp;
    use super::*;

    #[test]
    fn cpu_lists_are_read_and_written_and_nonsense_is_refused() {
        for text in ["0", "0-3", "0-3,5,8-9", ""] {
            assert_eq!(listed(&cpu_list(text).unwrap()), text);
        }
        assert_eq!(cpu_list("3,1,1-2"), Some(vec![1, 2, 3]));
        for text in ["x", "3-1", "1-", "-", "0-99999999", "1 2", "\u{fffd}"] {
            assert_eq!(cpu_list(text), None, "{text}");
        }
    }

    #[test]
    fn a_missing_file_a_folder_and_garbage_are_told_apart() {
        let made = MadeUp::new(&[("proc/number", b" 950000\n"), ("proc/bytes", &[0xff, 0xfe, 7, 0])]);
        let machine = made.machine();
        assert_eq!(machine.value::<i64>("proc/number"), Ok(950_000));
        assert_eq!(machine.value::<i64>("proc/nothing"), Err(Silent::Missing));
        assert_eq!(machine.value::<i64>("proc/number/below"), Err(Silent::Missing));
        assert!(matches!(machine.value::<i64>("proc"), Err(Silent::Wrong(text)) if text.contains("/proc")));
        assert!(matches!(machine.value::<i64>("proc/bytes"), Err(Silent::Wrong(text))
                if text.contains("proc/bytes")));
        assert_eq!(machine.cpus_of_loop(None), [0]);
        made.put("sys/devices/system/cpu/online", b"0-3\n");
        assert_eq!(machine.cpus_of_loop(None), [0, 1, 2, 3]);
        assert_eq!(machine.cpus_of_loop(Some(2)), [2]);
        assert_eq!(machine.names("proc"), ["bytes", "number"]);
        assert!(machine.names("nowhere").is_empty());
    }
}
