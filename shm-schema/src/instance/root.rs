//! An instance: one daemon and its peers, identified by a number. Its files, and who may use them.
//!
//! Contract: the root directory belongs to this user alone (0700) or nothing is opened. Every name in
//! /dev/shm begins with a prefix of the number, the middleware's version and the root, so that leftovers of
//! one instance can be removed without affecting another. The trust boundary is the Unix user.

use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

use iceoryx2::prelude::{Config, FileName, SemanticString};

use crate::wire::layout::fnv1a;

/// Bytes a Unix socket address can hold, its final zero included. Source: unix(7).
const SOCKET_PATH_BYTES: usize = 108;
/// The longest name the middleware may append to root and prefix for a socket: a 128-bit number and `.event`.
const SOCKET_NAME_BYTES: usize = 39 + 6;
/// Peers of different middleware versions are kept apart: their files are incompatible both ways.
const MIDDLEWARE_VERSION: &str = "093";
/// The longest root directory of an instance with a number below 100 \[bytes\].
pub const LONGEST_ROOT_BYTES: usize = 38;
/// Below the instance's root; removed by a purge, unlike the lock beside it.
pub(crate) const MIDDLEWARE_FOLDER: &str = "iox2";

/// One instance: its number, root directory and prefix.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Instance {
    number: u32,
    root: PathBuf,
    prefix: String,
    config: Config,
}

/// Why an instance cannot be used.
#[derive(thiserror::Error)]
pub enum InstanceError {
    /// The path leaves no room for socket names.
    #[error(
        "the instance directory {} has {length} bytes, at most {limit} leave room for socket names: \
         name a shorter one (`--root DIR`, instance.root_dir, or XDG_RUNTIME_DIR)", root.display()
    )]
    RootTooLong {
        /// The directory.
        root: PathBuf,
        /// Its length in bytes.
        length: usize,
        /// The longest allowed.
        limit: usize,
    },
    /// The path has characters that the middleware does not accept.
    #[error("the instance directory {} is not an absolute path of plain characters", root.display())]
    RootNotPlain {
        /// The directory.
        root: PathBuf,
    },
    /// The name is taken by something else.
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
        /// The owner.
        owner: u32,
        /// This user.
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
    /// Another user owns or may access a segment with a name of this instance.
    #[error(
        "{} belongs to user {owner} (mode {mode:03o}) but has a name of this instance of user {user}: \
         ask that user or root to remove it, or choose another instance number", path.display()
    )]
    ForeignSegment {
        /// The segment.
        path: PathBuf,
        /// The owner.
        owner: u32,
        /// Its permission bits.
        mode: u32,
        /// The user of the instance.
        user: u32,
    },
    /// Another daemon runs in it.
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
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The middleware could not list the peers.
    #[error("the peers of instance {number} cannot be listed: {detail}")]
    PeersUnknown {
        /// Number of the instance.
        number: u32,
        /// The middleware's error.
        detail: String,
    },
}

crate::debug_as_display!(InstanceError);

impl Instance {
    /// The instance of this user with this number: `$XDG_RUNTIME_DIR/foretrace-N`, else
    /// `/tmp/foretrace-UID-N`.
    ///
    /// # Errors
    ///
    /// `RootTooLong`, `RootNotPlain`. Touches no file.
    pub fn new(number: u32) -> Result<Self, InstanceError> {
        let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
        Self::at(number, default_root(number, runtime.as_deref(), crate::os::effective_user()))
    }

    /// An instance whose files live in `root`; for tests and for runtime directories made by a service
    /// manager.
    ///
    /// # Errors
    ///
    /// `RootTooLong`, `RootNotPlain`. Touches no file.
    pub fn at(number: u32, root: impl Into<PathBuf>) -> Result<Self, InstanceError> {
        let root = root.into();
        let bytes = root.as_os_str().as_encoded_bytes();
        let prefix = format!("ft{number}v{MIDDLEWARE_VERSION}_{:08x}_", fnv1a(bytes) as u32);
        // Numbers above 99 have longer prefixes.
        let room = SOCKET_PATH_BYTES - 1 - SOCKET_NAME_BYTES - prefix.len() - MIDDLEWARE_FOLDER.len() - 2;
        let limit = room.min(LONGEST_ROOT_BYTES);
        if bytes.len() > limit {
            return Err(InstanceError::RootTooLong { length: bytes.len(), limit, root });
        }
        match middleware_config(&root, &prefix) {
            Some(config) if root.is_absolute() => Ok(Self { number, root, prefix, config }),
            _ => Err(InstanceError::RootNotPlain { root }),
        }
    }

