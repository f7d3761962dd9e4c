//! What every server of foretrace shares: limits per peer, request heads, guards, messages, admission.
//!
//! Contract: every wait and every buffer is bounded, whatever a peer sends and however slowly. Plain threads.
//! Each server keeps its own accept loop and its own messages; what a stranger may do to it is decided here.
//!
//! In the order of a connection: `peers` (may it have a slot), `metered` (bytes per second), `http` (the
//! head of its request, answers), `guard` (hosts, origins, tokens), `websocket` or `frames` (messages),
//! `admission` (pen samples).

#![forbid(unsafe_code)]

pub mod peers;
pub mod metered;
pub mod http;
pub mod guard;
pub mod websocket;
pub mod frames;
pub mod admission;

pub use foretrace_shm::debug_as_display;
