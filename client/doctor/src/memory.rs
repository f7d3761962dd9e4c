//! Shared memory: a file system of its own in memory, with room for what the daemon will reserve.

use std::io;
use std::path::Path;

use foretrace_client::Instance;
use foretraced::memory::rehearse_reserve;
use foretraced::rt::os::{self, Space};

use crate::finding::CheckResult;
use crate::machine::{KernelFiles, Silent};

const SHM: &str = "shared-memory";
const MOUNTS: &str = "proc/self/mounts";
const FOLDER: &str = "/dev/shm";

/// Where the daemon's segments will be, and a trial of its reserve.
pub(crate) fn shared(machine: &KernelFiles, instance: &Instance) -> CheckResult {
    let reserved = rehearse_reserve(instance).map_err(|error| error.to_string());
    judged(kind(machine), os::space(Path::new(FOLDER)), reserved)
}

/// The file system mounted at /dev/shm; `None`: none is.
fn kind(machine: &KernelFiles) -> Result<Option<String>, Silent> {
    let text = machine.text(MOUNTS)?;
    let mut kinds = text.lines().filter_map(|line| {
        let mut words = line.split_whitespace().skip(1);
        words.next().filter(|mount| *mount == FOLDER)?;
        words.next()
    });
    // The last one covers the others.
    Ok(kinds.next_back().map(str::to_owned))
}

fn judged(
    kind: Result<Option<String>, Silent>,
    space: io::Result<Space>,
    reserved: Result<u64, String>,
) -> CheckResult {
    let mount =
        "`sudo mount -t tmpfs -o size=256m,mode=1777 tmpfs /dev/shm`, and the same as a line of /etc/fstab";
    let space = match space {
        Ok(space) => space,
        Err(error) => return CheckResult::bad(SHM, format!("{FOLDER} cannot be asked: {error}"), mount),
    };
    let room = "`ls -lhS /dev/shm` and remove unused files, or `sudo mount -o remount,size=256m \
                /dev/shm`; in a container: `docker run --shm-size=64m`";
    let value = match reserved {
        Ok(bytes) => format!(
            "{} KiB free of {} KiB, the daemon's {} KiB could be reserved",
            space.free / 1024,
            space.total / 1024,
            bytes / 1024
        ),
        // An unreserved segment gets its pages at first access; the process dies of SIGBUS if memory is full.
        Err(error) => return CheckResult::bad(SHM, error, room),
    };
    match kind {
        Ok(Some(kind)) if kind == "tmpfs" || kind == "ramfs" => {}
        Ok(Some(kind)) => {
            return CheckResult::warning(
                SHM,
                format!("{kind}, not tmpfs: a tick may wait for a disk; {value}"),
                mount,
            );
        }
        Ok(None) => {
            return CheckResult::warning(
                SHM,
                format!("{FOLDER} is no mount of its own: a tick may wait for a disk; {value}"),
                mount,
            );
        }
        Err(silent) => return CheckResult::unseen(SHM, MOUNTS, silent),
    }
    if space.free < 2 * foretrace_shm::SHARED_MEMORY_LIMIT_BYTES {
        return CheckResult::warning(SHM, format!("{value}, but hardly more is left"), room);
    }
    CheckResult::ok(SHM, value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::Level;
    use crate::machine::made_up::MadeUp;

    const LARGE: Space = Space { free: 1 << 30, total: 1 << 31 };

    fn on(mounts: &[u8]) -> Result<Option<String>, Silent> {
        kind(&MadeUp::new(&[(MOUNTS, mounts)]).machine())
    }

    #[test]
    fn the_last_mount_counts() {
        let mounts = b"ext4 / ext4 rw 0 0\ntmpfs /dev/shm tmpfs rw 0 0\n";
        assert_eq!(on(mounts), Ok(Some("tmpfs".to_owned())));
        assert_eq!(on(b"a /dev/shm tmpfs x\nb /dev/shm ext4 rw"), Ok(Some("ext4".to_owned())));
        for garbage in [&b""[..], b"\xff\xfe\0", b"/dev/shm", b"x /dev/shm"] {
            assert_eq!(on(garbage), Ok(None));
        }
        assert_eq!(kind(&MadeUp::new(&[]).machine()), Err(Silent::Missing));
    }

    #[test]
    fn room_for_the_reserve_decides() {
        let tmpfs = || Ok(Some("tmpfs".to_owned()));
        let found = judged(tmpfs(), Ok(LARGE), Ok(8 << 20));
        assert!(found.ok && found.value.contains("8192 KiB could be reserved"), "{found:?}");
        let full = judged(tmpfs(), Ok(LARGE), Err("/dev/shm has 12 KiB free".to_owned()));
        assert!(
            full.level == Level::Bad && full.value.contains("12 KiB") && full.fix.contains("remount"),
            "{full:?}"
        );
        let tight = judged(tmpfs(), Ok(Space { free: 9 << 20, total: 16 << 20 }), Ok(8 << 20));
        assert_eq!(tight.level, Level::Warning);
        let gone = judged(tmpfs(), Err(io::Error::from(io::ErrorKind::NotFound)), Ok(0));
        assert!(gone.level == Level::Bad && gone.fix.contains("mount -t tmpfs"), "{gone:?}");
        for kind in [Ok(None), Ok(Some("ext4".to_owned())), Err(Silent::Missing)] {
            let found = judged(kind, Ok(LARGE), Ok(8 << 20));
            assert!(found.level == Level::Warning && !found.fix.is_empty(), "{found:?}");
        }
    }

    #[test]
    fn this_machine_is_judged() {
        let folder = tempfile::tempdir_in("/tmp").unwrap();
        let instance = Instance::at(8, folder.path().join("i")).unwrap();
        let found = shared(&KernelFiles::here(), &instance);
        assert_eq!(found.ok, found.fix.is_empty(), "{found:?}");
    }
}
