//! `ArmLine`: what an arm's process tells of its line to the arm. Part of [`crate::JointState`],
//! [`crate::TickRecord`] and [`crate::Status`].

use iceoryx2::prelude::ZeroCopySend;

use super::layout::wire;

wire! {
    /// The line between an arm's process and the arm's own controller. All zero where there is none.
    "foretrace.ArmLineV1"
    pub struct ArmLine {
        /// From a state of the arm to the cycle of its controller that used the answer to it \[ns\]; 0:
        /// unknown.
        pub round_trip_ns: u64,
        /// Cycles of the controller that had no fresh command, while the arm followed.
        pub late_cycles: u64,
        /// Commands that the controller never saw, because a newer one came within the same cycle.
        pub lost_commands: u64,
        /// [`crate::arm_flags`].
        pub flags: u32,
        /// Zero.
        pub reserved: u32,
    }
}
