//! Everything of foretrace that crosses a process border: plain-old-data messages, the names and quality of
//! service under which they travel, and where an instance keeps its files.
//!
//! Contract: every wire type is `#[repr(C)]`, `Copy`, made of fixed-width integers, floats and arrays of them, has
//! no implicit padding, and carries its layout version in its type name and its layout hash in a service attribute.
//! A receiver copies a message once and validates the copy; what is refused is counted by reason.
//! No domain mathematics, no threads, no policy lives here.
//!
//! Source: iceoryx2 0.9.3; it compares type name, size and alignment only, hence the layout hash.

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets")]

pub mod layout;
pub use layout::Wire;
mod sentence;
mod vocabulary;
pub use vocabulary::*;
mod robot_mode;
pub use robot_mode::*;
mod flags;
pub use flags::*;
mod check;
pub use check::*;
mod header;
pub use header::*;
mod pen;
pub use pen::*;
mod joints;
pub use joints::*;
mod counters;
pub use counters::*;
mod arm_lag;
pub use arm_lag::*;
mod tick_record;
pub use tick_record::*;
mod refused;
pub use refused::*;
mod stop_detail;
pub use stop_detail::*;
mod latency;
pub use latency::*;
mod status;
pub use status::*;
mod control;
pub use control::*;
mod clock;
pub use clock::*;
mod os;
pub use os::{effective_user, shared_memory_free_bytes};
mod instance;
pub use instance::*;
mod occupancy;
pub use occupancy::*;
mod leftovers;
pub use leftovers::*;
mod stop_path;
pub use stop_path::*;
mod session;
pub use session::*;
mod topic;
pub use topic::*;
mod control_topic;
pub use control_topic::*;
mod ports;
pub use ports::*;
mod control_ports;
pub use control_ports::*;

/// Joints on the wire. The control law may use fewer; unused joints are zero.
pub const JOINTS: usize = 6;

/// Axes of a position on the wire: x, y in the writing plane, z along its normal.
pub const AXES: usize = 3;

/// Where the middleware keeps its segments.
pub const SHARED_MEMORY: &str = "/dev/shm";
