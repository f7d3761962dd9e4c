//! Why a daemon did not start or did not end normally, each with its remedy.

use foretrace_config::ConfigError;
use foretrace_control::follower::FollowerError;
use foretrace_control::learn::LearnError;
use foretrace_shm::{InstanceError, ServiceError};

use crate::limits::TooLow;
use crate::memory::NoSpace;

/// Why a daemon did not start or did not end normally.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// The settings are wrong.
    #[error("{0}")]
    Config(#[from] ConfigError),
    /// The instance cannot be used, usually because another daemon has it.
    #[error("{0}")]
    Instance(#[from] InstanceError),
    /// The services cannot be created.
    #[error("{0}")]
    Service(#[from] ServiceError),
    /// /dev/shm is too small.
    #[error("{0}")]
    NoSpace(#[from] NoSpace),
    /// A limit of the process is too low.
    #[error("{0}")]
    TooLow(#[from] TooLow),
    /// The control law refuses the settings.
    #[error("{0}")]
    Follower(#[from] FollowerError),
    /// The learner refuses the settings.
    #[error("{0}")]
    Learner(#[from] LearnError),
    /// Opening shared memory hangs.
    #[error(
        "opening the shared memory of instance {number} takes longer than {seconds} s: end all programs of \
         this instance, \
         then remove /dev/shm/{prefix}* and {root}/iox2"
    )]
    Hangs {
        /// Time waited \[s\].
        seconds: u64,
        /// Number of the instance.
        number: u32,
        /// Prefix of its names.
        prefix: String,
        root: String,
    },
    /// The system refused something.
    #[error("{what}: {source}")]
    System {
        /// What the daemon tried to do.
        what: &'static str,
        source: std::io::Error,
    },
    /// A thread ended by a fault.
    #[error("the {name} thread ended by a fault ({cause}); consumers of commands brake by themselves")]
    ThreadDied {
        /// Name of the thread.
        name: &'static str,
        cause: String,
    },
    /// The arm did not come to rest in time, or the wait was cut short.
    #[error("the arm was not at rest after {seconds} s: it brakes by itself")]
    NotAtRest {
        /// Longest wait \[s\].
        seconds: u64,
    },
}
