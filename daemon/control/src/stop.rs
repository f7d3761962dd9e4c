//! Why the arm was stopped, and the evidence.

use crate::state::{choices, state};
use crate::units::Stamp;

/// Why the loop stopped by itself or was stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StopReason {
    /// It is not stopped at all.
    #[default]
    None,
    /// An operator requested it.
    Requested,
    /// The dead-man switch was released or is stale.
    EnableLost,
    /// Joint states are stale.
    JointStateLost,
    /// The process stood still for longer than the latch time.
    TimeLost,
    /// The arm's safety system stopped it.
    ArmSafety,
    /// The arm is not where it was commanded to be.
    TrackingError,
    /// The tool could not be kept in its envelope: paper, workspace, tilt, speed.
    Envelope,
    /// Too many ticks were late.
    Overruns,
    /// Something holds the arm up on its way home.
    WayBlocked,
    /// The arm touches something that its motion does not explain.
    Contact,
}

choices! {
    StopReason {
        None, Requested, EnableLost, JointStateLost, TimeLost, ArmSafety, TrackingError, Envelope,
        Overruns, WayBlocked, Contact,
    }
}

/// The observation that latched a stop.
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
    /// A measured joint moves without a command \[rad/s\].
    Runaway,
    /// The difference between measured and commanded joints oscillates with growing amplitude \[rad\].
    Oscillation,
    /// The arm moves at a fraction of the commanded speed \[1\].
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
    /// An obstacle is nearer than the arm may come to it \[m\].
    Clearance,
    /// A joint does not answer its commands as the rest of the arm does, and takes the tool away \[m\].
    Response,
    /// A joint's effort is off what the motion needs \[Nm\].
    Effort,
}

choices! {
    StopCause {
        None, JointDeviation, ToolDeviation, WrongDirection, NoMotion, Runaway, Oscillation, SlowArm,
        Height, Workspace, Tilt, ToolSpeed, LateTicks, Clearance, Response, Effort,
    }
}

impl StopCause {
    /// Unit of what was observed, and of its limit; empty for a number or none.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::None | Self::SlowArm | Self::LateTicks => "",
            Self::JointDeviation | Self::WrongDirection | Self::NoMotion | Self::Oscillation | Self::Tilt => {
                "rad"
            }
            Self::Runaway => "rad/s",
            Self::ToolDeviation | Self::Height | Self::Workspace | Self::Clearance | Self::Response => "m",
            Self::ToolSpeed => "m/s",
            Self::Effort => "Nm",
        }
    }
}

/// The evidence behind a latched stop.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StopDetail {
    /// The observation, which determines the unit of `amount` and `limit`.
    pub cause: StopCause,
    /// Joint index from 0, base first; `None`: the tool, or no joint.
    pub joint: Option<u8>,
    /// The value that was observed.
    pub amount: f64,
    /// The bound that it violates.
    pub limit: f64,
    /// Release of the tick in which the stop latched; `Stamp(0)`: no stop has latched.
    pub at: Stamp,
}

state! { whole [] StopDetail { cause, joint, amount, limit, at } }
