//! What the servers of foretrace share: limits per peer, request heads, guards, messages, admission.
//!
//! Contract: every wait and every buffer is bounded, whatever a peer sends and however slowly. Plain threads.
//! Each server keeps its own accept loop and its own messages; what a stranger may do to it is decided here.
//!
//! In the order of a connection: `peers` (may it have a slot), `metered` (bytes per second), `http` (the
//! head of its request, answers), `guard` (hosts, origins, tokens), `websocket` or `frames` (messages),
//! `admission` (pen samples). Who uses what:
//!
//! | server | peers | metered | http | guard | websocket | frames | admission |
//! |---|---|---|---|---|---|---|---|
//! | console | x | x | x | x | x | | x |
//! | viewers (foxglove) | x | x | x | x | x | | |
//! | metrics | x | | x | | | | |
//! | relay | | | bounds only | | | x | |
//! | gateway (a Unix socket) | | | | | | x | x |
//!
//! Metrics takes no orders and has no guard: whoever reaches its port reads them.

#![forbid(unsafe_code)]

pub mod peers;
pub mod metered;
pub mod http;
pub mod guard;
pub mod websocket;
pub mod frames;
pub mod admission;

pub use foretrace_shm::debug_as_display;
