//! A gateway for pens: samples from programs of other users, which have no access to the shared memory.
//!
//! Contract: what comes over the socket is passed on only if the kernel names an allowed user, the frames are
//! well formed, and each sample is finite, in range, of this moment, later than the one before and within the
//! rate. Everything that is refused is counted by reason. One thread, bounded memory, every wait
//! bounded.
//!
//! In the order of a sample's way: `socket`, `serve` (with `holder`: who keeps the only slot), then
//! `foretrace_serve::admission`; `tally` counts. The protocol is `foretrace_shm::gateway`.

#![forbid(unsafe_code)]

mod holder;
mod socket;
mod tally;
mod serve;

pub use serve::{Delivery, Gateway, Policy};
pub use socket::GatewaySocket;
pub use tally::{GatewayTally, RefusalCounts, Samples};
