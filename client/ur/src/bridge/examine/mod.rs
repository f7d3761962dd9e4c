//! Is this controller ready for the bridge? Facts about it, and what to do about each.
//!
//! Contract: judging is pure; every line that is not good says what to do. Gathering the facts moves nothing
//! and starts no program.

mod judge;
mod gather;

pub use gather::gather;

use foretrace_config::Config;
use serde::Serialize;

use super::check::{Installation, Version};
use super::kinematics::{Deviation, DhParameters};

/// Everything that was found out; `None` where it was not.
#[derive(Debug, Clone, Default)]
pub struct Facts {
    /// Host is this machine.
    pub loopback: bool,
    /// The dashboard's greeting, or what stood in the way.
    pub dashboard: Port,
    pub primary: Port,
    pub rtde: Port,
    /// Software of the controller.
    pub version: Option<Version>,
    /// What arm the controller says it has.
    pub arm: Option<String>,
    /// Remote control, where the version tells it.
    pub remote: Option<bool>,
    /// States of robot, safety system and program.
    pub modes: Option<Modes>,
    /// Joints, payload and tool.
    pub installation: Option<Installation>,
    /// Registers that the bridge needs.
    pub registers: Option<RegisterFact>,
    /// What was measured on the line.
    pub timing: Option<Timing>,
    /// How far the tip is from where the settings believe it.
    pub deviation: Option<Deviation>,
    /// The arm's own kinematics.
    pub dh: Option<DhParameters>,
}

/// What became of the attempt to use a port.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Port {
    #[default]
    Untried,
    /// It answers, with these words.
    Open(String),
    /// It refuses the connection.
    Refused,
    /// No answer at all.
    Silent(String),
    /// It answers, but not as it should.
    Strange(String),
}

/// States of the controller, by the numbers of RTDE.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Modes {
    /// `robot_mode`.
    pub robot: i32,
    /// `safety_mode`.
    pub safety: i32,
    /// `runtime_state`.
    pub runtime: u32,
    /// `speed_scaling`, 0 to 1.
    pub speed_scaling: f64,
    /// `target_speed_fraction`, 0 to 1: the slider.
    pub slider: f64,
}

/// May the bridge have its registers?
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RegisterFact {
    Free,
    InUse(Vec<String>),
    /// The controller does not know these.
    Unknown(Vec<String>),
}

/// What a stretch of states showed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Timing {
    /// How long was listened \[s\].
    pub seconds: f64,
    /// Cycles per second of the controller \[Hz\].
    pub rate_hz: f64,
    pub states: u64,
    /// States that did not, by the timestamps of those that did.
    pub skipped: u64,
    /// How much later than the promptest the states came: median, 99 of 100, and the latest \[ms\].
    pub late_ms: [f64; 3],
    /// Number of round trips of 0, 1, 2, … cycles; the last holds all longer ones.
    pub round_trips: Vec<u64>,
}

/// How good a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// As it should be.
    Good,
    /// Could be better, or could not be seen.
    Fair,
    /// The bridge would not begin, or not go on.
    Bad,
}

/// One line of the examination.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// What was looked at.
    pub name: &'static str,
    /// How good it is.
    pub grade: Grade,
    pub value: String,
    /// What to do; empty only where it is good.
    pub fix: String,
}

/// Judges `facts` for a bridge with these settings; one finding a line, in the order in which to put things
/// right.
/// `position` are the joints' limits \[rad\].
#[must_use]
pub fn judge(facts: &Facts, config: &Config) -> Vec<Finding> {
    judge::all(facts, config)
}
