//! Messages: the bytes that cross a process border, and a receiver's checks of them.
//!
//! Contract: pure except for the clock and the boot id in every header. Independent of an instance's files
//! and of the transport.

pub mod layout;
pub(crate) mod sentence;
pub(crate) mod vocabulary;
pub(crate) mod robot_mode;
pub(crate) mod flags;
pub(crate) mod check;
pub(crate) mod clock;
pub(crate) mod header;
pub(crate) mod pen;
pub mod gateway;
pub(crate) mod pen_step;
pub(crate) mod joints;
pub(crate) mod counters;
pub(crate) mod arm_lag;
pub(crate) mod arm_line;
pub(crate) mod arm_note;
pub(crate) mod predictor_name;
pub(crate) mod tick_record;
pub(crate) mod refused;
pub(crate) mod stop_detail;
pub(crate) mod tick_input;
pub(crate) mod piece;
pub(crate) mod latency;
pub(crate) mod status;
pub(crate) mod control;
pub(crate) mod foreign;
pub(crate) mod c_header;
pub(crate) mod python_module;

/// Joints on the wire. The control law may use fewer; unused joints are zero.
pub const JOINTS: usize = 6;

/// Axes of a position on the wire: x, y in the writing plane, z along its normal.
pub const AXES: usize = 3;
