//! Universal Robots arms: what a controller speaks, the bridge to foretrace, and a controller simulator.
//!
//! Rooms, in order: `rtde` (packages, fields, client), `primary` (packages of ports 30001 and 30002),
//! `dashboard` (port 29999), `echo` (what line and machine do to counters), `script` (an interpreter of
//! URScript), `bridge` (foretrace to a controller and back), `controller` (the simulator). Std threads and
//! sockets. Everything a socket brings is untrusted.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod rtde;
pub mod primary;
pub mod dashboard;
pub mod echo;
pub mod script;
pub mod bridge;
pub mod controller;

#[cfg(test)]
mod fuzz;
