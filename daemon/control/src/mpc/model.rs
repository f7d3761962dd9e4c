//! The triple integrator of one axis in normalised units, and its two sweeps.
//!
//! Length in mm, velocity · Δ, acceleration · Δ², jerk · Δ³: A and B are then the same numbers for every Δ,
//! and so is every matrix built from them. (In SI units an interior-point solver reports success with jerks
//! wrong by a fifth.) Jerk u_j acts over step j, inputs j = 0..N−1, states i = 1..N.

use crate::qp::dual::Rows;
use crate::units::AxisState;

/// Position, velocity, acceleration; normalised.
pub type AxisVector = [f64; 3];

/// Per step along the horizon: jerk u_{i−1}, then acceleration, velocity and position of x_i; normalised.
/// The blocks of every row vector stand in this order.
pub type MotionRows<const N: usize> = Rows<4, N>;

/// x_{i+1} = A x_i + B u_i.
pub const A: [[f64; 3]; 3] = [[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]];
/// See [`A`].
pub const B: AxisVector = [1.0 / 6.0, 0.5, 1.0];

/// Factors from SI to normalised units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// \[mm/m\]
    pub position: f64,
    /// \[mm/step per m/s\]
    pub velocity: f64,
    /// \[mm/step² per m/s²\]
    pub acceleration: f64,
    /// \[mm/step³ per m/s³\]
    pub jerk: f64,
    /// \[m/s³ per mm/step³\]
    pub jerk_inverse: f64,
}

impl Scale {
    /// For grid step Δ = `step_s` \[s\] > 0.
    #[must_use]
    pub fn new(step_s: f64) -> Self {
        let velocity = 1e3 * step_s;
        let acceleration = velocity * step_s;
        let jerk = acceleration * step_s;
        Self { position: 1e3, velocity, acceleration, jerk, jerk_inverse: 1.0 / jerk }
    }

    /// `state` with its position counted from `origin_m`: keeps the digits of millimetres far from zero.
    #[must_use]
    #[inline]
    pub fn normalised(&self, state: &AxisState, origin_m: f64) -> AxisVector {
        [
            (state.position - origin_m) * self.position,
            state.velocity * self.velocity,
            state.acceleration * self.acceleration,
        ]
    }
}

/// The motion from `start` under `jerks`: the forward sweep.
#[must_use]
#[inline]
pub fn rollout<const N: usize>(start: &AxisVector, jerks: &[f64; N]) -> MotionRows<N> {
    let [mut p, mut v, mut a] = *start;
    let mut motion = [*jerks, [0.0; N], [0.0; N], [0.0; N]];
    let [_, accelerations, velocities, positions] = &mut motion;
    let states = accelerations.iter_mut().zip(velocities).zip(positions);
    for (u, ((acceleration, velocity), position)) in jerks.iter().zip(states) {
        p += v + (0.5 * a + u * (1.0 / 6.0));
        v += a + 0.5 * u;
        a += u;
        *acceleration = a;
        *velocity = v;
        *position = p;
    }
    motion
}

/// B̃ᵀ f for `force` f on the states (its jerk block passes through): the backward sweep.
#[must_use]
#[inline]
pub fn adjoint<const N: usize>(force: &MotionRows<N>) -> [f64; N] {
    let [jerk, on_acceleration, on_velocity, on_position] = force;
    let mut gradient = *jerk;
    let [mut p, mut v, mut a] = [0.0; 3];
    let forces = on_acceleration.iter().zip(on_velocity).zip(on_position);
    for (entry, ((fa, fv), fp)) in gradient.iter_mut().zip(forces).rev() {
        // λ_i = f_i + Aᵀ λ_{i+1}
        a += v + (0.5 * p + fa);
        v += p + fv;
        p += fp;
        *entry += p * (1.0 / 6.0) + (0.5 * v + a);
    }
    gradient
}
