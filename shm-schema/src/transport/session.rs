//! Joining an instance, and everything that can go wrong with its services.
//!
//! Contract: every error names what was found, what is needed and what to do. Nothing of the middleware's own
//! messages reaches the user's screen.

use std::path::PathBuf;

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::prelude::{LogLevel, Node, NodeBuilder, NodeName, SignalHandlingMode, ipc, set_log_level};

use crate::instance::occupancy::InstanceLock;
use crate::instance::root::{Instance, InstanceError};

/// Why a service could not be created, opened or used.
#[derive(thiserror::Error)]
pub enum ServiceError {
    /// Nobody to talk to.
    #[error(
        "no daemon running for instance {number} (looked in {}): {}",
        root.display(), remedy(*number, *foreign)
    )]
    NoDaemon {
        /// Number of the instance.
        number: u32,
        /// Where it was looked for.
        root: PathBuf,
        /// Another user who seems to run one under this number.
        foreign: Option<u32>,
    },
    /// The other side was built from other message definitions.
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
    /// The other side was built with other limits.
    #[error(
        "{service}: the running peers have {what} {found}, we need exactly {expected}: \
         use programs of one version of foretrace on all sides"
    )]
    DifferentQos {
        /// Name of the service.
        service: &'static str,
        /// Which setting.
        what: &'static str,
        /// Theirs.
        found: String,
        /// Ours.
        expected: usize,
    },
    /// All places are taken.
    #[error("{service}: all {limit} places for {what} are taken: end one of them")]
    NoPlace {
        /// Name of the service.
        service: &'static str,
        /// Of which kind.
        what: &'static str,
        /// How many there are.
        limit: usize,
    },
    /// Everybody who may ask at a time is asking.
    #[error(
        "all {limit} places for operators are taken, by processes {pids:?}: end those that hang (`kill -9`); \
         a stop needs \
         no place (`foretrace request stop`)"
    )]
    NoOperatorPlace {
        /// How many there are.
        limit: usize,
        /// Who holds them, one for each.
        pids: Vec<u32>,
    },
    /// A subscriber may not ask for this.
    #[error("{service}: a buffer of {asked} messages was asked for, 1 to {limit} are possible")]
    BufferSize {
        /// Name of the service.
        service: &'static str,
        /// What was asked for.
        asked: usize,
        /// The largest possible.
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
        /// Where they are.
        root: PathBuf,
    },
    /// The system refuses access.
    #[error("{service}: no permission to use the shared memory: run as the same user as the daemon")]
    Permission {
        /// Name of the service.
        service: &'static str,
    },
    /// The first touch of a page that is not there would kill the process without a word.
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
    /// The instance itself cannot be used.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// Anything else.
    #[error("{service}: the middleware failed: {detail}")]
    Middleware {
        /// Name of the service.
        service: &'static str,
        /// What it said.
        detail: String,
    },
}

crate::debug_is_sentence!(ServiceError);

impl ServiceError {
    /// Nobody runs `instance`; looks whether another user does.
    #[must_use]
    pub fn no_daemon(instance: &Instance) -> Self {
        Self::NoDaemon {
            number: instance.number(),
            root: instance.root().to_path_buf(),
            foreign: instance.foreign_owner(),
        }
    }
}

/// What to do where no daemon runs.
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

/// Upper bound of the shared memory that one more peer takes, the daemon's ends of its connections included.
pub const PEER_MEMORY_LIMIT_BYTES: u64 = 1 << 20;

/// A process's membership in an instance. May be sent to other threads; ports may not.
#[derive(Debug)]
pub struct Session {
    instance: Instance,
    pub(crate) node: Node<ipc::Service>,
}

impl Session {
    /// Join as the daemon, which holds the lock and has purged.
    ///
    /// # Errors
    ///
    /// `Permission`, `Middleware`, `Instance`.
    pub fn create(instance: &Instance, name: &str, _lock: &InstanceLock) -> Result<Self, ServiceError> {
        Self::join(instance, name)
    }

    /// Join an instance whose daemon is up; leaves no trace if there is none.
    ///
    /// # Errors
    ///
    /// `NoDaemon`, `NoSpace`, `Permission`, `Middleware`, `Instance`.
    pub fn open(instance: &Instance, name: &str) -> Result<Self, ServiceError> {
        let no_daemon = || ServiceError::no_daemon(instance);
        match instance.check_root() {
            Err(InstanceError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
                return Err(no_daemon());
            }
            checked => checked?,
        }
        instance.daemon().ok_or_else(no_daemon)?;
        match crate::os::shared_memory_free_bytes() {
            Some(free) if free < PEER_MEMORY_LIMIT_BYTES => {
                Err(ServiceError::NoSpace { free, needed: PEER_MEMORY_LIMIT_BYTES })
            }
            _ => Self::join(instance, name),
        }
    }

    /// The instance joined.
    pub fn instance(&self) -> &Instance {
        &self.instance
    }

    fn join(instance: &Instance, name: &str) -> Result<Self, ServiceError> {
        // Its messages mean nothing to our users; every failure comes back as an error that does.
        set_log_level(LogLevel::Fatal);
        let failed = |detail: String| ServiceError::Middleware { service: "foretrace", detail };
        let node = NodeBuilder::new()
            .name(&NodeName::new(name).map_err(|error| failed(error.to_string()))?)
            .config(instance.config())
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
