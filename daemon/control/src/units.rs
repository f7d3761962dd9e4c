//! Types for the few units whose confusion would move the robot wrongly.

use crate::state::{state, wraps};
use std::ops::Add;

/// A monotonic time \[ns\], read from the host's CLOCK_MONOTONIC by the caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash)]
pub struct Stamp(pub u64);

impl Stamp {
    /// Nanoseconds from `earlier` to `self`, negative when `self` is the earlier one; saturates at
    /// ±`i64::MAX`.
    #[must_use]
    pub const fn since(self, earlier: Self) -> i64 {
        let difference = self.0 as i128 - earlier.0 as i128;
        if difference > i64::MAX as i128 {
            i64::MAX
        } else if difference < -(i64::MAX as i128) {
            -i64::MAX
        } else {
            difference as i64
        }
    }

    /// Seconds from `earlier` to `self`, negative when `self` is the earlier one.
    #[must_use]
    pub const fn seconds_since(self, earlier: Self) -> f64 {
        self.since(earlier) as f64 * 1e-9
    }

    /// The time `ns` later; saturates at the end of the clock.
    #[must_use]
    pub const fn plus_ns(self, ns: u64) -> Self {
        Self(self.0.saturating_add(ns))
    }
}

impl Add<u64> for Stamp {
    type Output = Self;
    fn add(self, ns: u64) -> Self {
        self.plus_ns(ns)
    }
}

/// Weight on the preview, α of the paper: 1 = prediction only, 0 = Hold only. Always in \[0, 1\].
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Trust(f64);

impl Trust {
    /// No trust: Hold decides alone.
    pub const NONE: Self = Self(0.0);
    /// Full trust: the prediction decides alone.
    pub const FULL: Self = Self(1.0);

    /// Clamps to \[0, 1\]; NaN becomes 0, the safe value.
    #[must_use]
    pub const fn new(alpha: f64) -> Self {
        if alpha >= 1.0 {
            Self(1.0)
        } else if alpha > 0.0 {
            Self(alpha)
        } else {
            Self(0.0)
        }
    }

    /// α in \[0, 1\].
    #[must_use]
    pub const fn alpha(self) -> f64 {
        self.0
    }
}

/// Motion along one axis of the writing plane's frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AxisState {
    /// \[m\]
    pub position: f64,
    /// \[m/s\]
    pub velocity: f64,
    /// \[m/s²\]
    pub acceleration: f64,
}

wraps! { Stamp, Trust }

state! { whole [] AxisState { position, velocity, acceleration } }

impl AxisState {
    /// At rest at `position` \[m\].
    #[must_use]
    pub const fn at_rest(position: f64) -> Self {
        Self { position, velocity: 0.0, acceleration: 0.0 }
    }

    /// The state after `seconds` of constant `jerk` \[m/s³\].
    #[must_use]
    pub fn advanced(&self, jerk: f64, seconds: f64) -> Self {
        let t = seconds;
        Self {
            position: self.position + t * (self.velocity + t * (self.acceleration / 2.0 + t * jerk / 6.0)),
            velocity: self.velocity + t * (self.acceleration + t * jerk / 2.0),
            acceleration: self.acceleration + t * jerk,
        }
    }

    /// All three numbers are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.velocity.is_finite() && self.acceleration.is_finite()
    }
}
