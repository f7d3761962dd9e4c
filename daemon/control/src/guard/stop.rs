//! The jerk-limited stop: joint velocities to exactly zero from any motion, one tick at a time.
//!
//! Contract: no allocation; finite input gives velocities inside the velocity box of [`crate::arm::limits`].
//! Position and acceleration limits win over jerk. Joints stop independently of each other, each as early as
//! its limits allow.

use super::Commanded;
use crate::arm::limits::{JointLimits, stop_jerk, velocity_box};
use crate::units::Stamp;

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
        let h = stamp.seconds_since(last.stamp());
        let mut qd = *last.qd();
        if h <= 0.0 {
            return qd;
        }
        for ((v, a), (decel, jerk)) in
            qd.iter_mut().zip(last.qdd()).zip(self.limits.deceleration().iter().zip(&self.jerk))
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

/// The next velocity of one joint on its way to rest.
///
/// With braking b > 0 against v > 0, the largest b from which steps of `jerk`·h lead b to zero before v is
/// spent solves h·b + h·Σ_k max(b − k·jerk·h, 0) = v, piecewise linear in b: b = (v/h + jerk·h·n(n+1)/2) / (n
/// + 1) where n jerk·h ≤ b. Braking along it is exact in discrete time: v and b reach zero at the same tick.
fn slowed(v: f64, a: f64, h: f64, decel: f64, jerk: f64) -> f64 {
    let speed = v.abs();
    // At rest the braking direction opposes the remaining acceleration.
    let sign = if v != 0.0 { v.signum() } else { -a.signum() };
    let braking = -a * sign;
    let step = jerk * h;
    let exact = if step.is_finite() {
        let n = ((0.25 + 2.0 * speed / (step * h)).sqrt() - 0.5).floor().max(0.0);
        (speed / h + step * 0.5 * n * (n + 1.0)) / (n + 1.0)
    } else {
        speed / h
    };
    let wanted = exact.min(decel);
    // min and max rather than clamp: an infinite step must not make NaN bounds.
    let rate = if step.is_finite() { wanted.max(braking - step).min(braking + step) } else { wanted };
    if (rate * h - speed).abs() <= 1e-12 {
        return 0.0;
    }
    v - sign * rate * h
}
