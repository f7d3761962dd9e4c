//! The plan as linear feedback: its response to a small deviation, far from every limit. For start-up.
//!
//! Contract: ignores all limits, whatever the settings; both answers come from the gains of the usual tick.
//! Source of the criterion: a linear map x ↦ Mx decays exactly if all eigenvalues of M lie inside the unit
//! circle.

use nalgebra::{SMatrix, SVector, Schur};

use super::{Mpc, MpcError, Plan};
use crate::arm::servo::ServoModel;
use crate::units::{AxisState, Trust};

/// Position, velocity and acceleration of the command, position and velocity of the arm.
const STATES: usize = 5;
/// Trusts at which a plan must settle: a blend of two costs that both settle need not.
const TRUSTS: [f64; 10] = [0.0, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0];

/// The map of a deviation over one period; normalised units.
type Map = SMatrix<f64, STATES, STATES>;

impl<const N: usize> Mpc<N> {
    /// Steady-state lag \[s\] of the arm behind a target at constant velocity, under feedback alone that
    /// plans again every `period_s` \[s\]. NaN if there is no steady state.
    #[must_use]
    pub fn feedback_lag_s(&mut self, period_s: f64) -> f64 {
        let Some([map, ..]) = self.maps(Trust::NONE, period_s) else { return f64::NAN };
        // The target moves by one unit per period.
        let moved = SVector::from([1.0, 0.0, 0.0, if self.servo_s > 0.0 { 1.0 } else { 0.0 }, 0.0]);
        let steady = (map - Map::identity()).lu().solve(&moved);
        let behind = if self.servo_s > 0.0 { 3 } else { 0 };
        steady.and_then(|state| state.get(behind).copied()).map_or(f64::NAN, |offset| -offset * period_s)
    }

    /// Whether the plan settles: a deviation from a target at rest decays if every tick of `period_s` \[s\]
    /// plans again, on every axis, at each of ten trusts. A plan with too short a horizon does not foresee
    /// that it will overshoot.
    ///
    /// # Errors
    /// [`MpcError::Swings`] if a deviation stays or grows; a cost that cannot be inverted.
    pub fn settles(&mut self, period_s: f64) -> Result<(), MpcError> {
        for alpha in TRUSTS {
            let maps = self.maps(Trust::new(alpha), period_s).ok_or(MpcError::Singular { axis: 0 })?;
            for (axis, growth) in maps.map(growth).into_iter().enumerate() {
                if !(growth < 1.0) {
                    return Err(MpcError::Swings { axis, alpha, per_s: growth.powf(1.0 / period_s) });
                }
            }
        }
        Ok(())
    }

    /// Per axis; `None` where a cost cannot be inverted or the period is longer than the horizon.
    fn maps(&mut self, trust: Trust, period_s: f64) -> Option<[Map; 3]> {
        if !self.set_trust(trust) {
            return None;
        }
        let mut maps = [Map::zeros(); 3];
        let servo = ServoModel::new((self.servo_s * 1e9).round() as u64);
        let still = AxisState::at_rest(0.0);
        let [position, velocity, acceleration] = self.unit_deviations();
        // Without a servo the arm is at the command, and has no columns of its own.
        let begins = [
            (position, still),
            (velocity, still),
            (acceleration, still),
            (still, position),
            (still, velocity),
        ];
        for (column, (command, arm)) in begins.into_iter().enumerate() {
            let seen = if servo.is_some() { arm } else { command };
            let next = self.homing(command, seen).state_at(period_s)?;
            for (map, command_next) in maps.iter_mut().zip(next) {
                let arm_next = servo.map_or(still, |servo| {
                    servo.follow(&arm, command.position, command_next.position, period_s)
                });
                let [p, v, a] = self.scale.normalised(&command_next, 0.0);
                let [y, w, _] = self.scale.normalised(&arm_next, 0.0);
                map.set_column(column, &[p, v, a, y, w].into());
            }
        }
        Some(maps)
    }

    /// The plan without limits from `command` and `arm`, the same on all axes, to a target at rest at 0.
    fn homing(&self, command: AxisState, arm: AxisState) -> Plan<N> {
        let target = [AxisState::at_rest(0.0); 3];
        let optimum =
            self.free.solve(&self.scale, (&[command; 3], &[arm; 3]), &target, &target.map(|at| [at; N]));
        let jerks = [0, 1, 2].map(|axis| optimum.jerks(axis).map(|jerk| jerk * self.scale.jerk_inverse));
        Plan { step_s: self.step_s, start: [command; 3], jerks }
    }

    /// One unit (mm, steps) off in position, in velocity, in acceleration.
    fn unit_deviations(&self) -> [AxisState; 3] {
        let still = AxisState::at_rest(0.0);
        [
            AxisState { position: 1.0 / self.scale.position, ..still },
            AxisState { velocity: 1.0 / self.scale.velocity, ..still },
            AxisState { acceleration: 1.0 / self.scale.acceleration, ..still },
        ]
    }
}

/// Factor by which a deviation grows per period in the long run: the largest magnitude of an eigenvalue. NaN
/// if there is none.
fn growth(map: Map) -> f64 {
    let finite = map.iter().all(|value| value.is_finite());
    let schur = finite.then(|| Schur::try_new(map, f64::EPSILON, 10_000)).flatten();
    let larger = |most: f64, value: f64| if value > most || value.is_nan() { value } else { most };
    schur.map_or(f64::NAN, |schur| {
        schur.complex_eigenvalues().iter().map(|value| value.norm()).fold(0.0, larger)
    })
}
