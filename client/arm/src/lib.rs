//! Arms as processes beside the daemon: the simulated one, and the bridge to Universal Robots.
//!
//! Contract: an arm outlives the daemon: without commands it brakes and stays, and follows again when a
//! daemon comes back. Every command is judged against the limits of the settings, taken or not.
//!
//! In order: `spin_watch` and `priority` (of the process), `ports` (to the daemon), `refused`, `judge` and
//! `intake` (commands), `agreement` (with the daemon's settings), `joint_log`, `report`, `guide` (an arm
//! moved by hand); `sim` and `ur` are the two arms.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod spin_watch;
pub mod priority;
mod ports;
mod refused;
mod judge;
mod intake;
mod agreement;
mod joint_log;
mod report;
pub mod guide;
pub mod sim;
pub mod ur;

pub use report::{ArmReport, CommandReport, DelayReport, SimReport, ViolationReport};
