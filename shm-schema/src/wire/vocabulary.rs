//! The enumerations of the wire and their numbers.
//!
//! Contract: on the wire an enumeration is a `u32` (statuses: `i32`); numbers are never reused for another
//! meaning. `TryFrom` refuses unknown numbers.

use std::fmt;

/// An unknown number on the wire.
#[derive(Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{value} is not a known {kind}")]
pub struct UnknownValue {
    /// Name of the enumeration.
    pub kind: &'static str,
    /// The number.
    pub value: i64,
}

crate::debug_as_display!(UnknownValue);

macro_rules! wire_enum {
    ($(#[$meta:meta])* pub enum $type:ident: $repr:ident {
        $($(#[$variant_meta:meta])* $variant:ident = $number:literal => $label:literal),+ $(,)?
    }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr($repr)]
        pub enum $type {
            $($(#[$variant_meta])* $variant = $number),+
        }

        impl $type {
            /// Every variant, in order of its number.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];

            /// For display and JSON; stable.
            pub const fn label(self) -> &'static str {
                match self { $(Self::$variant => $label),+ }
            }

            /// The variant with this label.
            pub fn from_label(label: &str) -> Option<Self> {
                Self::ALL.iter().copied().find(|variant| variant.label() == label)
            }
        }

        impl TryFrom<$repr> for $type {
            type Error = UnknownValue;

            fn try_from(value: $repr) -> Result<Self, UnknownValue> {
                match value {
                    $($number => Ok(Self::$variant),)+
                    _ => Err(UnknownValue { kind: stringify!($type), value: i64::from(value) }),
                }
            }
        }

        impl From<$type> for $repr {
            fn from(value: $type) -> $repr {
                value as $repr
            }
        }

        impl fmt::Display for $type {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(self.label())
            }
        }
    };
}

pub(crate) use wire_enum;

wire_enum! {
    /// Mode of the daemon.
    pub enum Mode: u32 {
        /// Not armed; commands are not published.
        Idle = 0 => "idle",
        /// Seeded from the measured joints, publishing, waiting for the pen.
        Armed = 1 => "armed",
        /// Following the pen.
        Following = 2 => "following",
        /// Enabled, but standing still: no fresh pen.
        Holding = 3 => "holding",
        /// Stopped on request or by itself, see [`FaultReason`]; needs an explicit arm.
        Stopped = 4 => "stopped",
        /// Stopped by the robot's own safety system ([`FaultReason::RobotStopped`]); needs an explicit arm.
        Fault = 5 => "fault",
        /// Moving the arm home, or about to; the pen has no effect.
        Homing = 6 => "moving home",
    }
}

wire_enum! {
    /// Which rung of the degradation ladder made this tick's command.
    pub enum Rung: u32 {
        /// This tick's own plan.
        FreshPlan = 0 => "fresh plan",
        /// The previous plan, evaluated at the true elapsed time.
        PreviousPlan = 1 => "previous plan",
        /// A jerk-limited stop.
        Stop = 2 => "stop",
        /// Standing still.
        Hold = 3 => "hold",
    }
}

wire_enum! {
    /// Reason for the trust.
    pub enum TrustReason: u32 {
        /// Not following: there is nothing to trust.
        Inactive = 0 => "inactive",
        /// The history is still too short.
        WarmUp = 1 => "warm-up",
        /// An operator set it.
        Manual = 2 => "manual",
        /// From the realised error of past previews.
        Evidence = 3 => "evidence",
        /// Before 2026-11: between the two thresholds of the record.
        Hysteresis = 4 => "hysteresis",
        /// The newest pen sample is too old.
        PenStale = 6 => "pen stale",
        /// Before 2026-11: the pen jumped. Now a warm-up.
        PenJump = 7 => "pen jump",
        /// The predictor's output was unusable.
        PredictorUnhealthy = 9 => "predictor unhealthy",
        /// The predictor was switched a moment ago.
        PredictorSwitched = 10 => "predictor switched",
        /// Past previews were worse than Hold.
        WorseThanHold = 11 => "worse than hold",
        /// Before 2026-11: past previews were worse than constant velocity.
        WorseThanConstantVelocity = 12 => "worse than constant velocity",
        /// Frozen by hand.
        Frozen = 14 => "frozen",
        /// Before 2026-11: too few previews were judged.
        Unproven = 15 => "no evidence yet",
        /// Before 2026-11: the pen left the bands of recent previews far more often than they promise.
        Surprised = 16 => "pen outside the bands",
        /// Too many recent ticks had to stop instead of following a plan.
        SolverUnhealthy = 17 => "planner unhealthy",
        /// Before 2026-11: the learner's parameters were refused. Now an unhealthy predictor.
        LearnerUnhealthy = 18 => "learner unhealthy",
        /// Trusted, but the arm is asked to go less far: it is saturated too often, and then hardly better
        /// than under feedback alone.
        ArmLimited = 19 => "arm at its limits",
    }
}

wire_enum! {
    /// How a quadratic programme was solved.
    pub enum SolverPath: u32 {
        /// Not solved this tick.
        NotRun = 0 => "not run",
        /// Constant gains; the unconstrained optimum met every limit.
        Gain = 1 => "gain",
        /// Exact dual active set.
        ActiveSet = 2 => "active set",
        /// Clarabel, chosen in the settings.
        Clarabel = 3 => "clarabel",
        /// Iteration cap or shed budget: the fallback plan.
        Fallback = 4 => "fallback",
    }
}

wire_enum! {
    /// Operation of a request.
    pub enum ControlOp: u32 {
        /// None; the answer carries mode and trust. `value` of the answer: trust.
        Query = 0 => "query",
        /// Seed from the measured joints and begin.
        Arm = 1 => "arm",
        /// Stop smoothly and go idle.
        Disarm = 2 => "disarm",
        /// Stop smoothly and latch.
        Stop = 3 => "stop",
        /// Trust by hand; `value` in \[0, 1\].
        SetTrust = 4 => "set-trust",
        /// Trust from evidence again.
        TrustAuto = 5 => "trust-auto",
        /// `predictor` is a name that the daemon knows.
        SwitchPredictor = 6 => "switch-predictor",
        /// Read the settings file again; only live settings may have changed.
        Reload = 7 => "reload",
        /// Freeze the trust.
        FreezeTrust = 8 => "freeze-trust",
        /// Move the arm home from where it stands; answered when the way has been checked.
        MoveHome = 9 => "move-home",
    }
}

wire_enum! {
    /// How a request ended; zero is success, negative numbers are refusals.
    pub enum ControlStatus: i32 {
        /// Done.
        Ok = 0 => "ok",
        /// Accepted; the effect follows.
        Accepted = 1 => "accepted",
        /// Malformed: unknown operation, number out of range.
        Invalid = -1 => "invalid request",
        /// Intended for a daemon of an earlier boot.
        ForeignBoot = -2 => "foreign boot",
        /// Not possible in the present mode.
        WrongMode = -3 => "wrong mode",
        /// No joint state has arrived.
        NoJointState = -4 => "no joint state",
        /// The newest joint state is too old.
        JointStateStale = -5 => "joint state stale",
        /// The measured joints are outside the position limits.
        OutsideLimits = -6 => "outside limits",
        /// The robot moves or is not ready (safety or robot mode).
        RobotNotReady = -7 => "robot not ready",
        /// A dead-man is configured and does not beat.
        NotEnabled = -8 => "not enabled",
        /// The predictor is unknown to, or not loaded in, this daemon.
        PredictorUnavailable = -9 => "predictor unavailable",
        /// The settings file did not pass the check.
        SettingsRejected = -10 => "settings rejected",
        /// The change needs a restart.
        NeedsRestart = -11 => "needs restart",
        /// The daemon is busy with another request.
        Busy = -12 => "busy",
        /// An internal error; the message has details.
        Internal = -13 => "internal error",
        /// Known, but not built into this daemon.
        Unsupported = -14 => "unsupported",
        /// The measured joints are too far from where the motion would begin.
        Jump = -15 => "jump refused",
        /// The arm moves faster than arming allows.
        ArmMoves = -16 => "arm moves",
        /// The tool is outside the workspace by more than the arming margin.
        ToolOutsideWorkspace = -17 => "tool outside workspace",
        /// The tool axis is too far from the plane's normal.
        ToolNotAligned = -18 => "tool not aligned",
        /// The arm is not where it was commanded to be, or moves by itself.
        NotFollowing = -19 => "arm does not follow",
        /// A stop came after the request to arm was sent.
        StopCame = -20 => "superseded by a stop",
        /// The straight way home is not clear.
        WayBlocked = -21 => "path home is blocked",
    }
}

wire_enum! {
    /// Why the daemon stopped.
    pub enum FaultReason: u32 {
        /// Not stopped.
        None = 0 => "none",
        /// More time was lost than the configured limit.
        TimeLost = 1 => "time lost",
        /// The joint state is stale.
        JointStateStale = 2 => "joint state stale",
        /// The robot reported a protective stop, an emergency stop or a fault.
        RobotStopped = 3 => "robot stopped",
        /// The measured joints deviate from the commanded ones.
        TrackingError = 4 => "tracking error",
        /// The dead-man stopped beating or asked for a stop.
        DeadMan = 5 => "dead-man",
        /// Too many overruns within the window of the settings.
        Overruns = 8 => "overruns",
        /// A thread of the daemon ended or stopped answering.
        Internal = 10 => "internal",
        /// An operator requested it.
        Requested = 11 => "requested",
        /// The tool left its envelope: paper, workspace, tilt or speed.
        Envelope = 12 => "tool envelope",
        /// Something held the arm up on its way home.
        WayBlocked = 13 => "blocked while homing",
        /// The arm touches something, by the efforts that it reports.
        Contact = 14 => "contact",
    }
}

wire_enum! {
    /// What the efforts of a joint state are given in.
    pub enum EffortUnit: u32 {
        /// The arm reports none.
        None = 0 => "none",
        /// Torque \[Nm\].
        NewtonMetres = 1 => "Nm",
        /// Motor current \[A\].
        Amperes = 2 => "A",
        /// Share of the joint's effort limit in the URDF, −1 to 1.
        Share = 3 => "share of the limit",
    }
}

wire_enum! {
    /// The stages of a tick, in order; indices of `stage_ns` and of the percentiles in the status.
    pub enum Stage: u32 {
        /// From release to the start of the tick.
        Wakeup = 0 => "wakeup",
        /// Receive pen samples, joint state, weights, requests.
        Receive = 1 => "receive",
        /// Samples to pen grid.
        Pen = 2 => "pen",
        /// Observe, preview, and correct it.
        Predict = 3 => "predict",
        /// From the record to α.
        Trust = 4 => "trust",
        /// Three axes of MPC.
        Mpc = 5 => "mpc",
        /// Inverse kinematics.
        Ik = 6 => "ik",
        /// Last clamp.
        Guard = 7 => "guard",
        /// Publish the command.
        Send = 8 => "send",
        /// Whole step: from the start of receive to the command published.
        Step = 9 => "step",
    }
}

/// Number of [`Stage`]s.
pub const STAGES: usize = Stage::ALL.len();

wire_enum! {
    /// Why a message was refused; the index of its counter.
    pub enum RejectReason: u32 {
        /// NaN or infinite.
        NotFinite = 0 => "not finite",
        /// Finite, but outside a generous physical range.
        OutOfRange = 1 => "out of range",
        /// A number of no variant.
        UnknownEnum = 2 => "unknown enum",
        /// A flag bit without a meaning.
        UnknownFlags = 3 => "unknown flags",
        /// Stamped under another boot of a machine.
        ForeignBoot = 4 => "foreign boot",
        /// Stamp before the previous one of the same sender.
        TimeBackwards = 5 => "time backwards",
        /// Stamp later than now and the allowance.
        FromTheFuture = 6 => "from the future",
        /// Sequence number already seen.
        Replayed = 7 => "replayed",
        /// Older than the receiver accepts.
        TooOld = 8 => "too old",
    }
}

/// Number of [`RejectReason`]s.
pub const REJECT_REASONS: usize = RejectReason::ALL.len();

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_maps_to_its_variant_and_back() {
        for mode in Mode::ALL {
            assert_eq!(Mode::try_from(u32::from(*mode)), Ok(*mode));
            assert_eq!(Mode::from_label(mode.label()), Some(*mode));
        }
        for status in ControlStatus::ALL {
            assert_eq!(ControlStatus::try_from(i32::from(*status)), Ok(*status));
        }
    }

    #[test]
    fn unknown_numbers_are_refused_with_their_value() {
        assert_eq!(Mode::try_from(7), Err(UnknownValue { kind: "Mode", value: 7 }));
        assert_eq!(ControlStatus::try_from(-99).unwrap_err().to_string(), "-99 is not a known ControlStatus");
    }

    #[test]
    fn stages_and_reasons_are_numbered_without_gaps() {
        for (index, stage) in Stage::ALL.iter().enumerate() {
            assert_eq!(*stage as usize, index);
        }
        for (index, reason) in RejectReason::ALL.iter().enumerate() {
            assert_eq!(*reason as usize, index);
        }
    }

    #[test]
    fn labels_pad_like_text_and_unknown_labels_are_nobody() {
        assert_eq!(format!("[{:>6}|{:<6}]", Mode::Idle, Mode::Idle), "[  idle|idle  ]");
        assert_eq!(RejectReason::from_label("no such reason"), None);
        for reason in TrustReason::ALL {
            assert_eq!(TrustReason::from_label(reason.label()), Some(*reason));
        }
    }
}
