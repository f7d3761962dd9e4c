//! The response that fits the arm as a whole, and where it would have every joint now.
//!
//! Contract: all joints of an arm answer their commands in the same way: after a delay, through a servo of
//! second order. The estimator takes that answer from commands and joint states in normal operation, from
//! the joints that agree with each other: up to two that do not are left out, so that a faulty joint cannot
//! explain itself. [`Expected`] is what the arm's own answer makes of the commands. Pure, total, no
//! allocation; bounded work, once per grid step of 10 ms. Absent: gravity, saturation, joints with answers of
//! their own.

mod fit;
mod servo;

use crate::arm::track::{GRID_NS, GRID_S, JointTrack};
use crate::state::state;
use crate::units::Stamp;

use fit::ResponseFit;
pub(crate) use servo::SecondOrder;

/// Grid steps until what a servo did before the commands that are kept has died out.
const SETTLING: u64 = 24;

/// Where the arm's own response to the commands has the joints, and where they were measured, at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Expected<const J: usize> {
    /// Instant of the grid that it is about.
    pub stamp: Stamp,
    /// Expected positions \[rad\] and velocities \[rad/s\].
    pub q: [f64; J],
    /// See `q`.
    pub qd: [f64; J],
    /// Measured positions \[rad\].
    pub measured: [f64; J],
    /// Residual of the joints that agree, root of the mean square, in the band of the fit \[rad\].
    pub residual_rad: f64,
}

state! { whole [const J: usize] Expected<J> { stamp, q, qd, measured, residual_rad } }

/// Delay and servo of second order: H(s) = exp(−s d) / (1 + a₁ s + a₂ s²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shape {
    /// d \[s\].
    pub delay_s: f64,
    /// a₁ \[s\], the servo's group delay at low frequency, 2 ζ / ω.
    pub servo_s: f64,
    /// a₂ \[s²\], 1 / ω².
    pub inertia_s2: f64,
}

impl Shape {
    /// Damping ratio ζ of the servo; 1 where it is no filter.
    #[must_use]
    pub fn damping(&self) -> f64 {
        if self.inertia_s2 > 0.0 { 0.5 * self.servo_s / self.inertia_s2.sqrt() } else { 1.0 }
    }
}

/// Estimates the response of an arm of `J` joints.
#[derive(Debug, Clone)]
pub(in crate::arm) struct Response<const J: usize> {
    fit: ResponseFit<J>,
    expected: Option<Expected<J>>,
}

state! { [const J: usize] Response<J> { fit, expected } }

impl<const J: usize> Response<J> {
    pub(in crate::arm) fn new() -> Self {
        Self { fit: ResponseFit::new(), expected: None }
    }

    /// A gap in commands or joint states; `keep`: the share of the evidence that remains.
    pub(in crate::arm) fn break_off(&mut self, keep: f64) {
        self.fit.break_off(keep);
        self.expected = None;
    }

    /// The joints were `measured` at grid index `k`; `motion` in \[0, 1\]: how much the arm was asked to
    /// move.
    pub(in crate::arm) fn add(&mut self, k: u64, measured: &[f64; J], commands: &JointTrack<J>, motion: f64) {
        let Some(commanded) = commands.at(k) else { return };
        self.fit.add(measured, commanded, motion);
        self.expected = self.fit.best().and_then(|found| {
            let (q, qd) = found.shape.after(commands, k)?;
            let (stamp, measured) = (Stamp(k.saturating_mul(GRID_NS)), *measured);
            let qd = qd.map(|step| step / GRID_S);
            Some(Expected { stamp, q, qd, measured, residual_rad: found.residual_rad })
        });
    }

    /// The newest instant; `None` while the response is unknown.
    pub(in crate::arm) fn expected(&self) -> Option<&Expected<J>> {
        self.expected.as_ref()
    }

    /// The instants that are kept, the oldest first, as the response known now has them: what was not known
    /// while they passed. The first few are left out where the commands go back farther than is kept.
    pub(in crate::arm) fn past(
        &self,
        commands: &JointTrack<J>,
        joints: &JointTrack<J>,
        mut visit: impl FnMut(&Expected<J>),
    ) {
        let (Some(found), Some(newest)) = (self.fit.best(), self.expected.as_ref()) else { return };
        let k = newest.stamp.0 / GRID_NS;
        let settled = if commands.whole() { 0 } else { commands.begin() + SETTLING };
        found.shape.each(commands, k, |at, states| {
            let Some(measured) = joints.at(at).filter(|_| at >= settled) else { return };
            let (stamp, measured) = (Stamp(at.saturating_mul(GRID_NS)), *measured);
            let (q, qd) = (states.map(|[q, _]| q), states.map(|[_, qd]| qd / GRID_S));
            visit(&Expected { stamp, q, qd, measured, residual_rad: found.residual_rad });
        });
    }

    /// The response; `None` while it is unknown.
    pub(in crate::arm) fn shape(&self) -> Option<Shape> {
        let shape = self.fit.best()?.shape;
        Some(Shape {
            delay_s: shape.delay as f64 * GRID_S,
            servo_s: shape.servo.a1 * GRID_S,
            inertia_s2: shape.servo.a2 * GRID_S * GRID_S,
        })
    }
}

#[cfg(test)]
mod tests;
