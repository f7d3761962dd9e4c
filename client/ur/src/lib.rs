//! Universal Robots arms: what a controller speaks, and the bridge between it and foretrace.
//!
//! Rooms, in order: `rtde` (packages, fields, client), `primary` (packages of ports 30001 and 30002),
//! `dashboard` (port 29999), `series`, `bridge` (foretrace to a controller and back). Std threads and
//! sockets. Everything a socket brings is untrusted. A simulated controller is in `foretrace-ur-sim`.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod rtde;
pub mod primary;
pub mod dashboard;
pub mod series;
pub mod bridge;

#[cfg(test)]
mod fuzz;
