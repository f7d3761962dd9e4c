//! What an operator may ask the loop for, and why it may be refused.

use crate::predict::PredictorKind;

/// What an operator may ask for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Request {
    /// Take over the arm at its measured joints; also the way out of a latched stop.
    Arm,
    /// Move the arm home from where it stands, then let go of it.
    MoveHome,
    /// Stop smoothly and let go of the arm.
    Disarm,
    /// Stop smoothly and stay stopped until armed again.
    Stop,
    /// Fix the trust by hand.
    SetTrust(f64),
    /// Keep the trust where it is.
    FreezeTrust,
    /// Let the evidence decide the trust.
    TrustAuto,
    /// Change the predictor; trust goes through 0.
    SwitchPredictor(PredictorKind),
}

impl WayBlocked {
    /// In place of a pair: the tip would be below the paper; the distance is the tip's height.
    pub const PAPER: u16 = u16::MAX - 1;
}

/// What is in the way home, in whole numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WayBlocked {
    /// Number of the pair, see [`crate::clearance::Clearance::pair_names`], or [`Self::PAPER`].
    pub pair: u16,
    /// Position on the way \[%\].
    pub percent: u8,
    /// Distance there \[µm\]; negative where they overlap.
    pub distance_um: i32,
}

/// Why a request was not carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// No joint state was ever received.
    NoJointState,
    /// The newest joint state is too old.
    JointStateStale,
    /// The arm's safety system does not allow motion.
    MotionNotAllowed,
    /// The arm moves faster than the arming limit.
    ArmMoves,
    /// A joint stands outside its limits.
    OutsideJointLimits,
    /// The tool is outside the workspace by more than the arming margin.
    ToolOutsideWorkspace,
    /// The tool axis is too far from the plane's normal.
    ToolNotAligned,
    /// The dead-man switch is required and not held.
    EnableMissing,
    /// The arm is still being stopped.
    StillStopping,
    /// The loop is armed already.
    AlreadyArmed,
    /// The loop is armed: it has to be disarmed before the arm is moved home.
    DisarmFirst,
    /// The arm is being moved home.
    MovesHome,
    /// The straight way home is not clear.
    WayBlocked(WayBlocked),
    /// The arm is not where it was commanded to be, or moves by itself.
    NotFollowing,
    /// A stop came after the request to arm was sent.
    StopCame,
    /// The value is outside its legal range, or NaN.
    BadValue,
    /// The predictor asked for is not available in this loop.
    PredictorUnavailable,
}
