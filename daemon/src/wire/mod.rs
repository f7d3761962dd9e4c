//! Conversion between the wire and the law's types, value by value.
//!
//! Contract: pure, total, no allocation on the paths of the real-time thread (pen, joints, dead-man,
//! command). Messages arrive validated; numbers without a field on the wire are omitted here and nowhere
//! else. Whole records and the status are assembled by the ipc thread (`ipc/record.rs`).

mod external;
mod input;
mod messages;
mod requests;
mod words;
mod outcome;
mod refused;

pub use external::{external_preview, external_state, pen_step};
pub use input::{Given, given, pen_of, pen_part, tick_input};
pub use messages::{
    Echo, Outgoing, echo, effort_of, effort_reading, effort_unit, enable_reading, joint_command,
    joint_reading, pen_reading,
};
pub use outcome::{UNKNOWN, arm_lag, extent, ghost_figures, guard_mask, health, ik_report, known, mpc_path};
pub use refused::{Refused, pen_rejection, refused};
pub use requests::{RequestRoute, refusal, route, unknown_predictor};
pub use words::{fault, ghost_state, mode, predictor, rung, stop_detail, trust_reason};

use foretrace_shm as shm;
pub use foretrace_shm::ArmLine;

/// Joints of the arms this daemon moves; the wire carries as many.
pub const JOINTS: usize = 6;

/// Number of reasons for refusing a message, as on the wire.
pub const REJECT_REASONS: usize = 9;

const _: () = assert!(JOINTS == shm::JOINTS);
const _: () = assert!(REJECT_REASONS == shm::REJECT_REASONS);

/// A count as the wire has it, saturated.
#[must_use]
pub fn saturated(count: u64) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// The bit, if it is set.
#[must_use]
pub const fn flag(set: bool, bit: u32) -> u32 {
    if set { bit } else { 0 }
}
