//! The real-time daemon of foretrace: one real-time thread, a learner, an ipc thread and a supervisor.
//!
//! [`run`] does everything; `foretraced` and `foretrace daemon` are thin shells around it. In the order of a
//! message's way: [`wire`] converts it to the law's types, [`ports`] receive and send, [`rt`] is the loop
//! around the pure follower, [`learner`] improves its weights, [`ipc`] serves telemetry and requests,
//! [`supervisor`] starts and ends everything. Each of these modules uses only those before it.
//!
//! `unsafe` is in two files: `rt/os.rs` (system calls) and `alloc_count.rs` (the counting allocator).

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod alloc_count;
pub mod wire;
pub mod ports;
pub mod rt;
pub mod learner;
pub mod ipc;
pub mod limits;
pub mod memory;
pub mod options;
pub mod error;
pub mod law_rehearsal;
pub mod reload;
pub mod stop_socket;
pub mod supervisor;
mod log;

pub use error::DaemonError;
pub use log::LogGuard;
pub use options::{Base, DaemonArgs, Options, Reading, Rights, Source, StopHandle};
pub use supervisor::{ExitReport, run, settings_hash};

// The test support is shared with integration tests, which name this crate.
#[cfg(test)]
extern crate self as foretraced;
#[cfg(test)]
#[path = "../tests/support/mod.rs"]
mod support;
#[cfg(test)]
mod testing;

/// Build of the control law in this program, as 16 hexadecimal digits: programs with the same one give the
/// same commands, bit for bit, on the same kind of processor. See `daemon/build.rs`.
pub const LAW_BUILD: &str = env!("FORETRACE_LAW");

/// Why there is no log.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LogError {
    /// The filter cannot be read: the command line is wrong.
    #[error("{0}")]
    Filter(String),
    /// The system refuses, or a log is already set up.
    #[error("{0}")]
    Start(String),
}

/// Sends the daemon's log to stderr, with the last messages written when the guard is dropped; `filter` as in
/// `RUST_LOG`, for example `info` or `foretraced=debug`. No thread of the daemon waits for the reader.
///
/// # Errors
/// The filter cannot be read, a log is set up already, or the system starts no thread.
pub fn log_to_stderr(filter: &str) -> Result<LogGuard, LogError> {
    let filter = tracing_subscriber::EnvFilter::try_new(filter).map_err(|error| {
        LogError::Filter(format!("--log {filter}: {error}; try error, warn, info, debug"))
    })?;
    let (messages, guard) = log::Messages::to(std::io::stderr()).map_err(|error| {
        LogError::Start(format!(
            "no thread for the log can be started: {error}; \
             raise the limits of processes and memory (ulimit -u, -v)"
        ))
    })?;
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(messages)
        .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
        .with_target(false)
        .try_init()
        .map_err(|error| LogError::Start(error.to_string()))?;
    Ok(guard)
}
