//! Why the arm was stopped, and the evidence.

use crate::units::Stamp;

/// Why the loop stopped by itself or was stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StopReason {
    /// It did not.
    #[default]
    None,
    /// An operator asked for it.
    Requested,
    /// The dead-man switch was released or fell silent.
    EnableLost,
    /// Joint states fell silent.
    JointStateLost,
    /// The machine stood still for longer than the latch time.
    TimeLost,
    /// The arm's safety system stopped it.
    ArmSafety,
    /// The arm is not where it was told to be.
    TrackingError,
    /// The tool could not be kept in its envelope: paper, workspace, tilt, speed.
    Envelope,
    /// Too many ticks were late.
    Overruns,
    /// Something holds the arm up on its way home.
    WayBlocked,
}

/// What exactly was seen when a stop latched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StopCause {
    /// Nothing to add to the reason.
    #[default]
    None,
    /// A measured joint is off every command that it may be answering \[rad\].
    JointDeviation,
    /// The measured tool is off every command that it may be answering \[m\].
    ToolDeviation,
    /// A measured joint moves against its commands \[rad\].
    WrongDirection,
    /// The measured joints stand still while commands move them \[rad\].
    NoMotion,
    /// A measured joint moves though nothing commands it to \[rad/s\].
    Runaway,
    /// The difference between measured and commanded joints swings and grows \[rad\].
    Oscillation,
    /// The arm moves at a part of the speed that is asked for \[1\].
    SlowArm,
    /// The tool is below its lowest or above its highest height over the paper \[m\].
    Height,
    /// The tool is outside the workspace in the plane \[m\].
    Workspace,
    /// The tool is tilted against the plane's normal \[rad\].
    Tilt,
    /// The tool is too fast \[m/s\].
    ToolSpeed,
    /// Too many of the recent ticks were late \[1\].
    LateTicks,
    /// Something is nearer than the arm may come to it \[m\].
    Clearance,
}

/// The evidence behind a latched stop.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StopDetail {
    /// What was seen; the unit of `amount` and `limit` is its.
    pub cause: StopCause,
    /// Joint index from 0, base first; `None`: the tool, or no joint.
    pub joint: Option<u8>,
    /// What was seen.
    pub amount: f64,
    /// What was allowed.
    pub limit: f64,
    /// Release of the tick in which the stop latched; `Stamp(0)`: no stop has latched.
    pub at: Stamp,
}
