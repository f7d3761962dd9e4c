//! The arm's response to a plan if its servo is a filter: the cost concerns the arm, the limits concern the
//! command.
//!
//! Contract: the servo of `crate::arm::servo` sampled on the plan's grid, exact for commands of constant jerk
//! per step; normalised units (mm, steps). The arm's state is \[position, velocity\]. Absent: limits inside
//! the arm's own controller.

use std::ops::{Add, Mul};

use nalgebra::Matrix6;

use super::model::{AxisVector, MotionRows};
use crate::qp::cholesky::Square;
use crate::qp::dual::Rows;

/// A scalar, or one per axis.
pub(super) trait AxisScalar: Copy + Add<Output = Self> + Mul<f64, Output = Self> {}
impl<T: Copy + Add<Output = T> + Mul<f64, Output = T>> AxisScalar for T {}

/// Position and velocity of the arm; normalised.
pub(super) type ArmState<T> = [T; 2];

/// The sampled servo, see the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Behind {
    /// Next arm state for each entry of this one.
    arm: [ArmState<f64>; 2],
    /// Next arm state for each of position, velocity and acceleration of the command at the step's beginning,
    /// and its jerk.
    command: [ArmState<f64>; 4],
    /// ω² and 2ω \[1/step², 1/step\].
    spring: f64,
    damping: f64,
}

impl Behind {
    /// Critically damped second order with group delay 2/ω = `group_delay_s` > 0, in steps of `step_s` \[s\].
    #[must_use]
    #[expect(clippy::indexing_slicing, reason = "indices are constants within the matrix")]
    pub fn new(group_delay_s: f64, step_s: f64) -> Self {
        let omega = 2.0 * step_s / group_delay_s;
        let (spring, damping) = (omega * omega, 2.0 * omega);
        #[rustfmt::skip]
        let rates = Matrix6::new(
            0.0,     1.0,      0.0,    0.0, 0.0, 0.0,
            -spring, -damping, spring, 0.0, 0.0, 0.0,
            0.0,     0.0,      0.0,    1.0, 0.0, 0.0,
            0.0,     0.0,      0.0,    0.0, 1.0, 0.0,
            0.0,     0.0,      0.0,    0.0, 0.0, 1.0,
            0.0,     0.0,      0.0,    0.0, 0.0, 0.0,
        );
        let step = rates.exp();
        let of = |input: usize| [step[(0, input)], step[(1, input)]];
        Self { arm: [0, 1].map(of), command: [2, 3, 4, 5].map(of), spring, damping }
    }

    /// The arm one step later.
    #[inline(always)]
    pub(super) fn ahead<T: AxisScalar>(&self, [y, w]: ArmState<T>, [p, v, a]: [T; 3], u: T) -> ArmState<T> {
        let ([[yy, yw], [wy, ww]], [[py, pw], [vy, vw], [ay, aw], [uy, uw]]) = (self.arm, self.command);
        [
            (y * yy + w * wy) + ((p * py + v * vy) + (a * ay + u * uy)),
            (y * yw + w * ww) + ((p * pw + v * vw) + (a * aw + u * uw)),
        ]
    }

    /// Forces on (arm, command, jerk) before a step from a force on the arm after it: the transpose of
    /// [`Self::ahead`].
    #[inline(always)]
    pub(super) fn ahead_transposed<T: AxisScalar>(&self, [fy, fw]: ArmState<T>) -> (ArmState<T>, [T; 3], T) {
        let of = |[y, w]: ArmState<f64>| fy * y + fw * w;
        let [p, v, a, u] = self.command.map(of);
        (self.arm.map(of), [p, v, a], u)
    }

    /// Acceleration, velocity and position of the arm, with the command at `p`.
    #[inline(always)]
    pub(super) fn seen<T: AxisScalar>(&self, [y, w]: ArmState<T>, p: T) -> [T; 3] {
        [(p * self.spring + y * -self.spring) + w * -self.damping, w, y]
    }

    /// Forces on the arm and on the command's position from forces on what is seen: the transpose of
    /// [`Self::seen`].
    #[inline(always)]
    pub(super) fn seen_transposed<T: AxisScalar>(&self, [fa, fw, fy]: [T; 3]) -> (ArmState<T>, T) {
        ([fy + fa * -self.spring, fw + fa * -self.damping], fa * self.spring)
    }

    /// The arm along `motion` from `start` and `arm`: acceleration, velocity, position per step.
    pub(super) fn along<const N: usize>(
        &self,
        start: &AxisVector,
        arm: ArmState<f64>,
        motion: &MotionRows<N>,
    ) -> Rows<3, N> {
        let [jerks, accelerations, velocities, positions] = motion;
        let mut rows = [[0.0; N]; 3];
        let [row_a, row_w, row_y] = &mut rows;
        let (mut command, mut arm) = (*start, arm);
        let states = jerks.iter().zip(accelerations).zip(velocities.iter().zip(positions));
        for (((u, a), (v, p)), ((ra, rw), ry)) in states.zip(row_a.iter_mut().zip(row_w).zip(row_y)) {
            arm = self.ahead(arm, command, *u);
            command = [*p, *v, *a];
            [*ra, *rw, *ry] = self.seen(arm, *p);
        }
        rows
    }

