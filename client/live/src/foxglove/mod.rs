//! A WebSocket server for Foxglove, Lichtblick and whoever speaks their protocol: the topics of a recording,
//! live, with parameters and services.
//!
//! Contract: what a viewer sends is judged before anything is done with it: host and origin, subprotocol,
//! size, form. Without the token a viewer can watch and stop, and set and arm nothing. Connections, memory
//! and every wait are bounded; a viewer that reads slowly loses messages and holds up nobody. Plain threads.
//!
//! In the order of a message's way: `guard` lets a viewer in, `protocol` reads what it says, `hub` is what
//! all share, `orders` stops the arm and asks the daemon, `viewer` is one of them, `settings` hears those in
//! force, `server` feeds them.

mod guard;
mod protocol;
mod hub;
mod orders;
mod viewer;
mod settings;
mod server;

pub use hub::ViewerTally;
pub use server::{FoxgloveError, FoxgloveOptions, Server};
