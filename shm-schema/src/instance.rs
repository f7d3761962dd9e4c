//! An instance: one daemon and its peers, known by a number. Where its files are, who may use them, and the lock
//! that makes the daemon the only one.
//!
//! Contract: the root directory belongs to this user alone (0700) or nothing is opened. Every name in /dev/shm begins
//! with a prefix made of the number, the middleware's version and the root, so that leftovers of one instance can be
//! removed without touching another. The trust boundary is the Unix user.

use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::prelude::{CallbackProgression, Config, FileName, Node, NodeState, SemanticString, ipc};

use crate::layout::fnv1a;

/// Bytes a Unix socket address can hold, its final zero included. Source: unix(7).
const SOCKET_PATH_BYTES: usize = 108;
/// The longest name the middleware may append to root and prefix for a socket: a 128-bit number and `.event`.
const SOCKET_NAME_BYTES: usize = 39 + 6;
/// Peers of another middleware version must not meet: its files are incompatible both ways.
const MIDDLEWARE_VERSION: &str = "093";
/// Below the instance's root; removed by a purge, unlike the lock beside it.
const MIDDLEWARE_FOLDER: &str = "iox2";
const SHARED_MEMORY: &str = "/dev/shm";

/// One instance: its number, root directory and prefix.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Instance {
    number: u32,
    root: PathBuf,
    prefix: String,
    config: Config,
}

/// Why an instance cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum InstanceError {
    /// The path leaves no room for socket names.
    #[error(
        "the instance directory {} has {length} bytes, at most {limit} leave room for socket names: \
         set XDG_RUNTIME_DIR to a shorter path", root.display()
    )]
    RootTooLong {
        /// The directory.
        root: PathBuf,
        /// Its length in bytes.
        length: usize,
        /// The longest allowed.
        limit: usize,
    },
    /// The path has characters the middleware does not take.
    #[error("the instance directory {} is not an absolute path of plain characters", root.display())]
    RootNotPlain {
        /// The directory.
        root: PathBuf,
    },
    /// Something else has this name.
    #[error("{} is not a directory: remove it or choose another instance number", root.display())]
    NotADirectory {
        /// The path.
        root: PathBuf,
    },
    /// Another user owns it.
    #[error(
        "{} belongs to user {owner}, this is user {user}: run as the same user as the daemon, \
         or choose another instance number", root.display()
    )]
    ForeignOwner {
        /// The directory.
        root: PathBuf,
        /// Who owns it.
        owner: u32,
        /// Who asks.
        user: u32,
    },
    /// Others may enter it.
    #[error("{} is open to others (mode {mode:03o}): chmod 700 it", root.display())]
    TooOpen {
        /// The directory.
        root: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
    /// Another daemon has it.
    #[error("instance {number} already has a daemon ({}): stop it or choose another instance number",
        pid.map_or("starting".to_string(), |pid| format!("process {pid}")))]
    Held {
        /// Number of the instance.
        number: u32,
        /// The daemon's process, once it is up.
        pid: Option<u32>,
    },
    /// The system refused a file operation.
    #[error("{}: {source}", path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The middleware could not list the peers.
    #[error("the peers of instance {number} cannot be listed: {detail}")]
    PeersUnknown {
        /// Number of the instance.
        number: u32,
        /// What the middleware said.
        detail: String,
    },
}

/// What a purge did.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Purge {
    /// No peer lives; so many files of shared memory were removed.
    Removed(usize),
    /// These processes still use the instance: nothing was removed.
    PeersAlive(Vec<u32>),
}

/// Shared memory of one instance.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SharedMemory {
    /// Segments.
    pub segments: usize,
    /// Their sizes together.
    pub bytes: u64,
    /// What is backed by pages; the rest is taken at first touch, and a full /dev/shm then kills with SIGBUS.
    pub backed_bytes: u64,
}

/// One run of a daemon.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DaemonMark {
    /// Its process number.
    pub pid: u32,
    /// When it announced itself, on the monotonic clock [ns].
    pub announced_ns: u64,
}

/// The daemon's claim on an instance, held until dropped (or the process ends).
#[derive(Debug)]
pub struct InstanceLock {
    file: File,
}

impl Instance {
    /// The instance of this user with this number: `$XDG_RUNTIME_DIR/foretrace-N`, else `/tmp/foretrace-UID-N`.
    ///
    /// *Errors*: `RootTooLong`, `RootNotPlain`. Touches no file.
    pub fn new(number: u32) -> Result<Self, InstanceError> {
        let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
        Self::at(number, default_root(number, runtime.as_deref(), crate::effective_user()))
    }

