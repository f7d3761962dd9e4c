//! The jerk-limited stop: joint velocities to exactly zero from any motion, one tick at a time.
//!
//! Contract: no allocation; finite input gives velocities inside the velocity box of [`crate::arm::limits`].
//! Position and acceleration limits win over jerk. Joints stop independently of each other, each as early as
//! its limits allow.

use super::Commanded;
use crate::arm::limits::{JointLimits, slowed, stop_jerk, velocity_box};
use crate::units::Stamp;

/// A joint faster than alone by less than this \[rad/s\] is not held up: rounding.
const BEHIND_RADPS: f64 = 1e-6;

/// Brings an arm to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StopProfile<const J: usize> {
    limits: JointLimits<J>,
    jerk: [f64; J],
}

impl<const J: usize> StopProfile<J> {
    /// A stop at the consumer's deceleration and inside the jerk limit; where the limits have none, inside
    /// [`stop_jerk`].
    #[must_use]
    pub fn new(limits: JointLimits<J>) -> Self {
        Self { limits, jerk: stop_jerk(&limits) }
    }

    /// Jerk limits of the stop, per joint \[rad/s³\].
    #[must_use]
    pub const fn jerk(&self) -> &[f64; J] {
        &self.jerk
    }

    /// Joint velocities \[rad/s\] from `last` to `stamp`; repeated, they end at exactly zero and stay there.
    ///
    /// The next position is q + q̇·(stamp − last.stamp). A stamp not after the last one asks for no change of
    /// velocity.
    #[must_use]
    pub fn next(&self, last: &Commanded<J>, stamp: Stamp) -> [f64; J] {
        self.slower(last, stamp, self.limits.deceleration())
    }

    /// The same for a stop that rows held up: a joint that is faster than it would be by itself (`alone`
    /// \[rad/s\]) brakes with its whole acceleration, to rest hardly later.
    #[must_use]
    pub fn next_held_up(&self, last: &Commanded<J>, stamp: Stamp, alone: &[f64; J]) -> [f64; J] {
        let mut braking = *self.limits.deceleration();
        let speeds = last.qd().iter().zip(alone);
        for ((braking, most), (qd, alone)) in braking.iter_mut().zip(self.limits.acceleration()).zip(speeds) {
            if qd.abs() > alone.abs() + BEHIND_RADPS {
                *braking = *most;
            }
        }
        self.slower(last, stamp, &braking)
    }

    fn slower(&self, last: &Commanded<J>, stamp: Stamp, deceleration: &[f64; J]) -> [f64; J] {
        let h = stamp.seconds_since(last.stamp());
        let mut qd = *last.qd();
        if h <= 0.0 {
            return qd;
        }
        for ((v, a), (decel, jerk)) in qd.iter_mut().zip(last.qdd()).zip(deceleration.iter().zip(&self.jerk))
        {
            *v = slowed(*v, *a, h, *decel, *jerk);
        }
        let mut allowed = velocity_box(last.motion(), &self.limits, h).nearest(&qd);
        for (v, wanted) in allowed.iter_mut().zip(&qd) {
            // Bounds are rounded too: rest must not become a creeping 1e-16.
            if *wanted == 0.0 && v.abs() <= 1e-12 {
                *v = 0.0;
            }
        }
        allowed
    }

    /// True when nothing moves and nothing accelerates any more.
    #[must_use]
    pub fn is_done(last: &Commanded<J>) -> bool {
        last.qd().iter().chain(last.qdd()).all(|v| *v == 0.0)
    }
}
