//! A simulated controller of Universal Robots, CB3 or e-Series, behind the ports of a real one.
//!
//! One thread is the control loop, at exactly 125 or 500 Hz by absolute deadlines; it takes one lock, never
//! waits for a socket, and skips packages, not cycles, when it is late. Each connection has a thread that
//! reads and one that writes, with bounded memory between them and the loop. Scripts are run by
//! [`crate::script`]. Absent: forces, dynamics, singularities, PolyScope's own programs, joint temperatures
//! that mean anything.
//!
//! What client and server share of RTDE, the primary interface and the dashboard is in `foretrace-ur`.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod script;
pub mod options;
pub mod pose;
pub mod kinematics;
pub mod branches;
pub mod inverse;
pub mod motion;
pub mod safety;
pub mod inputs;
mod current;
pub mod setup;
pub mod robot;
mod names;
mod sockets;
pub mod machine;
mod motion_calls;
mod io_calls;
mod setup_calls;
mod socket_calls;
pub mod arrival;
pub mod outbox;
pub mod statements;
pub mod world;
mod applied;
mod interpreter;
pub mod outputs;
pub mod rtde_server;
pub mod streams;
pub mod dashboard_server;
pub mod trouble;
pub mod faults;
pub mod network;
pub mod listen;
pub mod control;

pub use control::{Controller, StartError};
pub use options::{ControllerOptions, Series, Service};

pub mod echo;

#[cfg(test)]
#[path = "../../ur/src/tests/fuzz.rs"]
mod fuzz;
#[cfg(test)]
mod conversation_tests;
#[cfg(test)]
mod hostile_tests;
#[cfg(test)]
mod trouble_tests;
#[cfg(test)]
mod program_tests;
#[cfg(test)]
mod thread_tests;
#[cfg(test)]
mod socket_tests;
#[cfg(test)]
mod setup_tests;
#[cfg(test)]
mod recipe_tests;
#[cfg(test)]
mod interpreter_tests;
