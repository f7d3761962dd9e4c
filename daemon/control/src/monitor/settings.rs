//! What the tracking monitor allows an arm to do, and for how long.

/// An arm that moves at a part of the speed that is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SlowArm {
    /// The tool slows with it.
    #[default]
    SlowDown,
    /// A stop is latched.
    Stop,
}

/// Limits on how an arm may differ from its commands. There is no value that turns the monitor off.
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
    /// What is wrong for this long, and in two joint states, latches \[ns\], at most 200 ms.
    pub hold_ns: u64,
    /// What becomes of the tool in front of a slow arm.
    pub slow_arm: SlowArm,
}

impl TrackingSettings {
    /// Found by measurement, see docs/results/not-following.md.
    pub const DEFAULT: Self = Self {
        joint_rad: 0.02,
        tool_m: 0.015,
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
