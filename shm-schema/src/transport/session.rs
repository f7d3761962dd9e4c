//! Joining an instance, and all errors of its services.
//!
//! Contract: every error names what was found, what is needed and the remedy. The middleware's own messages
//! never reach the user.

use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::node::NodeCreationFailure;
use iceoryx2::prelude::{LogLevel, Node, NodeBuilder, NodeName, SignalHandlingMode, ipc, set_log_level};

use crate::instance::occupancy::{DaemonMark, InstanceLock};
use crate::instance::place::PlaceError;
use crate::instance::root::{Instance, InstanceError};

/// Why a service could not be created, opened or used.
#[derive(thiserror::Error)]
pub enum ServiceError {
    /// No daemon is running.
    #[error(
        "no daemon running for instance {number} (looked in {}): {}",
        root.display(), remedy(*number, *foreign)
    )]
    NoDaemon {
        /// Number of the instance.
        number: u32,
        /// Directory searched.
        root: PathBuf,
        /// Another user who seems to run a daemon under this number.
        foreign: Option<u32>,
    },
    /// The other side was built from different message definitions.
    #[error(
        "{service}: the running peers use another layout of {type_name} (theirs {theirs}, ours {ours:016x}): \
         use programs of one version of foretrace on all sides"
    )]
    WrongLayout {
        /// Name of the service.
        service: &'static str,
        /// Our type.
        type_name: &'static str,
        /// Their layout hash, or what is known of it.
        theirs: String,
        /// Our layout hash.
        ours: u64,
    },
    /// The other side was built with different limits.
    #[error(
        "{service}: the running peers have {what} {found}, we need exactly {expected}: \
         use programs of one version of foretrace on all sides"
    )]
    DifferentQos {
        /// Name of the service.
        service: &'static str,
        /// The setting.
        what: &'static str,
        /// Their value.
        found: String,
        /// Our value.
        expected: usize,
    },
    /// All slots are taken.
    #[error("{service}: {} in use{}: end one of them", slots(*limit, what), by(pids))]
    NoSlot {
        /// Name of the service.
        service: &'static str,
        /// Kind of slot.
        what: &'static str,
        /// Number of slots.
        limit: usize,
        /// Processes that hold them, once per slot, where they are known.
        pids: Vec<u32>,
    },
    /// All slots for operators are taken.
    #[error(
        "all {limit} operator slots are in use, by processes {pids:?}: end those that hang (`kill -9`); \
         a stop needs \
         no place (`foretrace request stop`)"
    )]
    NoOperatorSlot {
        /// Number of slots.
        limit: usize,
        /// Processes that hold them, once per slot.
        pids: Vec<u32>,
    },
    /// The buffer asked for is out of range.
    #[error("{service}: a buffer of {asked} messages was asked for, 1 to {limit} are possible")]
    BufferSize {
        /// Name of the service.
        service: &'static str,
        /// Size asked for.
        asked: usize,
        /// Largest size.
        limit: usize,
    },
    /// Files of the service are damaged.
    #[error(
        "{service}: its files in {} are damaged: end all programs of this instance, then start the daemon, \
         which removes them", root.display()
    )]
    Damaged {
        /// Name of the service.
        service: &'static str,
        /// Their location.
        root: PathBuf,
    },
    /// Files that the middleware would wait for until they grow. Their creator was killed while it made them,
    /// or somebody has cut them.
    #[error(
        "attaching would hang: {} of this instance in /dev/shm {} empty: remove {} (`rm {}`), or end all \
         programs of the instance and start its daemon",
        if files.len() == 1 { "a file" } else { "files" }, if files.len() == 1 { "is" } else { "are" },
        if files.len() == 1 { "it" } else { "them" }, listed(files)
    )]
    Empty {
        /// The files.
        files: Vec<PathBuf>,
    },
    /// The middleware did not come back.
    #[error(
        "attaching hangs: the middleware has not answered for {} ms: files of the instance in /dev/shm or {} \
         are damaged: end all programs of the instance, then start its daemon, which removes them",
        waited.as_millis(), root.display()
    )]
    Hangs {
        /// How long it was waited for.
        waited: Duration,
        /// Root of the instance.
        root: PathBuf,
    },
    /// The system refuses access.
    #[error("{service}: no permission to use the shared memory: run as the same user as the daemon")]
    Permission {
        /// Name of the service.
        service: &'static str,
    },
    /// Too little shared memory: the first touch of a missing page would kill the process without a message.
    #[error(
        "/dev/shm has {} KiB free, a program that attaches needs up to {} KiB: remove files there, or give \
         the container \
         more (docker run --shm-size=64m)", free / 1024, needed / 1024
    )]
    NoSpace {
        /// Free \[bytes\].
        free: u64,
        /// Needed \[bytes\].
        needed: u64,
    },
    /// Somebody holds the only place.
    #[error(transparent)]
    Place(#[from] PlaceError),
    /// The instance itself cannot be used.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// Another error.
    #[error("{service}: the middleware failed: {detail}")]
    Middleware {
        /// Name of the service.
        service: &'static str,
        /// The middleware's error.
        detail: String,
    },
}

