//! `StopCause` and `StopDetail`: the observation that latched a stop, and the figures of the tool's envelope.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;

use super::layout::wire;
use super::vocabulary::{UnknownValue, wire_enum};

wire_enum! {
    /// The observation that latched a stop; it determines the unit of `StopDetail::amount` and `limit`.
    pub enum StopCause: u32 {
        /// Nothing to add to the reason.
        None = 0 => "none",
        /// A measured joint is off every command that it may be answering \[rad\].
        JointDeviation = 1 => "joint deviation",
        /// The measured tool is off every command that it may be answering \[m\].
        ToolDeviation = 2 => "tool deviation",
        /// A measured joint moves against its commands \[rad\].
        WrongDirection = 3 => "wrong direction",
        /// The measured joints stand still while commands move them \[rad\].
        NoMotion = 4 => "no motion",
        /// A measured joint moves without a command \[rad/s\].
        Runaway = 5 => "runaway",
        /// The difference between measured and commanded joints oscillates with growing amplitude \[rad\].
        Oscillation = 6 => "growing oscillation",
        /// The arm moves at a fraction of the commanded speed \[1\].
        SlowArm = 7 => "slow arm",
        /// The tool is below its lowest or above its highest height over the paper \[m\].
        Height = 8 => "height over the paper",
        /// The tool is outside the workspace in the plane \[m\].
        Workspace = 9 => "workspace",
        /// The tool is tilted against the plane's normal \[rad\].
        Tilt = 10 => "tilt",
        /// The tool is too fast \[m/s\].
        ToolSpeed = 11 => "tool speed",
        /// Too many of the recent ticks were late \[1\].
        LateTicks = 12 => "late ticks",
        /// An obstacle is nearer than the arm may come to it \[m\].
        Clearance = 13 => "too near",
        /// A joint does not answer its commands as the rest of the arm does, and takes the tool away \[m\].
        Response = 14 => "response of a joint",
        /// A joint's effort is off what its motion needs in free space \[Nm\].
        Effort = 15 => "effort",
    }
}

wire! {
    /// Evidence behind a latched stop: which joint, how much, and the limit that was broken.
    "foretrace.StopDetailV1"
    pub struct StopDetail {
        /// [`StopCause`], which determines the unit of `amount` and `limit`.
        pub cause: u32,
        /// Joint index from 0, base first; −1: the tool, or no joint.
        pub joint: i32,
        /// Observed value.
        pub amount: f64,
        /// Allowed value.
        pub limit: f64,
        /// Release of the tick in which the stop latched \[ns\]; 0: no stop has latched.
        pub at_ns: u64,
    }
}

impl StopDetail {
    /// No stop.
    pub const NONE: Self = Self { cause: 0, joint: -1, amount: 0.0, limit: 0.0, at_ns: 0 };
}

