//! Leftovers of dead processes, for inspection and cleaning by hand; a daemon purges its own instance at
//! every start.
//!
//! Contract: inspection changes nothing. Cleaning never touches what a living process uses: with living peers
//! only dead nodes, by the middleware's attribution, are removed; without any, the whole instance is purged
//! under its lock. Damaged files can make the middleware hang (as root above all): callers bound the time.

use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use iceoryx2::node::NodeView;
use iceoryx2::prelude::{CallbackProgression, Node, NodeState, ipc};

use super::SHARED_MEMORY;
use super::occupancy::{Purge, SharedMemory};
use super::root::{Instance, InstanceError, MIDDLEWARE_FOLDER, usual_roots};

/// Living and dead peers of an instance.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Leftovers {
    /// Process numbers of living peers, ascending, once per node.
    pub alive: Vec<u32>,
    /// Process numbers of peers that died without leaving, ascending, once per node.
    pub dead: Vec<u32>,
    /// Nodes whose owner cannot be determined any more.
    pub damaged: usize,
    /// A daemon holds the lock, perhaps before it is a peer.
    pub held: bool,
    /// All segments of the instance.
    pub memory: SharedMemory,
}

/// What was removed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cleaned {
    /// Nodes of dead peers; a daemon has two.
    pub nodes: usize,
    /// Shared-memory files.
    pub segments: usize,
    /// Their total size.
    pub bytes: u64,
    /// Nodes that the middleware could not remove.
    pub failed: usize,
}

/// Files in a shared-memory folder that share a prefix of an instance.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Prefixed {
    /// The prefix.
    pub prefix: String,
    /// Number of the instance.
    pub number: u32,
    /// Number of files.
    pub segments: usize,
    /// Their total size.
    pub bytes: u64,
    /// Owner of the files; of the first one, if they differ.
    pub owner: u32,
}

impl Leftovers {
    /// A daemon or a peer lives here.
    pub fn in_use(&self) -> bool {
        self.held || !self.alive.is_empty()
    }

    /// There are no leftovers.
    pub fn is_empty(&self) -> bool {
        self.dead.is_empty() && self.damaged == 0 && (self.in_use() || self.memory.segments == 0)
    }
}

impl Instance {
    /// Visible instances of this user: those with a folder at a usual place, and those whose files in
    /// /dev/shm belong to one of `roots`. Changes nothing.
    pub fn in_sight(roots: &[PathBuf]) -> Vec<Self> {
        let mut found: Vec<Self> =
            usual_roots().into_iter().filter_map(|(number, root)| Self::at(number, root).ok()).collect();
        let prefixed = prefixed(Path::new(SHARED_MEMORY)).unwrap_or_default();
        let numbers: std::collections::BTreeSet<u32> = prefixed.iter().map(|group| group.number).collect();
        for root in roots {
            let here = numbers.iter().filter_map(|number| Self::at(*number, root).ok());
            found.extend(
                here.filter(|instance| prefixed.iter().any(|group| group.prefix == instance.prefix())),
            );
        }
        found.sort_by(|a, b| (a.number(), a.root()).cmp(&(b.number(), b.root())));
        found.dedup();
        found
    }

    /// Leftovers of dead processes in this instance.
    ///
    /// # Errors
    ///
    /// Those of [`Instance::check_root`] except that there is none, `PeersUnknown`, `Io`.
    pub fn leftovers(&self) -> Result<Leftovers, InstanceError> {
        let mut found = Leftovers { memory: self.shared_memory()?, ..Leftovers::default() };
        match self.check_root() {
            Ok(()) => {}
            Err(InstanceError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => {
                return Ok(found);
            }
            Err(error) => return Err(error),
        }
        found.held = self.is_held();
        (found.alive, found.dead, found.damaged) = self.nodes()?;
        Ok(found)
    }

    /// Process numbers of living and of dead peers, ascending, one per node, and the number of nodes of
    /// neither.
    ///
    /// # Errors
    ///
    /// `PeersUnknown`.
    pub(crate) fn nodes(&self) -> Result<(Vec<u32>, Vec<u32>, usize), InstanceError> {
        let (mut alive, mut dead, mut damaged) = (Vec::new(), Vec::new(), 0);
        if self.root().join(MIDDLEWARE_FOLDER).exists() {
            Node::<ipc::Service>::list(self.config(), |node| {
                match node {
                    NodeState::Alive(view) => alive.push(view.id().pid().value() as u32),
                    NodeState::Dead(view) => dead.push(view.id().pid().value() as u32),
                    NodeState::Inaccessible(_) | NodeState::Undefined(_) => damaged += 1,
                }
                CallbackProgression::Continue
            })
            .map_err(|error| InstanceError::PeersUnknown {
                number: self.number(),
                detail: error.to_string(),
            })?;
        }
        alive.sort_unstable();
        dead.sort_unstable();
        Ok((alive, dead, damaged))
    }

    /// Removes leftovers of dead processes, and nothing of living ones.
    ///
    /// # Errors
    ///
    /// Those of [`Instance::leftovers`]; `Held` if a daemon is starting at this moment.
    pub fn clean(&self) -> Result<Cleaned, InstanceError> {
        let before = self.leftovers()?;
        if before.is_empty() {
            return Ok(Cleaned::default());
        }
        if before.in_use() {
            let done = Node::<ipc::Service>::try_cleanup_dead_nodes(self.config());
            let after = self.shared_memory()?;
            return Ok(Cleaned {
                nodes: done.cleanups as usize,
                segments: before.memory.segments.saturating_sub(after.segments),
                bytes: before.memory.bytes.saturating_sub(after.bytes),
                failed: done.failed_cleanups as usize,
            });
        }
        let lock = self.lock()?;
        Ok(match self.purge(&lock)? {
            Purge::Removed(segments) => Cleaned {
                nodes: before.dead.len() + before.damaged,
                segments,
                bytes: before.memory.bytes,
                failed: 0,
            },
            Purge::PeersAlive(_) => Cleaned::default(),
        })
    }

    fn is_held(&self) -> bool {
        let lock = File::open(self.root().join("lock"));
        lock.is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
    }
}

/// Every prefix of an instance among the files of `folder`, of any middleware version, in order.
///
/// # Errors
///
/// The folder cannot be read.
pub fn prefixed(folder: &Path) -> io::Result<Vec<Prefixed>> {
    let mut groups: BTreeMap<String, Prefixed> = BTreeMap::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let Some((prefix, number)) = name.to_str().and_then(prefix_of) else { continue };
        // Its process may remove it between the two calls.
        let Ok(about) = entry.metadata() else { continue };
        let group = groups.entry(prefix.to_owned()).or_insert_with(|| Prefixed {
            prefix: prefix.to_owned(),
            number,
            segments: 0,
            bytes: 0,
            owner: about.uid(),
        });
        group.segments += 1;
        group.bytes += about.size();
    }
    Ok(groups.into_values().collect())
}

