//! What watches a running daemon: recorder, flight recorder, relay, metrics, a server for live viewers.
//!
//! Contract: whoever watches is a reader of shared memory like any other and cannot disturb the loop. What
//! had to be dropped is counted.
//!
//! Rooms, each of which uses only those before it: `source` (where everything comes from: shared memory, or a
//! relay), `relay` (one reader for any number of them), `recorder` (into files), `record_button` (by
//! a button, from another thread), `trace`, `flight` (the last
//! seconds, when something happens), `last_flight`, `stages`, `metrics`, `foxglove`.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod source;
mod news;
pub mod relay;
pub mod recorder;
pub mod record_button;
mod trace;
pub mod flight;
pub mod last_flight;
pub mod stages;
pub mod metrics;
pub mod foxglove;

use std::path::PathBuf;

use foretrace_record::RecordError;

/// Why a daemon cannot be watched.
#[derive(thiserror::Error)]
pub enum LiveError {
    /// A recording cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The daemon cannot be heard.
    #[error(transparent)]
    Service(#[from] foretrace_client::ServiceError),
    /// Others hold all slots.
    #[error("{error}{}", if *direct {
        ", then start the relay again: programs that begin after it listen to it"
    } else {
        "; or end one, start `foretrace relay` in its place, then them again: any number listen to a relay"
    })]
    NoPlace {
        /// Which places, and who holds them.
        error: foretrace_client::ServiceError,
        /// The relay itself asks.
        direct: bool,
    },
    /// There can be no relay.
    #[error("no relay at {}: {why}", path.display())]
    NoRelay {
        /// Its socket, or its lock.
        path: PathBuf,
        /// The reason, and the remedy.
        why: String,
    },
    /// The writing thread could not be started, or ended by a fault.
    #[error("the thread that writes the recording failed: {0}")]
    Thread(String),
}

foretrace_shm::debug_as_display!(LiveError);
