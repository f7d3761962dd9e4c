//! Occupancy of an instance: the lock that makes a daemon the only one, living peers, leftovers of dead ones.
//!
//! Contract: the lock file shows whether a daemon is up, without the middleware. Leftovers are removed only
//! under the lock and only while no peer lives, and only names with the instance's own prefix.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::SHARED_MEMORY;
use super::root::{Instance, InstanceError, MIDDLEWARE_FOLDER};
use crate::wire::clock::monotonic_now_ns;

/// Result of a purge.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Purge {
    /// No peer lives; this many shared-memory files were removed.
    Removed(usize),
    /// These processes still use the instance: nothing was removed.
    PeersAlive(Vec<u32>),
}

/// Shared memory of one instance.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SharedMemory {
    /// Number of segments.
    pub segments: usize,
    /// Their total size.
    pub bytes: u64,
    /// Bytes backed by pages; the rest is allocated at first touch, and a full /dev/shm then kills with
    /// SIGBUS.
    pub backed_bytes: u64,
}

/// One run of a daemon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DaemonMark {
    /// Its process number.
    pub pid: u32,
    /// When it announced itself, on the monotonic clock \[ns\].
    pub announced_ns: u64,
}

/// The daemon's claim on an instance, held until dropped (or the process ends).
#[derive(Debug)]
pub struct InstanceLock {
    file: File,
}

impl Instance {
    /// The daemon that is up, if any.
    ///
    /// A daemon counts as up from [`InstanceLock::announce`] until its process ends, however it ends.
    pub fn daemon(&self) -> Option<DaemonMark> {
        let mut file = File::open(self.lock_path()).ok()?;
        match file.try_lock_shared() {
            // The lock is free: the file's content is a leftover.
            Ok(()) => None,
            Err(_) => announced(&mut file),
        }
    }

    /// Becomes the only daemon of this instance; makes the root directory if needed.
    ///
    /// # Errors
    ///
    /// `Held`, those of [`Instance::check_root`], `Io`.
    pub fn lock(&self) -> Result<InstanceLock, InstanceError> {
        self.make_root()?;
        let path = self.lock_path();
        let io = |source| InstanceError::Io { path: path.clone(), source };
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(&path)
            .map_err(io)?;
        // A peer looking for a daemon holds the lock briefly, and the last one to leave for as long as it
        // tidies up: retry, and longer if no daemon has announced itself.
        for tries in 0..100 {
            if tries >= 20 && announced(&mut file).is_some() {
                break;
            }
            match file.try_lock() {
                Ok(()) => {
                    file.set_len(0).map_err(io)?;
                    return Ok(InstanceLock { file });
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(10)),
                Err(TryLockError::Error(source)) => return Err(io(source)),
            }
        }
        Err(InstanceError::Held { number: self.number(), pid: announced(&mut file).map(|mark| mark.pid) })
    }

    /// Removes leftovers of dead processes, if no peer lives. For the daemon only, under its lock and before
    /// it opens anything.
    ///
    /// # Errors
    ///
    /// `PeersUnknown`, `Io`.
    pub fn purge(&self, _lock: &InstanceLock) -> Result<Purge, InstanceError> {
        let alive = self.peers()?;
        if !alive.is_empty() {
            return Ok(Purge::PeersAlive(alive));
        }
        let folder = self.root().join(MIDDLEWARE_FOLDER);
        match fs::remove_dir_all(&folder) {
            Err(source) if source.kind() != io::ErrorKind::NotFound => {
                return Err(InstanceError::Io { path: folder, source });
            }
            _ => {}
        }
        let mut removed = 0;
        for path in self.segments()? {
            match fs::remove_file(&path) {
                Ok(()) => removed += 1,
                Err(source) if source.kind() == io::ErrorKind::NotFound => {}
                Err(source) => {
                    own_segment(&path)?;
                    return Err(InstanceError::Io { path, source });
                }
            }
        }
        Ok(Purge::Removed(removed))
    }