/// `ft<number>v<version>_<8 hex digits>_` at the beginning of `name`, and the number.
fn prefix_of(name: &str) -> Option<(&str, u32)> {
    let (number, rest) = name.strip_prefix("ft")?.split_once('v')?;
    let mut parts = rest.splitn(3, '_');
    let (version, hash) = (parts.next()?, parts.next()?);
    parts.next()?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let hex = hash.len() == 8 && hash.bytes().all(|byte| byte.is_ascii_hexdigit());
    if !(digits(number) && digits(version) && hex) {
        return None;
    }
    let length = "ft".len() + number.len() + "v".len() + version.len() + "_".len() + hash.len() + "_".len();
    Some((name.get(..length)?, number.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scratch(number: u32) -> (tempfile::TempDir, Instance) {
        let folder = tempfile::tempdir_in("/tmp").unwrap();
        let instance = Instance::at(number, folder.path().join("i")).unwrap();
        (folder, instance)
    }

    fn segment(instance: &Instance) -> PathBuf {
        PathBuf::from(format!("{SHARED_MEMORY}/{}x.data", instance.prefix()))
    }

    #[test]
    fn prefixes_are_recognised_and_foreign_names_are_not() {
        let (_folder, instance) = scratch(12);
        let name = format!("{}5f.dynamic", instance.prefix());
        assert_eq!(prefix_of(&name), Some((instance.prefix(), 12)));
        for name in
            ["ft", "ftv_", "ft1v093", "ft1v093_0000000_x", "ft1v093_0000000g_x", "ft1v093_00000000", "sem.x"]
        {
            assert_eq!(prefix_of(name), None, "{name}");
        }
        assert_eq!(prefix_of("ft99999999999v093_00000000_x"), None);
    }

    #[test]
    fn segments_without_a_living_peer_are_leftovers_and_cleaning_removes_them_only() {
        let (_folder, instance) = scratch(5);
        let (_other_folder, other) = scratch(5);
        assert!(instance.leftovers().unwrap().is_empty());
        assert_eq!(instance.clean().unwrap(), Cleaned::default());
        assert!(!instance.root().exists(), "looking must not make folders");
        fs::write(segment(&instance), [0; 3000]).unwrap();
        fs::write(segment(&other), [0; 10]).unwrap();
        let found = instance.leftovers().unwrap();
        assert!(!found.is_empty() && !found.in_use());
        assert_eq!((found.memory.segments, found.memory.bytes), (1, 3000));
        let seen = Instance::in_sight(&[instance.root().to_path_buf()]);
        assert!(seen.contains(&instance) && !seen.contains(&other));
        assert_eq!(instance.clean().unwrap(), Cleaned { nodes: 0, segments: 1, bytes: 3000, failed: 0 });
        assert!(instance.leftovers().unwrap().is_empty() && segment(&other).exists());
        fs::remove_file(segment(&other)).unwrap();
    }

    #[test]
    fn an_instance_whose_lock_is_held_is_in_use_and_keeps_everything() {
        let (_folder, instance) = scratch(6);
        let lock = instance.lock().unwrap();
        fs::write(segment(&instance), [0; 10]).unwrap();
        let found = instance.leftovers().unwrap();
        assert!(found.in_use() && found.held && found.is_empty());
        assert_eq!(instance.clean().unwrap(), Cleaned::default());
        assert!(segment(&instance).exists());
        drop(lock);
        assert_eq!(instance.clean().unwrap().segments, 1);
    }

    #[test]
    fn a_root_of_another_kind_is_refused() {
        let (_folder, instance) = scratch(7);
        fs::write(instance.root(), "").unwrap();
        assert!(matches!(instance.leftovers(), Err(InstanceError::NotADirectory { .. })));
        assert!(matches!(instance.clean(), Err(InstanceError::NotADirectory { .. })));
    }
}