    /// An instance whose files live in `root`; for tests and for runtime directories made by a service manager.
    ///
    /// *Errors*: `RootTooLong`, `RootNotPlain`. Touches no file.
    pub fn at(number: u32, root: impl Into<PathBuf>) -> Result<Self, InstanceError> {
        let root = root.into();
        let bytes = root.as_os_str().as_encoded_bytes();
        let prefix = format!("ft{number}v{MIDDLEWARE_VERSION}_{:08x}_", fnv1a(bytes) as u32);
        let limit = SOCKET_PATH_BYTES - 1 - SOCKET_NAME_BYTES - prefix.len() - MIDDLEWARE_FOLDER.len() - 2;
        if bytes.len() > limit {
            return Err(InstanceError::RootTooLong { length: bytes.len(), limit, root });
        }
        match middleware_config(&root, &prefix) {
            Some(config) if root.is_absolute() => Ok(Self { number, root, prefix, config }),
            _ => Err(InstanceError::RootNotPlain { root }),
        }
    }

    /// Its number.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// The directory with everything of it that is a file.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// How its names in /dev/shm begin.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// The middleware's settings; explicit, because its default look-up reads `./config/iceoryx2.toml`.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The daemon that is up, if any.
    ///
    /// A daemon counts as up from [`InstanceLock::announce`] until its process ends, however it ends.
    pub fn daemon(&self) -> Option<DaemonMark> {
        let mut file = File::open(self.lock_path()).ok()?;
        match file.try_lock_shared() {
            // Nobody holds it: what the file says is a leftover.
            Ok(()) => None,
            Err(_) => announced(&mut file),
        }
    }

    /// Become the only daemon of this instance; makes the root directory if needed.
    ///
    /// *Errors*: `Held`, those of [`Instance::check_root`], `Io`.
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
        // A peer looking for a daemon takes the lock for an instant: ask more than once.
        for _ in 0..20 {
            match file.try_lock() {
                Ok(()) => {
                    file.set_len(0).map_err(io)?;
                    return Ok(InstanceLock { file });
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(10)),
                Err(TryLockError::Error(source)) => return Err(io(source)),
            }
        }
        Err(InstanceError::Held { number: self.number, pid: announced(&mut file).map(|mark| mark.pid) })
    }

    /// Check that the root directory exists and belongs to this user alone.
    ///
    /// *Errors*: `NotADirectory`, `ForeignOwner`, `TooOpen`, `Io` (`NotFound` when there is none).
    pub fn check_root(&self) -> Result<(), InstanceError> {
        let io = |source| InstanceError::Io { path: self.root.clone(), source };
        let root = self.root.clone();
        // Not `metadata`: a link set by another user must not lead us elsewhere.
        let found = fs::symlink_metadata(&root).map_err(io)?;
        let (owner, user, mode) = (found.uid(), crate::effective_user(), found.mode() & 0o777);
        if !found.is_dir() {
            return Err(InstanceError::NotADirectory { root });
        }
        if owner != user {
            return Err(InstanceError::ForeignOwner { root, owner, user });
        }
        if mode & 0o077 != 0 {
            return Err(InstanceError::TooOpen { root, mode });
        }
        Ok(())
    }

    /// Remove what dead processes left behind, if no peer lives. Only the daemon may, under its lock and before it
    /// opens anything.
    ///
    /// *Errors*: `PeersUnknown`, `Io`.
    pub fn purge(&self, _lock: &InstanceLock) -> Result<Purge, InstanceError> {
        let alive = self.peers()?;
        if !alive.is_empty() {
            return Ok(Purge::PeersAlive(alive));
        }
        let folder = self.root.join(MIDDLEWARE_FOLDER);
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
                Err(source) => return Err(InstanceError::Io { path, source }),
            }
        }
        Ok(Purge::Removed(removed))
    }

    /// Process numbers of all living peers, the daemon included, in ascending order.
    ///
    /// *Errors*: `PeersUnknown`.
    pub fn peers(&self) -> Result<Vec<u32>, InstanceError> {
        let mut alive = Vec::new();
        if self.root.join(MIDDLEWARE_FOLDER).exists() {
            Node::<ipc::Service>::list(&self.config, |node| {
                if let NodeState::Alive(view) = node {
                    alive.push(iceoryx2::node::NodeView::id(&view).pid().value() as u32);
                }
                CallbackProgression::Continue
            })
            .map_err(|error| InstanceError::PeersUnknown {
                number: self.number,
                detail: error.to_string(),
            })?;
        }
        alive.sort_unstable();
        alive.dedup();
        Ok(alive)
    }

    /// The shared memory of this instance.
    ///
    /// *Errors*: `Io`.
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
        self.root.join("lock")
    }

    fn make_root(&self) -> Result<(), InstanceError> {
        match DirBuilder::new().mode(0o700).create(&self.root) {
            Err(source) if source.kind() != io::ErrorKind::AlreadyExists => {
                Err(InstanceError::Io { path: self.root.clone(), source })
            }
            _ => self.check_root(),
        }
    }

    fn segments(&self) -> Result<Vec<PathBuf>, InstanceError> {
        let io = |source| InstanceError::Io { path: SHARED_MEMORY.into(), source };
        let mut found = Vec::new();
        for entry in fs::read_dir(SHARED_MEMORY).map_err(io)? {
            let entry = entry.map_err(io)?;
            if entry.file_name().as_encoded_bytes().starts_with(self.prefix.as_bytes()) {
                found.push(entry.path());
            }
        }
        Ok(found)
    }
}

