//! The real-time daemon of foretrace: one real-time thread, a learner, an ipc thread and a supervisor.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod alloc_count;
pub mod rt;
pub mod ports;
pub mod learner;
