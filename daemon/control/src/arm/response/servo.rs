//! A servo of second order with any damping, exact over steps in which its target moves on a straight line.
//!
//! Contract: y + a₁ẏ + a₂ÿ = u. In the frame that follows the ramp at its steady distance a₁u̇ the motion is
//! homogeneous; its transition matrix is the exponential in closed form. Pure, total for finite a₁, a₂.

use crate::arm::track::JointTrack;
use crate::state::state;

/// The least a₂, in units of the step: a time constant of a fifth of it, which has died out after one.
const LEAST_A2: f64 = 0.04;
/// The least a₂ as a share of a₁²: a damping ratio of 3.
const LEAST_SHARE: f64 = 1.0 / 36.0;

/// The coefficients and the transition over one step; times in units of that step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SecondOrder {
    pub(crate) a1: f64,
    pub(crate) a2: f64,
    transition: [[f64; 2]; 2],
}

state! { whole [] SecondOrder { a1, a2, transition } }

impl SecondOrder {
    /// With a₁ and a₂ in steps; a₂ is raised to what one step resolves.
    pub(crate) fn new(a1: f64, a2: f64) -> Self {
        let stiff = a2.max(LEAST_A2).max(LEAST_SHARE * a1 * a1);
        let alpha = 0.5 * a1 / stiff;
        let discriminant = alpha * alpha - 1.0 / stiff;
        // e^{-α} cos β and e^{-α} sin β / β, or the same with cosh and sinh.
        let (cosine, sine) = if discriminant < 0.0 {
            let beta = (-discriminant).sqrt();
            let decay = (-alpha).exp();
            (decay * beta.cos(), decay * beta.sin() / beta)
        } else {
            let gamma = discriminant.sqrt();
            let (slow, fast) = ((gamma - alpha).exp(), (-gamma - alpha).exp());
            let sine = if gamma > 1e-6 { (slow - fast) / (2.0 * gamma) } else { (-alpha).exp() };
            (0.5 * (slow + fast), sine)
        };
        let transition = [[cosine + alpha * sine, sine], [-sine / stiff, cosine - alpha * sine]];
        Self { a1, a2, transition }
    }

    /// Critically damped or not: group delay 2 ζ / ω of `group` steps, damping ratio `damping`.
    pub(crate) fn damped(group: f64, damping: f64) -> Self {
        let period = group / (2.0 * damping);
        Self::new(group, period * period)
    }

    /// Position and velocity (per step) after a step in which the target went from `from` to `to`.
    pub(crate) fn step(&self, [y, yd]: [f64; 2], from: f64, to: f64) -> [f64; 2] {
        let slope = to - from;
        let lag = self.a1 * slope;
        let (e, ed) = (y - (from - lag), yd - slope);
        let [[ee, eed], [ede, eded]] = self.transition;
        [to - lag + ee * e + eed * ed, slope + ede * e + eded * ed]
    }
}

/// A servo behind a delay of whole grid steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Delayed {
    pub(super) delay: usize,
    pub(super) servo: SecondOrder,
}

state! { whole [] Delayed { delay, servo } }

impl Delayed {
    /// Positions \[rad\] and velocities \[rad per grid step\] at grid index `k`, of joints that stood, or
    /// went on as they did, before the commands that are kept.
    pub(super) fn after<const J: usize>(
        &self,
        commands: &JointTrack<J>,
        k: u64,
    ) -> Option<([f64; J], [f64; J])> {
        let mut newest = None;
        self.each(commands, k, |_, joints| newest = Some(*joints));
        newest.map(|joints| (joints.map(|[y, _]| y), joints.map(|[_, yd]| yd)))
    }

    /// Position and velocity of each joint at every grid index from the first that is known to `k`.
    pub(super) fn each<const J: usize>(
        &self,
        commands: &JointTrack<J>,
        k: u64,
        mut visit: impl FnMut(u64, &[[f64; 2]; J]),
    ) {
        let (oldest, delay) = (commands.begin(), self.delay as u64);
        let last = k.saturating_sub(delay).max(oldest);
        let Some(mut from) = commands.at(oldest) else { return };
        let ahead = commands.at(oldest + 1).unwrap_or(from);
        let mut joints = [[0.0; 2]; J];
        for (joint, (from, ahead)) in joints.iter_mut().zip(from.iter().zip(ahead)) {
            // The steady distance behind the ramp; nothing where the commands begin with standing still.
            *joint = [from - self.servo.a1 * (ahead - from), ahead - from];
        }
        visit(oldest + delay, &joints);
        // At most as many turns as the track keeps grid points.
        for index in oldest + 1..=last {
            let Some(to) = commands.at(index) else { return };
            for (joint, (from, to)) in joints.iter_mut().zip(from.iter().zip(to)) {
                *joint = self.servo.step(*joint, *from, *to);
            }
            from = to;
            visit(index + delay, &joints);
        }
    }
}