    /// Number of the instance.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Directory of all its files outside /dev/shm.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Prefix of its names in /dev/shm.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// The middleware's settings; explicit, because its default look-up reads `./config/iceoryx2.toml`.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Another user whose instance of the same number has its directory beside this one's; `None` if none is
    /// visible: directories below `/run/user` are hidden from others.
    #[must_use]
    pub fn foreign_owner(&self) -> Option<u32> {
        let user = crate::os::effective_user();
        let end = format!("-{}", self.number);
        fs::read_dir("/tmp").ok()?.flatten().find_map(|entry| {
            let name = entry.file_name();
            let owner = name.to_str()?.strip_prefix("foretrace-")?.strip_suffix(&end)?.parse::<u32>().ok()?;
            let found = fs::symlink_metadata(entry.path()).ok()?;
            (owner != user && found.is_dir() && found.uid() == owner).then_some(owner)
        })
    }

    /// Checks that the root directory exists and belongs to this user alone.
    ///
    /// # Errors
    ///
    /// `NotADirectory`, `ForeignOwner`, `TooOpen`, `Io` (`NotFound` when there is none).
    pub fn check_root(&self) -> Result<(), InstanceError> {
        let io = |source| InstanceError::Io { path: self.root.clone(), source };
        let root = self.root.clone();
        // Not `metadata`: a symbolic link of another user must not redirect us.
        let found = fs::symlink_metadata(&root).map_err(io)?;
        let (owner, user, mode) = (found.uid(), crate::os::effective_user(), found.mode() & 0o777);
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

    pub(crate) fn make_root(&self) -> Result<(), InstanceError> {
        match DirBuilder::new().mode(0o700).create(&self.root) {
            Err(source) if source.kind() != io::ErrorKind::AlreadyExists => {
                Err(InstanceError::Io { path: self.root.clone(), source })
            }
            _ => self.check_root(),
        }
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

/// The roots of this user's instances at the usual places, whatever their numbers.
pub(crate) fn usual_roots() -> Vec<(u32, PathBuf)> {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    let user = crate::os::effective_user();
    let mut folders = vec![(PathBuf::from("/tmp"), format!("foretrace-{user}-"))];
    folders.extend(
        runtime.filter(|folder| folder.is_absolute()).map(|folder| (folder, "foretrace-".to_owned())),
    );
    let mut found = Vec::new();
    for (folder, beginning) in folders {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let number = name.to_str().and_then(|name| name.strip_prefix(&beginning)?.parse().ok());
            found.extend(number.map(|number| (number, entry.path())));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    fn scratch() -> (tempfile::TempDir, Instance) {
        let folder = tempfile::tempdir_in("/tmp").unwrap();
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
        for number in [0, 99] {
            let root = |bytes: usize| format!("/{}", "x".repeat(bytes - 1));
            let instance = Instance::at(number, root(LONGEST_ROOT_BYTES)).unwrap();
            let socket =
                format!("{}{}{}.event", instance.config().global.root_path(), instance.prefix(), u128::MAX);
            assert!(socket.len() < SOCKET_PATH_BYTES, "{}", socket.len());
            assert!(Instance::at(number, root(LONGEST_ROOT_BYTES + 1)).is_err());
        }
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
        // As root the directories of other users are available; otherwise root's are.
        let instance = Instance::at(0, "/proc/1").unwrap();
        let owner = fs::metadata("/proc/1").unwrap().uid();
        if owner == crate::os::effective_user() {
            let (_folder, instance) = scratch();
            instance.lock().unwrap();
            std::os::unix::fs::chown(instance.root(), Some(65534), None).unwrap();
            assert!(matches!(instance.lock(), Err(InstanceError::ForeignOwner { owner: 65534, .. })));
        } else {
            assert!(matches!(instance.check_root(), Err(InstanceError::ForeignOwner { .. })));
        }
    }
}
