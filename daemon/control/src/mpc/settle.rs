//! The plan as linear feedback: what it makes of a small deviation, far from every limit. For start-up.
//!
//! Contract: no limit counts here, whatever the settings; both answers come from the gains that the usual tick uses.
//! Source of the criterion: a linear map x ↦ Mx dies away exactly if all eigenvalues of M lie inside the unit circle.

use nalgebra::{SMatrix, Schur};

use super::{Mpc, MpcError, Plan};
use crate::servo::Servo;
use crate::units::{AxisState, Trust};

/// Position, velocity and acceleration of the command, position and velocity of the arm.
const STATES: usize = 5;
/// Size of a deviation in every quantity [mm, steps].
const OFF: f64 = 1.0;
/// Trusts at which a plan has to settle: either cost alone, and half of both.
const TRUSTS: [f64; 3] = [0.0, 0.5, 1.0];

impl<const N: usize> Mpc<N> {
    /// By how much feedback alone lags behind a target that moves steadily [s]: it goes on as it is where what the error asks for
    /// is what the velocity costs. NaN where a cost cannot be inverted.
    #[must_use]
    pub fn feedback_lag_s(&mut self) -> f64 {
        if !self.set_trust(Trust::NONE) {
            return f64::NAN;
        }
        let [by_error, by_velocity, ..] = self.unit_deviations().map(|off| {
            let [jerks, ..] = self.homing(off, off).jerks;
            jerks.first().copied().unwrap_or(f64::NAN)
        });
        self.step_s * by_velocity / by_error
    }

    /// The plan settles: a deviation from a target at rest dies away where every tick of `period_s` [s] plans anew, at trust
    /// 0, ½ and 1, on every axis. With a horizon that is short for its gains it does not: the plan never sees that it will
    /// swing back.
    ///
    /// # Errors
    /// [`MpcError::Swings`] where a deviation stays or grows.
    pub fn settles(&mut self, period_s: f64) -> Result<(), MpcError> {
        for alpha in TRUSTS {
            let growth = self.growth(Trust::new(alpha), period_s);
            if let Some(axis) = growth.iter().position(|growth| !(*growth < 1.0)) {
                let per_s = growth.get(axis).map_or(f64::NAN, |growth| growth.powf(1.0 / period_s));
                return Err(MpcError::Swings { axis, alpha, per_s, horizon_s: self.step_s * N as f64 });
            }
        }
        Ok(())
    }

    /// By what a deviation is multiplied in each period in the long run, per axis: the largest eigenvalue's magnitude. NaN where
    /// there is none.
    fn growth(&mut self, trust: Trust, period_s: f64) -> [f64; 3] {
        let mut maps = [SMatrix::<f64, STATES, STATES>::zeros(); 3];
        if !self.set_trust(trust) {
            return [f64::NAN; 3];
        }
        let servo = Servo::new((self.servo_s * 1e9).round() as u64);
        let still = AxisState::at_rest(0.0);
        let [position, velocity, acceleration] = self.unit_deviations();
        // Without a servo the arm is where the command is, and has no columns of its own.
        let begins = [
            (position, still),
            (velocity, still),
            (acceleration, still),
            (still, position),
            (still, velocity),
        ];
        for (column, (command, arm)) in begins.into_iter().enumerate() {
            let seen = if servo.is_some() { arm } else { command };
            let Some(next) = self.homing(command, seen).state_at(period_s) else { return [f64::NAN; 3] };
            for (map, command_next) in maps.iter_mut().zip(next) {
                let arm_next = servo.map_or(still, |servo| {
                    servo.follow(&arm, command.position, command_next.position, period_s)
                });
                let [p, v, a] = self.scale.normalised(&command_next, 0.0);
                let [y, w, _] = self.scale.normalised(&arm_next, 0.0);
                map.set_column(column, &([p, v, a, y, w].map(|value| value / OFF).into()));
            }
        }
        maps.map(|map| {
            let finite = map.iter().all(|value| value.is_finite());
            let schur = finite.then(|| Schur::try_new(map, f64::EPSILON, 10_000)).flatten();
            schur.map_or(f64::NAN, |schur| {
                schur.complex_eigenvalues().iter().map(|value| value.norm()).fold(0.0, f64::max)
            })
        })
    }

    /// The plan without limits from `command` and `arm`, the same on all axes, to a target at rest at 0.
    fn homing(&self, command: AxisState, arm: AxisState) -> Plan<N> {
        let target = [AxisState::at_rest(0.0); 3];
        let optimum =
            self.free.solve(&self.scale, (&[command; 3], &[arm; 3]), &target, &target.map(|at| [at; N]));
        let jerks = [0, 1, 2].map(|axis| optimum.jerks(axis).map(|jerk| jerk * self.scale.jerk_inverse));
        Plan { step_s: self.step_s, start: [command; 3], jerks }
    }

    /// One unit off in position, in velocity, in acceleration.
    fn unit_deviations(&self) -> [AxisState; 3] {
        let still = AxisState::at_rest(0.0);
        [
            AxisState { position: OFF / self.scale.position, ..still },
            AxisState { velocity: OFF / self.scale.velocity, ..still },
            AxisState { acceleration: OFF / self.scale.acceleration, ..still },
        ]
    }
}
