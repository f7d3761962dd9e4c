//! Tolerances of the tracking monitor.

/// What happens to an arm that moves at a fraction of the commanded speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SlowArm {
    /// The tool slows with it.
    #[default]
    SlowDown,
    /// A stop is latched.
    Stop,
}

/// Limits on the difference between an arm and its commands. No value turns the monitor off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingSettings {
    /// Farthest that a measured joint may be from every command that it may be answering \[rad\], 0.002 to
    /// 0.5.
    pub joint_rad: f64,
    /// The same for the tool, along each axis of the plane \[m\], 0.001 to 0.2.
    pub tool_m: f64,
    /// Commands that move a joint by this much are expected to show \[rad\], 0.002 to 0.5.
    pub still_rad: f64,
    /// A joint that leaves its commands faster than this runs away \[rad/s\], 0.02 to 3.
    pub runaway_radps: f64,
    /// A finding that lasts this long, and in two joint states, latches a stop \[ns\], at most 200 ms.
    pub hold_ns: u64,
    /// What happens to the tool in front of a slow arm.
    pub slow_arm: SlowArm,
}

impl TrackingSettings {
    /// From measurements, see docs/results/not-following.md.
    pub const DEFAULT: Self = Self {
        joint_rad: 0.02,
        tool_m: 0.005,
        still_rad: 0.006,
        runaway_radps: 0.1,
        hold_ns: 10_000_000,
        slow_arm: SlowArm::SlowDown,
    };

    /// Name, value, legal range and unit of each number.
    pub(crate) fn numbers(&self) -> [(&'static str, f64, f64, f64, &'static str); 5] {
        [
            ("joint tolerance", self.joint_rad, 0.002, 0.5, "rad"),
            ("tool tolerance", self.tool_m, 0.001, 0.2, "m"),
            ("motion that has to show", self.still_rad, 0.002, 0.5, "rad"),
            ("runaway speed", self.runaway_radps, 0.02, 3.0, "rad/s"),
            ("hold time of the tracking monitor", self.hold_ns as f64 * 1e-9, 0.0, 0.2, "s"),
        ]
    }
}

impl Default for TrackingSettings {
    fn default() -> Self {
        Self::DEFAULT
    }
}