crate::debug_as_display!(ServiceError);

impl ServiceError {
    /// No daemon runs in `instance`; checks whether another user runs one.
    #[must_use]
    pub fn no_daemon(instance: &Instance) -> Self {
        Self::NoDaemon {
            number: instance.number(),
            root: instance.root().to_path_buf(),
            foreign: instance.foreign_owner(),
        }
    }
}

/// The first of some files, for a shell.
fn listed(files: &[PathBuf]) -> String {
    files.iter().take(3).map(|file| file.display().to_string()).collect::<Vec<_>>().join(" ")
}

/// All slots of a kind, with their verb.
fn slots(limit: usize, what: &str) -> String {
    if limit == 1 { format!("the only {what} slot is") } else { format!("all {limit} {what} slots are") }
}

/// Who holds the slots, if that is known.
fn by(pids: &[u32]) -> String {
    let names: Vec<String> = pids.iter().map(|pid| program(*pid)).collect();
    if names.is_empty() { String::new() } else { format!(", by {}", names.join(", ")) }
}

/// The program of a process and its first word, which says what one of ours does: `foretrace metrics`
/// (process 812).
fn program(pid: u32) -> String {
    let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let words: Vec<String> = line.split(|byte| *byte == 0).take(2).map(shown).collect();
    let name = words.first().map_or("", |first| first.rsplit('/').next().unwrap_or(first));
    let verb = words.get(1).map(String::as_str).filter(|word| !word.is_empty() && !word.starts_with('-'));
    match (name, verb) {
        ("", _) => format!("process {pid}"),
        (name, None) => format!("`{name}` (process {pid})"),
        (name, Some(verb)) => format!("`{name} {verb}` (process {pid})"),
    }
}

/// At most 200 characters of a foreign word, without those that would do something to a terminal.
fn shown(word: &[u8]) -> String {
    String::from_utf8_lossy(word).chars().map(|c| if c.is_control() { '?' } else { c }).take(200).collect()
}

/// Remedy if no daemon runs.
fn remedy(number: u32, foreign: Option<u32>) -> String {
    let option = if number == 0 { String::new() } else { format!(" --instance {number}") };
    match foreign {
        None => format!("start it with `foretrace daemon{option}`"),
        Some(user) => format!(
            "user {user} seems to run one, whose shared memory is that user's alone: run as that user, send \
             the pen \
             through that user's `foretrace gateway`, or start your own with `foretrace daemon{option}`"
        ),
    }
}

/// Upper bound of the shared memory of one more peer, including the daemon's ends of its connections.
pub const PEER_MEMORY_LIMIT_BYTES: u64 = 1 << 20;

/// A process's membership in an instance. May be sent to other threads; ports may not.
#[derive(Debug)]
pub struct Session {
    instance: Instance,
    pub(crate) node: Node<ipc::Service>,
}

impl Session {
    /// Joins as the daemon, which holds the lock and has purged.
    ///
    /// # Errors
    ///
    /// `Permission`, `Middleware`, `Instance`.
    pub fn create(instance: &Instance, name: &str, _lock: &InstanceLock) -> Result<Self, ServiceError> {
        Self::join(instance, instance.config(), name)
    }

