//! What is said of a running daemon, and of a run that has ended: as text, as JSON, as a page.
//!
//! Contract: pure but for [`status::Holders`], which reads the instance's folder, and [`run`], which reads
//! the records of a run and writes its report. Keys of JSON are stable.
//!
//! In order: `failures` (errors of the client library), `extent` (where the tool was), `ghost` (what the
//! prediction saves), `stopped` (why, and what to do), `status` (a daemon now), `run` (a run of the demo).

#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod failures;
pub mod extent;
pub mod ghost;
pub mod stopped;
pub mod status;
pub mod run;

/// Takes lines for people.
pub type Tell<'a> = &'a dyn Fn(&str);