    /// Removes everything, if neither a daemon nor a peer lives: for a process that may be the last to leave.
    /// Returns whether it was. Damaged files can make it hang: callers bound the time.
    pub fn tidy_up(&self) -> bool {
        let Ok(file) = OpenOptions::new().read(true).write(true).open(self.lock_path()) else { return false };
        // Another process that leaves at this moment may hold it, and may still have seen this process alive.
        let mut tries = 0;
        while file.try_lock().is_err() {
            tries += 1;
            if tries > 40 || self.daemon().is_some() {
                return false;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        matches!(self.purge(&InstanceLock { file }), Ok(Purge::Removed(_)))
    }

    /// Checks that every segment of this instance belongs to this user alone. /dev/shm is open to everybody:
    /// another user can create a file there under a name that the middleware would open.
    ///
    /// # Errors
    ///
    /// `ForeignSegment`, `Io`.
    pub fn check_segments(&self) -> Result<(), InstanceError> {
        self.segments()?.iter().try_for_each(|path| own_segment(path))
    }

    /// Segments of this user that are empty, in order. A segment is made empty and given its size some
    /// microseconds later; the middleware waits without end for one that stays so.
    ///
    /// # Errors
    ///
    /// `Io`.
    pub fn empty_segments(&self) -> Result<Vec<PathBuf>, InstanceError> {
        let user = crate::os::effective_user();
        let is_empty = |path: &PathBuf| {
            fs::symlink_metadata(path)
                .is_ok_and(|found| found.is_file() && found.len() == 0 && found.uid() == user)
        };
        let mut empty: Vec<PathBuf> = self.segments()?.into_iter().filter(is_empty).collect();
        empty.sort();
        Ok(empty)
    }

    /// Process numbers of all living peers, the daemon included, in ascending order.
    ///
    /// # Errors
    ///
    /// `PeersUnknown`.
    pub fn peers(&self) -> Result<Vec<u32>, InstanceError> {
        let (mut alive, _, _) = self.nodes()?;
        alive.dedup();
        Ok(alive)
    }

    /// The shared memory of this instance.
    ///
    /// # Errors
    ///
    /// `Io`.
    pub fn shared_memory(&self) -> Result<SharedMemory, InstanceError> {
        let mut sum = SharedMemory::default();
        for path in self.segments()? {
            // A peer may leave between the two calls.
            if let Ok(found) = fs::metadata(&path) {
                sum.segments += 1;
                sum.bytes += found.size();
                sum.backed_bytes += found.blocks() * 512;
            }
        }
        Ok(sum)
    }

    fn lock_path(&self) -> PathBuf {
        self.root().join("lock")
    }

    fn segments(&self) -> Result<Vec<PathBuf>, InstanceError> {
        let io = |source| InstanceError::Io { path: SHARED_MEMORY.into(), source };
        let mut found = Vec::new();
        for entry in fs::read_dir(SHARED_MEMORY).map_err(io)? {
            let entry = entry.map_err(io)?;
            if entry.file_name().as_encoded_bytes().starts_with(self.prefix().as_bytes()) {
                found.push(entry.path());
            }
        }
        Ok(found)
    }
}

impl InstanceLock {
    /// Announces that the daemon is up: its services exist and may be opened.
    ///
    /// # Errors
    ///
    /// The system refused to write.
    pub fn announce(&mut self) -> io::Result<()> {
        self.file.set_len(0)?;
        self.file.rewind()?;
        writeln!(self.file, "{} {}", std::process::id(), monotonic_now_ns())?;
        self.file.flush()
    }

    /// Withdraws [`InstanceLock::announce`] before the services are removed.
    ///
    /// # Errors
    ///
    /// The system refused to write.
    pub fn withdraw(&mut self) -> io::Result<()> {
        self.file.set_len(0)
    }
}

/// Refuses a segment that another user owns or may access; a missing one passes.
fn own_segment(path: &Path) -> Result<(), InstanceError> {
    // Not `metadata`: a symbolic link of another user must not pass as the owner of its target.
    let Ok(found) = fs::symlink_metadata(path) else { return Ok(()) };
    let (owner, mode, user) = (found.uid(), found.mode() & 0o777, crate::os::effective_user());
    if owner == user && mode & 0o077 == 0 {
        return Ok(());
    }
    Err(InstanceError::ForeignSegment { path: path.to_path_buf(), owner, mode, user })
}

fn announced(file: &mut File) -> Option<DaemonMark> {
    let mut text = String::new();
    file.rewind().ok()?;
    file.take(64).read_to_string(&mut text).ok()?;
    let (pid, announced_ns) = text.trim().split_once(' ')?;
    Some(DaemonMark { pid: pid.parse().ok()?, announced_ns: announced_ns.parse().ok()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scratch() -> (tempfile::TempDir, Instance) {
        let folder = tempfile::tempdir_in("/tmp").unwrap();
        let instance = Instance::at(3, folder.path().join("i")).unwrap();
        (folder, instance)
    }

    #[test]
    fn only_one_daemon_holds_an_instance_and_only_an_announced_one_is_up() {
        let (_folder, instance) = scratch();
        assert_eq!(instance.daemon(), None);
        let mut lock = instance.lock().unwrap();
        assert_eq!(instance.daemon(), None);
        assert!(matches!(instance.lock(), Err(InstanceError::Held { number: 3, pid: None })));
        lock.announce().unwrap();
        assert_eq!(instance.daemon().unwrap().pid, std::process::id());
        let error = instance.lock().unwrap_err();
        assert!(error.to_string().contains("instance 3 already has a daemon"), "{error}");
        lock.withdraw().unwrap();
        assert_eq!(instance.daemon(), None);
        lock.announce().unwrap();
        drop(lock);
        assert_eq!(instance.daemon(), None);
        instance.lock().unwrap();
    }

    #[test]
    fn a_segment_that_another_user_owns_or_may_touch_is_refused_by_name() {
        use std::os::unix::fs::PermissionsExt;
        let (_folder, instance) = scratch();
        let path = PathBuf::from(format!("{SHARED_MEMORY}/{}planted.data", instance.prefix()));
        fs::write(&path, "").unwrap();
        let set = |mode| fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
        set(0o600);
        let own = instance.check_segments();
        set(0o606);
        let open = instance.check_segments();
        set(0o600);
        // Only root can change owners.
        let given = std::os::unix::fs::chown(&path, Some(65534), None).map(|()| instance.check_segments());
        fs::remove_file(&path).unwrap();
        own.unwrap();
        assert!(matches!(open, Err(InstanceError::ForeignSegment { mode: 0o606, .. })), "{open:?}");
        match given {
            Ok(foreign) => {
                let text = foreign.unwrap_err().to_string();
                assert!(text.contains("planted.data belongs to user 65534"), "{text}");
            }
            Err(_) => {
                let note = b"skipped in part: only root can plant another user's file\n";
                // Not captured by the test runner.
                let _ = std::io::Write::write_all(&mut std::io::stderr(), note);
            }
        }
    }

    #[test]
    fn a_purge_removes_own_leftovers_and_nothing_else() {
        let (_folder, instance) = scratch();
        let other = Instance::at(4, instance.root()).unwrap();
        let lock = instance.lock().unwrap();
        let segment =
            |instance: &Instance| PathBuf::from(format!("{SHARED_MEMORY}/{}x.data", instance.prefix()));
        fs::write(segment(&instance), [0; 5000]).unwrap();
        fs::write(segment(&other), "").unwrap();
        fs::create_dir_all(instance.root().join("iox2/services")).unwrap();
        let memory = instance.shared_memory().unwrap();
        assert_eq!((memory.segments, memory.bytes, memory.backed_bytes), (1, 5000, 8192));
        assert_eq!(instance.purge(&lock).unwrap(), Purge::Removed(1));
        assert!(!segment(&instance).exists() && segment(&other).exists());
        assert!(!instance.root().join("iox2").exists() && instance.root().join("lock").exists());
        fs::remove_file(segment(&other)).unwrap();
    }
}