/// One readable sentence, without the reason itself; empty where there is nothing to add.
impl fmt::Display for StopDetail {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { amount, limit, joint, .. } = *self;
        let (amount_mm, limit_mm) = (amount * 1e3, limit * 1e3);
        match StopCause::try_from(self.cause).unwrap_or(StopCause::None) {
            StopCause::None => Ok(()),
            StopCause::JointDeviation => write!(
                f,
                "joint {joint} is {amount:.3} rad from every command that it may be answering, limit \
                 {limit:.3} rad"
            ),
            StopCause::ToolDeviation => write!(
                f,
                "the tool is {amount_mm:.1} mm from every command that it may be answering, limit \
                 {limit_mm:.1} mm"
            ),
            StopCause::WrongDirection => {
                write!(f, "joint {joint} moved {amount:.3} rad against its commands, limit {limit:.3} rad")
            }
            StopCause::NoMotion if joint < 0 => write!(
                f,
                "the arm stands still while commands move a joint by {amount:.3} rad, limit {limit:.3} rad"
            ),
            StopCause::NoMotion => write!(
                f,
                "joint {joint} stands still while commands move it by {amount:.3} rad, limit {limit:.3} rad"
            ),
            StopCause::Runaway => write!(
                f,
                "joint {joint} moves at {amount:.3} rad/s though no command moves it, limit {limit:.3} rad/s"
            ),
            StopCause::Oscillation => write!(
                f,
                "joint {joint} swings about its commands by {amount:.3} rad and more with every swing, limit \
                 {limit:.3} rad"
            ),
            StopCause::SlowArm => write!(
                f,
                "the arm moves at about {:.0} % of what is asked, at least {:.0} % is wanted",
                amount * 100.0,
                limit * 100.0
            ),
            StopCause::Height => {
                write!(f, "the tool is {amount_mm:.1} mm over the paper, limit {limit_mm:.1} mm")
            }
            StopCause::Workspace => {
                write!(f, "the tool is {amount_mm:.1} mm outside the workspace, limit {limit_mm:.1} mm")
            }
            StopCause::Tilt => write!(f, "the tool is tilted by {amount:.3} rad, limit {limit:.3} rad"),
            StopCause::ToolSpeed => write!(f, "the tool moves at {amount:.3} m/s, limit {limit:.3} m/s"),
            StopCause::Clearance => {
                write!(f, "an obstacle is {amount_mm:.1} mm from the arm, which keeps {limit_mm:.1} mm away")
            }
            StopCause::Response => write!(
                f,
                "joint {joint} does not answer as the rest of the arm: it takes the tool {amount_mm:.1} mm from \
                 where it would be, limit {limit_mm:.1} mm"
            ),
            StopCause::Effort => write!(
                f,
                "joint {joint} bears {amount:.1} Nm more than its motion needs, limit {limit:.1} Nm for long"
            ),
            StopCause::LateTicks => write!(
                f,
                "{:.0} % of the recent ticks ended after their deadline, limit {:.0} %",
                amount * 100.0,
                limit * 100.0
            ),
        }
    }
}

wire! {
    /// Extremes of the measured tool since the daemon took charge, by forward kinematics of the *measured*
    /// joints in the plane's frame. NaN: not measured yet.
    "foretrace.ToolExtentV1"
    pub struct ToolExtent {
        /// Lowest height over the paper \[m\].
        pub height_min_m: f64,
        /// Greatest height over the paper \[m\].
        pub height_max_m: f64,
        /// Farthest outside the workspace in the plane, 0 inside \[m\].
        pub outside_max_m: f64,
        /// Largest angle between the tool's axis and the plane's normal \[rad\].
        pub tilt_max_rad: f64,
    }
}

impl ToolExtent {
    /// Nothing measured yet.
    pub const UNKNOWN: Self = Self {
        height_min_m: f64::NAN,
        height_max_m: f64::NAN,
        outside_max_m: f64::NAN,
        tilt_max_rad: f64::NAN,
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cause_names_amount_and_limit() {
        for cause in StopCause::ALL.iter().filter(|cause| **cause != StopCause::None) {
            let detail =
                StopDetail { cause: (*cause).into(), joint: 3, amount: 0.25, limit: 0.125, at_ns: 1 };
            let text = detail.to_string();
            let [amount, limit] = match cause {
                StopCause::ToolDeviation
                | StopCause::Height
                | StopCause::Workspace
                | StopCause::Clearance
                | StopCause::Response => ["250.0", "125.0"],
                StopCause::SlowArm | StopCause::LateTicks => ["25 %", "12 %"],
                StopCause::Effort => ["0.2 Nm", "0.1 Nm"],
                _ => ["0.250", "0.125"],
            };
            assert!(text.contains(amount) && text.contains(limit), "{text}");
        }
        assert_eq!(StopDetail::NONE.to_string(), "");
    }

    #[test]
    fn an_arm_that_stands_still_as_a_whole_names_no_joint() {
        let of =
            |joint| StopDetail { cause: StopCause::NoMotion.into(), joint, ..StopDetail::NONE }.to_string();
        assert!(of(-1).starts_with("the arm stands still") && of(0).starts_with("joint 0 stands still"));
    }
}
