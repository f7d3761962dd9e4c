//! Where a consumer without commands comes to rest.

use super::chain::{Chain, Kinematics};
use super::limits::{JointLimits, JointMotion, VelocityBox};

/// Where a consumer comes to rest that receives nothing after the next command, if that continues the last.
pub(crate) struct Silence<const J: usize> {
    pub(crate) kinematics: Kinematics<J>,
    /// Change of that position per change of the next velocity, per joint \[s\].
    pub(crate) gain: [f64; J],
}

impl<const J: usize> Silence<J> {
    /// q + q̇(h + hold) + q̇|q̇|/(2a_b), every joint braking independently, and h + hold + |q̇|/a_b.
    pub(crate) fn after(
        chain: &Chain<J>,
        limits: &JointLimits<J>,
        motion: &JointMotion<J>,
        elapsed: f64,
    ) -> Self {
        let (mut q, mut gain) = (motion.q, [elapsed + limits.hold_s(); J]);
        let joints = q.iter_mut().zip(&mut gain).zip(motion.qd.iter().zip(limits.deceleration()));
        for ((q, gain), (qd, decel)) in joints {
            *q += qd * (*gain + 0.5 * qd.abs() / decel);
            *gain += qd.abs() / decel;
        }
        Self { kinematics: chain.forward(&q), gain }
    }

    /// Largest rotation of each joint until then, for any next velocity in the box \[rad\].
    pub(crate) fn farthest(
        limits: &JointLimits<J>,
        motion: &JointMotion<J>,
        allowed: &VelocityBox<J>,
        elapsed: f64,
    ) -> [f64; J] {
        let mut angle = motion.qd.map(f64::abs);
        let fastest = allowed.lower.iter().zip(&allowed.upper).map(|(low, high)| low.abs().max(high.abs()));
        for ((angle, fastest), decel) in angle.iter_mut().zip(fastest).zip(limits.deceleration()) {
            let speed = angle.max(fastest);
            *angle = speed * (elapsed + limits.hold_s() + 0.5 * speed / decel);
        }
        angle
    }
}