    /// Joins an instance whose daemon is up; leaves no trace if there is none.
    ///
    /// # Errors
    ///
    /// `NoDaemon`, `NoSpace`, `Permission`, `Middleware`, `Instance`.
    pub fn open(instance: &Instance, name: &str) -> Result<Self, ServiceError> {
        Self::daemon_of(instance)?;
        match crate::os::shared_memory_free_bytes() {
            Some(free) if free < PEER_MEMORY_LIMIT_BYTES => {
                Err(ServiceError::NoSpace { free, needed: PEER_MEMORY_LIMIT_BYTES })
            }
            _ => {
                // Who leaves need not clean up after others, which damaged files can make hang: whoever comes
                // next does it, and the last one removes everything (`Instance::tidy_up`).
                let mut config = instance.config().clone();
                config.global.node.cleanup_dead_nodes_on_destruction = false;
                Self::join(instance, &config, name)
            }
        }
    }

    /// The daemon of `instance`; asks nothing of the middleware, which damaged files can make hang.
    ///
    /// # Errors
    ///
    /// `NoDaemon`, `Instance`.
    pub fn daemon_of(instance: &Instance) -> Result<DaemonMark, ServiceError> {
        let no_daemon = || ServiceError::no_daemon(instance);
        match instance.check_root() {
            Err(InstanceError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
                return Err(no_daemon());
            }
            checked => checked?,
        }
        instance.daemon().ok_or_else(no_daemon)
    }

    /// The instance joined.
    pub fn instance(&self) -> &Instance {
        &self.instance
    }

    fn join(instance: &Instance, config: &Config, name: &str) -> Result<Self, ServiceError> {
        // Its messages mean nothing to our users; every failure is returned as an error that does.
        set_log_level(LogLevel::Fatal);
        let failed = |detail: String| ServiceError::Middleware { service: "foretrace", detail };
        let node = NodeBuilder::new()
            .name(&NodeName::new(name).map_err(|error| failed(error.to_string()))?)
            .config(config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|error| match error {
                NodeCreationFailure::InsufficientPermissions => {
                    ServiceError::Permission { service: "foretrace" }
                }
                other => failed(other.to_string()),
            })?;
        Ok(Self { instance: instance.clone(), node })
    }

    pub(crate) fn no_daemon(&self) -> ServiceError {
        ServiceError::no_daemon(&self.instance)
    }

    pub(crate) fn damaged(&self, service: &'static str) -> ServiceError {
        ServiceError::Damaged { service, root: self.instance.root().to_path_buf() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::check::Rejection;
    use crate::wire::vocabulary::RejectReason;

    #[test]
    fn holders_of_slots_are_named() {
        let holders = by(&[std::process::id(), u32::MAX]);
        let (here, gone) = holders.split_once("), ").unwrap();
        assert!(
            here.starts_with(", by `") && here.ends_with(&format!("(process {}", std::process::id())),
            "{holders}"
        );
        assert_eq!(gone, format!("process {}", u32::MAX));
        assert_eq!(shown(b"a\x1b[2Jb"), "a?[2Jb");
    }

    #[test]
    fn what_main_prints_is_a_sentence_with_a_remedy() {
        let root = std::path::PathBuf::from("/tmp/foretrace-0-3");
        let errors: [Box<dyn std::error::Error>; 3] = [
            Box::new(ServiceError::NoDaemon { number: 3, root: root.clone(), foreign: None }),
            Box::new(ServiceError::from(InstanceError::NotADirectory { root })),
            Box::new(Rejection::new(RejectReason::NotFinite, "q").because(f64::NAN, 1.0)),
        ];
        for (error, words) in
            errors.iter().zip(["start it with `foretrace daemon", "remove it or", "must be a finite"])
        {
            let printed = format!("{error:?}");
            assert!(printed.contains(words) && !printed.contains('{'), "{printed}");
        }
    }

    #[test]
    fn daemon_of_another_user_is_recognised_and_the_gateway_named() {
        let root = std::path::PathBuf::from("/tmp/foretrace-0-0");
        let error = ServiceError::NoDaemon { number: 0, root, foreign: Some(1001) };
        let words = error.to_string();
        assert!(words.contains("user 1001") && words.contains("foretrace gateway"), "{words}");
    }
}