    /// Adds to `force` on a motion what `seen`, a force on the arm along it, comes to: the transpose of
    /// [`Self::along`].
    pub(super) fn along_transposed<const N: usize>(&self, seen: &Rows<3, N>, force: &mut MotionRows<N>) {
        let [seen_a, seen_w, seen_y] = seen;
        let [jerks, accelerations, velocities, positions] = force;
        let (mut on_arm, mut on_command) = ([0.0; 2], [0.0; 3]);
        let forces = seen_a.iter().zip(seen_w).zip(seen_y);
        let states = jerks.iter_mut().zip(accelerations).zip(velocities.iter_mut().zip(positions));
        for (((fa, fw), fy), ((u, a), (v, p))) in forces.zip(states).rev() {
            let ([on_y, on_w], on_position) = self.seen_transposed([*fa, *fw, *fy]);
            let [arm_y, arm_w] = on_arm;
            let [command_p, command_v, command_a] = on_command;
            *p += on_position + command_p;
            *v += command_v;
            *a += command_a;
            let (before, command, jerk) = self.ahead_transposed([arm_y + on_y, arm_w + on_w]);
            *u += jerk;
            (on_arm, on_command) = (before, command);
        }
    }

    /// The arm's response to jerks, per quantity (position, velocity, acceleration): N x N, row i−1 is step
    /// i, column j is u_j.
    #[must_use]
    pub fn responses<const N: usize>(&self) -> [Square<N>; 3] {
        let mut responses = [[[0.0; N]; N]; 3];
        for j in 0..N {
            let mut impulse = [0.0; N];
            if let Some(jerk) = impulse.get_mut(j) {
                *jerk = 1.0;
            }
            let motion = super::model::rollout(&[0.0; 3], &impulse);
            let answer = self.along(&[0.0; 3], [0.0; 2], &motion);
            for (response, row) in responses.iter_mut().zip(answer.iter().rev()) {
                for (to, value) in response.iter_mut().zip(row) {
                    if let Some(entry) = to.get_mut(j) {
                        *entry = *value;
                    }
                }
            }
        }
        responses
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::servo::ServoModel;
    use crate::mpc::model::rollout;
    use crate::units::AxisState;

    #[test]
    fn the_sampled_servo_is_the_servo_followed_in_small_steps() {
        let (step_s, group_delay_s) = (0.005, 0.030);
        let (behind, servo) =
            (Behind::new(group_delay_s, step_s), ServoModel::new((group_delay_s * 1e9) as u64).unwrap());
        let start = AxisState { position: 0.003, velocity: 0.2, acceleration: -3.0 };
        let mut fine = AxisState { position: 0.001, velocity: 0.1, acceleration: 0.0 };
        let arm = [fine.position * 1e3, fine.velocity * 1e3 * step_s];
        let (mut command, jerk, pieces) = (start, 400.0, 4000);
        for _ in 0..pieces {
            let next = command.advanced(jerk, step_s / f64::from(pieces));
            fine = servo.follow(&fine, command.position, next.position, step_s / f64::from(pieces));
            command = next;
        }
        let scale = crate::mpc::model::Scale::new(step_s);
        let [y, w] = behind.ahead(arm, scale.normalised(&start, 0.0), jerk * scale.jerk);
        assert!((y * 1e-3 - fine.position).abs() < 1e-11, "{y} {}", fine.position * 1e3);
        assert!((w * 1e-3 / step_s - fine.velocity).abs() < 1e-7);
        let [a, ..] = behind.seen([y, w], command.position * 1e3);
        assert!((a / scale.acceleration - fine.acceleration).abs() < 1e-4, "{a}");
    }

    #[test]
    fn transposes_are_transposes() {
        const N: usize = 12;
        let behind = Behind::new(0.03, 0.005);
        let noise = |k: usize| ((k * 37 + 11) % 23) as f64 / 11.5 - 1.0;
        let jerks: [f64; N] = std::array::from_fn(noise);
        let motion = rollout(&[0.0; 3], &jerks);
        let force: Rows<3, N> = std::array::from_fn(|b| std::array::from_fn(|i| noise(5 + b * N + i)));
        let seen = behind.along(&[0.0; 3], [0.0; 2], &motion);
        let forward: f64 = seen.as_flattened().iter().zip(force.as_flattened()).map(|(a, b)| a * b).sum();
        let mut on_motion = [[0.0; N]; 4];
        behind.along_transposed(&force, &mut on_motion);
        let gradient = crate::mpc::model::adjoint(&on_motion);
        let backward: f64 = gradient.iter().zip(jerks).map(|(a, b)| a * b).sum();
        assert!((forward - backward).abs() < 1e-9 * forward.abs().max(1.0), "{forward} {backward}");
    }
}
