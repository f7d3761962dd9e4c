//! The limits of one axis as rows over the horizon: jerk hard; acceleration, velocity and position soft.
//!
//! Soft means exact L1 penalty: the limit holds wherever it can hold (and its force stays below the penalty),
//! and a start outside still has a best plan. All rows are two-sided, in normalised units.

use super::cost::Cost;
use super::model::{MotionRows, Scale, rollout};
use crate::qp::dual::{Bounds, Gram, Rows};
use crate::units::AxisState;

/// Limits of one axis of the writing plane's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisLimits {
    /// Largest |jerk| \[m/s³\]; never exceeded.
    pub jerk_mps3: f64,
    /// Largest |acceleration| \[m/s²\].
    pub acceleration_mps2: f64,
    /// Largest |velocity| \[m/s\].
    pub velocity_mps: f64,
    /// Lowest and highest position \[m\].
    pub position_m: [f64; 2],
}

impl AxisLimits {
    /// How far `state` still moves in the direction `sign` (±1) under full braking \[m\].
    ///
    /// A state that already brakes harder than its limit is assumed to continue so.
    #[must_use]
    pub fn braking_m(&self, state: &AxisState, sign: f64) -> f64 {
        let Self { jerk_mps3: jerk, acceleration_mps2: most, .. } = *self;
        if jerk == f64::INFINITY {
            return 0.0;
        }
        let (velocity, acceleration) = (sign * state.velocity, sign * state.acceleration);
        let after = |t: f64| t * (velocity + t * (acceleration / 2.0 - jerk * t / 6.0));
        let braking = most.max(-acceleration);
        let turned = (acceleration + braking) / jerk;
        let left = velocity + turned * (acceleration - jerk * turned / 2.0);
        if left > 0.0 {
            return (after(turned) + left * left / (2.0 * braking)).max(0.0);
        }
        // It comes to rest before its acceleration has reversed, or moves the other way all the time.
        let stands = (acceleration + (acceleration * acceleration + 2.0 * jerk * velocity).sqrt()) / jerk;
        after(stands.max(0.0)).max(0.0)
    }
}

/// ρ of the exact penalty: what one unit of violation adds to ½J, per step; normalised units.
///
/// Limits are kept exactly as long as their multipliers stay below ρ. The pull of an error e \[mm\] on the
/// acceleration at the start of the horizon is about G² e N³/6 in ½J, so ρ decides up to which error a limit
/// holds; beyond, the optimum trades violation for error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SoftPenalty {
    /// \[1/(mm/Δ²)\]
    pub acceleration: f64,
    /// \[1/(mm/Δ)\]
    pub velocity: f64,
    /// \[1/mm\]
    pub position: f64,
}

impl SoftPenalty {
    /// Acceleration before velocity before position if they conflict: motors trip on the first, while the
    /// joint limits of IK and guard still protect the last.
    pub const DEFAULT: Self = Self { acceleration: 1e6, velocity: 1e6, position: 1e6 };
}

impl Default for SoftPenalty {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// The rows of `limits` with positions relative to zero.
pub(super) fn rows<const N: usize>(
    limits: &AxisLimits,
    scale: &Scale,
    penalty: &SoftPenalty,
    cost: &Cost<N>,
) -> Bounds<4, N> {
    let largest = [
        limits.jerk_mps3 * scale.jerk,
        limits.acceleration_mps2 * scale.acceleration,
        limits.velocity_mps * scale.velocity,
    ];
    let [jerk, acceleration, velocity] = largest.map(|value| [value; N]);
    let [lowest, highest] = limits.position_m.map(|value| [value * scale.position; N]);
    let lower = [jerk.map(|j| -j), acceleration.map(|a| -a), velocity.map(|v| -v), lowest];
    let upper = [jerk, acceleration, velocity, highest];
    let penalty =
        [f64::INFINITY, penalty.acceleration, penalty.velocity, penalty.position].map(|rho| [rho; N]);
    Bounds { lower, upper, penalty, weight: selection(cost) }
}

/// 1/√G_ii of every row.
fn selection<const N: usize>(cost: &Cost<N>) -> Rows<4, N> {
    let influence = Influence(cost);
    let mut weight = [[1.0; N]; 4];
    let mut column = [[0.0; N]; 4];
    for (row, weight) in weight.as_flattened_mut().iter_mut().enumerate() {
        influence.column(row, &mut column);
        if let Some(diagonal) = column.as_flattened().get(row) {
            *weight = 1.0 / diagonal.sqrt();
        }
    }
    weight
}

/// Every row keeps its limit; `false` for NaN.
#[must_use]
#[inline]
pub(super) fn inside<const N: usize>(motion: &MotionRows<N>, bounds: &Bounds<4, N>) -> bool {
    let limits = bounds.lower.as_flattened().iter().zip(bounds.upper.as_flattened());
    let mut kept = true;
    for (r, (lower, upper)) in motion.as_flattened().iter().zip(limits) {
        kept &= r >= lower && r <= upper;
    }
    kept
}

/// Columns of C̃ H⁻¹ C̃ᵀ on demand: a backward sweep of a unit force, H⁻¹, a forward sweep. The jerk block of
/// a column is H⁻¹ c, which is how the jerks follow the multipliers.
pub(super) struct Influence<'a, const N: usize>(pub &'a Cost<N>);

impl<const N: usize> Gram<4, N> for Influence<'_, N> {
    #[inline]
    fn column(&self, row: usize, out: &mut MotionRows<N>) {
        let Self(cost) = self;
        let jerks = if let Some(column) = cost.inverse().get(row) {
            *column
        } else {
            let mut force = [[0.0; N]; 4];
            if let Some(entry) = force.as_flattened_mut().get_mut(row) {
                *entry = 1.0;
            }
            cost.solve(&super::model::adjoint(&force))
        };
        *out = rollout(&[0.0; 3], &jerks);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: AxisLimits =
        AxisLimits { jerk_mps3: 800.0, acceleration_mps2: 12.0, velocity_mps: 1.0, position_m: [-0.2, 0.2] };

    /// Against braking in steps of a microsecond.
    #[test]
    fn braking_takes_as_far_as_full_jerk_and_acceleration_need() {
        let limits = LIMITS;
        let (jerk, most, step_s) = (limits.jerk_mps3, limits.acceleration_mps2, 1e-6);
        for velocity in [-0.7, -0.3, -0.02, 0.0, 0.05, 0.4, 0.9] {
            for acceleration in [-1.5, -1.0, -0.4, 0.0, 0.7, 1.0, 1.5, 5.0].map(|part| part * most) {
                for sign in [1.0, -1.0] {
                    let (mut x, mut v, mut a) = (0.0_f64, velocity, acceleration);
                    let mut farthest = 0.0_f64;
                    while v > 0.0 || a > -most {
                        x += v * step_s;
                        v += a * step_s;
                        a = (a - jerk * step_s).max(a.min(-most));
                        farthest = farthest.max(x);
                    }
                    let state = AxisState {
                        position: 0.1,
                        velocity: sign * velocity,
                        acceleration: sign * acceleration,
                    };
                    let far = limits.braking_m(&state, sign);
                    assert!(
                        (far - farthest).abs() < 2e-6 + 1e-4 * farthest,
                        "{velocity} {acceleration}: {far} of {farthest} m"
                    );
                }
            }
        }
        let off = AxisLimits { jerk_mps3: f64::INFINITY, acceleration_mps2: f64::INFINITY, ..limits };
        assert_eq!(off.braking_m(&AxisState { position: 0.0, velocity: 1.0, acceleration: 5.0 }, 1.0), 0.0);
    }
}