impl InstanceLock {
    /// Tell everybody that the daemon is up: its services exist and may be opened.
    ///
    /// *Errors*: the system refused to write.
    pub fn announce(&mut self) -> io::Result<()> {
        self.file.set_len(0)?;
        self.file.rewind()?;
        writeln!(self.file, "{} {}", std::process::id(), crate::monotonic_now_ns())?;
        self.file.flush()
    }

    /// Take [`InstanceLock::announce`] back before the services go.
    ///
    /// *Errors*: the system refused to write.
    pub fn withdraw(&mut self) -> io::Result<()> {
        self.file.set_len(0)
    }
}

fn middleware_config(root: &Path, prefix: &str) -> Option<Config> {
    let folder = format!("{}/{MIDDLEWARE_FOLDER}/", root.to_str()?);
    let mut config = Config::default();
    config.global.prefix = FileName::new(prefix.as_bytes()).ok()?;
    config.global.set_root_path(&iceoryx2::prelude::Path::new(folder.as_bytes()).ok()?);
    Some(config)
}

fn default_root(number: u32, runtime: Option<&Path>, user: u32) -> PathBuf {
    match runtime {
        Some(folder) if folder.is_absolute() && folder.is_dir() => folder.join(format!("foretrace-{number}")),
        _ => PathBuf::from(format!("/tmp/foretrace-{user}-{number}")),
    }
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
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    fn scratch() -> (tempfile::TempDir, Instance) {
        let folder = tempfile::tempdir().unwrap();
        let instance = Instance::at(3, folder.path().join("i")).unwrap();
        (folder, instance)
    }

    #[test]
    fn the_root_follows_the_runtime_directory_and_falls_back_to_tmp() {
        assert_eq!(default_root(2, Some(Path::new("/tmp")), 7), Path::new("/tmp/foretrace-2"));
        assert_eq!(default_root(2, Some(Path::new("/no/such/folder")), 7), Path::new("/tmp/foretrace-7-2"));
        assert_eq!(default_root(0, None, 1000), Path::new("/tmp/foretrace-1000-0"));
    }

    #[test]
    fn two_roots_or_two_numbers_never_share_a_prefix() {
        let a = Instance::at(0, "/tmp/a").unwrap();
        assert_ne!(a.prefix(), Instance::at(0, "/tmp/b").unwrap().prefix());
        assert_ne!(a.prefix(), Instance::at(1, "/tmp/a").unwrap().prefix());
        assert!(a.prefix().starts_with("ft0v"), "{}", a.prefix());
    }

    #[test]
    fn a_root_without_room_for_sockets_is_refused_with_its_length() {
        let root = format!("/tmp/{}", "x".repeat(60));
        let error = Instance::at(0, &root).unwrap_err();
        assert!(matches!(error, InstanceError::RootTooLong { length: 65, .. }), "{error}");
        assert!(matches!(Instance::at(0, "relative"), Err(InstanceError::RootNotPlain { .. })));
    }

    #[test]
    fn the_longest_root_still_fits_a_socket_address() {
        let longest =
            (1..100).map(|n| format!("/{}", "x".repeat(n))).rfind(|root| Instance::at(0, root).is_ok());
        let instance = Instance::at(0, longest.unwrap()).unwrap();
        let socket =
            format!("{}{}{}.event", instance.config().global.root_path(), instance.prefix(), u128::MAX);
        assert!(socket.len() < SOCKET_PATH_BYTES, "{}", socket.len());
    }

    #[test]
    fn a_directory_open_to_others_or_not_a_directory_is_refused() {
        let (_folder, instance) = scratch();
        fs::create_dir(instance.root()).unwrap();
        fs::set_permissions(instance.root(), fs::Permissions::from_mode(0o750)).unwrap();
        assert!(matches!(instance.lock(), Err(InstanceError::TooOpen { mode: 0o750, .. })));
        fs::remove_dir(instance.root()).unwrap();
        fs::write(instance.root(), "").unwrap();
        assert!(matches!(instance.lock(), Err(InstanceError::NotADirectory { .. })));
        fs::remove_file(instance.root()).unwrap();
        std::os::unix::fs::symlink("/tmp", instance.root()).unwrap();
        assert!(matches!(instance.lock(), Err(InstanceError::NotADirectory { .. })));
    }

    #[test]
    fn a_directory_of_another_user_is_refused() {
        // As root the own directories of others are at hand; otherwise root's are.
        let instance = Instance::at(0, "/proc/1").unwrap();
        let owner = fs::metadata("/proc/1").unwrap().uid();
        if owner == crate::effective_user() {
            let (_folder, instance) = scratch();
            instance.lock().unwrap();
            std::os::unix::fs::chown(instance.root(), Some(65534), None).unwrap();
            assert!(matches!(instance.lock(), Err(InstanceError::ForeignOwner { owner: 65534, .. })));
        } else {
            assert!(matches!(instance.check_root(), Err(InstanceError::ForeignOwner { .. })));
        }
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
