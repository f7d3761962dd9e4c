//! The flag words of the wire: one module of `u32` bits per word.
//!
//! Contract: a bit never changes its meaning; receivers refuse masks with bits outside `ALL`.

macro_rules! wire_flags {
    ($(#[$meta:meta])* pub mod $module:ident {
        $($(#[$flag_meta:meta])* $flag:ident = $bit:literal => $label:literal),+ $(,)?
    }) => {
        $(#[$meta])*
        pub mod $module {
            $($(#[$flag_meta])* pub const $flag: u32 = 1 << $bit;)+

            /// Every bit that has a meaning, with its name in the source, lowest first.
            pub const NAMES: &[(&str, u32)] = &[$((stringify!($flag), $flag)),+];

            /// Every bit that has a meaning.
            pub const ALL: u32 = 0 $(| $flag)+;

            /// Labels of the bits set in `mask`, lowest bit first; unknown bits are left out.
            pub fn labels(mask: u32) -> impl Iterator<Item = &'static str> {
                [$(($flag, $label)),+].into_iter().filter(move |(bit, _)| mask & bit != 0).map(|(_,
                    label)| label)
            }
        }
    };
}

wire_flags! {
    /// Bits of `PenSample::flags`.
    pub mod pen_flags {
        /// The pen touches the surface.
        CONTACT = 0 => "contact",
        /// The pen is in range.
        IN_RANGE = 1 => "in range",
        /// First side button.
        BUTTON_1 = 2 => "button 1",
        /// Second side button.
        BUTTON_2 = 3 => "button 2",
        /// Third side button.
        BUTTON_3 = 4 => "button 3",
        /// The eraser end.
        ERASER = 5 => "eraser",
        /// Synthetic, not measured: travel inserted between recorded strokes.
        SYNTHETIC = 6 => "synthetic",
    }
}

wire_flags! {
    /// Bits of `PenPreview::flags`.
    pub mod preview_flags {
        /// `radius_m` has values.
        RADII = 0 => "radii",
    }
}

wire_flags! {
    /// Bits of `JointCommand::flags`.
    pub mod command_flags {
        /// The arm must follow; without it the consumer stands still.
        ENABLED = 0 => "enabled",
        /// First command after arming: it begins at rest where the arm stands. Every other one continues the
        /// one before.
        BEGINS = 1 => "begins",
        /// A stop is under way.
        STOPPING = 2 => "stopping",
    }
}

wire_flags! {
    /// Bits of `TickInput::flags`: what the tick was given.
    pub mod input_flags {
        /// A joint state arrived.
        JOINTS = 0 => "joints",
        /// The arm's safety system allows motion, as that joint state says.
        MOTION_ALLOWED = 1 => "motion allowed",
        /// A dead-man message arrived.
        ENABLE = 2 => "enable",
        /// It says stop.
        ENABLE_STOP = 3 => "enable stop",
        /// There was a request.
        REQUEST = 4 => "request",
        /// The shell demanded a stop.
        HALT = 5 => "halt",
        /// Weights were offered.
        WEIGHTS = 6 => "weights",
        /// The solve was to be shed.
        SHED = 7 => "shed",
        /// The command lets the arm move.
        ENABLED = 8 => "enabled",
        /// Pen samples of this tick are missing here: it cannot be run again.
        INCOMPLETE = 9 => "incomplete",
        /// The command of the tick before was not sent, or too late to be valid.
        UNSENT = 10 => "unsent",
        /// A preview of another process came; [`crate::PieceKind::Preview`] has it.
        PREVIEW = 11 => "preview",
    }
}

wire_flags! {
    /// Bits of `ArmLine::flags`.
    pub mod arm_flags {
        /// An operator lets the arm move without a dead-man switch.
        WITHOUT_DEAD_MAN = 0 => "without dead-man",
        /// The arm is simulated: nothing moves.
        SIMULATED = 1 => "simulated",
    }
}

wire_flags! {
    /// Bits of `TickRecord::health`: what degraded this tick.
    pub mod health {
        /// No fresh pen sample.
        PEN_STALE = 0 => "pen stale",
        /// A gap in the pen's stamps.
        PEN_GAP = 1 => "pen gap",
        /// A jump or outlier among the pen samples.
        PEN_JUMP = 2 => "pen jump",
        /// A pen stamp went backwards or repeated.
        PEN_DISORDER = 3 => "pen disorder",
        /// A pen sample was refused.
        PEN_REJECTED = 4 => "pen rejected",
        /// The predictor's output was unusable.
        PREDICTOR_UNHEALTHY = 5 => "predictor unhealthy",
        /// The preview was bounded to what a hand can do.
        PREVIEW_CLAMPED = 6 => "preview clamped",
        /// The reference was outside the workspace.
        WORKSPACE_CLAMPED = 7 => "workspace clamped",
        /// A soft limit of the MPC is exceeded.
        SOFT_LIMIT = 8 => "soft limit exceeded",
        /// The MPC reached its iteration cap.
        MPC_CAP = 9 => "mpc iteration cap",
        /// The MPC used its fallback plan.
        MPC_FALLBACK = 10 => "mpc fallback",
        /// The IK reached its iteration cap.
        IK_CAP = 11 => "ik iteration cap",
        /// Damping grew near a singularity.
        NEAR_SINGULAR = 12 => "near singular",
        /// A joint limit altered the motion.
        IK_CLIPPED = 13 => "ik clipped",
        /// The guard altered the command.
        GUARD_CLIPPED = 14 => "guard clipped",
        /// The guard refused the command.
        GUARD_REFUSED = 15 => "guard refused",
        /// The joint state is stale.
        JOINT_STATE_STALE = 16 => "joint state stale",
        /// Whole periods were lost.
        TIME_LOST = 17 => "time lost",
        /// The command was re-synchronised.
        RESYNCHRONISED = 18 => "resynchronised",
        /// The budget was shed before the step.
        SHED = 19 => "shed",
        /// The tick ended after its deadline.
        OVERRUN = 20 => "overrun",
        /// New weights were refused.
        WEIGHTS_REFUSED = 21 => "weights refused",
        /// The learner's ring was full.
        LEARNER_RING_FULL = 22 => "learner ring full",
        /// The telemetry ring was full.
        TELEMETRY_RING_FULL = 23 => "telemetry ring full",
        /// A number became non-finite and was replaced.
        NOT_FINITE = 24 => "not finite",
        /// The robot reports a safety mode that forbids motion.
        ROBOT_NOT_READY = 25 => "robot not ready",
        /// The command could not be published.
        COMMAND_NOT_SENT = 26 => "command not sent",
        /// The dead-man does not beat.
        DEAD_MAN = 27 => "dead-man missing",
        /// Memory was allocated in this tick.
        ALLOCATED = 28 => "allocated",
        /// The IK had no usable solution; it clamped or braked.
        IK_FAILED = 29 => "ik failed",
        /// Clearance rows held the motion back.
        CLEARANCE = 30 => "held clear",
        /// A stop braked joint by joint, off its path.
        STOP_OFF_PATH = 31 => "stop off its path",
    }
}

wire_flags! {
    /// Bits of `TickRecord::guard_mask`: what the guard altered.
    pub mod guard_mask {
        /// A non-finite number.
        NOT_FINITE = 0 => "not finite",
        /// A position limit.
        POSITION = 1 => "position",
        /// A velocity limit.
        VELOCITY = 2 => "velocity",
        /// An acceleration limit.
        ACCELERATION = 3 => "acceleration",
        /// A jerk limit.
        JERK = 4 => "jerk",
        /// Not continuous with the last command, or not after it.
        DISCONTINUOUS = 5 => "discontinuous",
        /// Could not have stopped inside the position limits.
        UNSTOPPABLE = 6 => "unstoppable",
        /// The last command was too long ago; the motion was bounded.
        GAP = 7 => "gap",
    }
}

wire_flags! {
    /// Bits of `Status::missing_rights`: rights that the system refused to the real-time thread.
    pub mod missing_rights {
        /// SCHED_FIFO.
        FIFO = 0 => "real-time scheduling",
        /// Memory locking.
        MEMORY_LOCK = 1 => "memory locking",
        /// CPU affinity.
        AFFINITY = 2 => "cpu affinity",
        /// /dev/cpu_dma_latency.
        CPU_LATENCY = 3 => "cpu latency request",
        /// Timer slack.
        TIMER_SLACK = 4 => "timer slack",
        /// The kernel is not PREEMPT_RT.
        PREEMPT_RT = 5 => "preempt-rt kernel",
        /// Some shared memory is not backed by pages.
        SHARED_MEMORY_RESERVED = 6 => "shared memory reserved",
        /// None were asked for (`--no-rights`): none were granted.
        NOT_ASKED = 7 => "none asked for",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flag_labels_name_exactly_the_set_bits() {
        let mask = pen_flags::CONTACT | pen_flags::BUTTON_2 | 1 << 31;
        assert_eq!(pen_flags::labels(mask).collect::<Vec<_>>(), ["contact", "button 2"]);
        assert_eq!(health::ALL, u32::MAX, "no bit is free");
    }
}
