//! The envelope as rows on the joint velocities of one step.

use nalgebra::{SVector, Vector3};

use super::Envelope;
use crate::arm::Kinematics;
use crate::arm::limits::{JointMotion, VelocityBox, viable_velocity};
use crate::mpc::AxisLimits;
use crate::qp::offered::Offered;
use crate::units::AxisState;

/// Price of a row beside one that keeps clear of things.
const WEIGHT: f64 = 0.1;
/// Share of the largest deceleration that is counted on.
const COUNTED_ON: f64 = 0.5;
/// Halvings of the interval that holds the fastest speed that can still be stopped, where joints have jerk limits.
const HALVINGS: u32 = 24;

/// The bounds along one way: a plane's axis, or the tilt.
struct Way<const J: usize> {
    /// Velocity along it is row · q̇ [m/rad or 1].
    row: [f64; J],
    /// What is added to it by bending within the step [m/s].
    bent: f64,
    /// Room to the lower and the upper bound [m, rad].
    room: [f64; 2],
}

impl<const J: usize> Envelope<J> {
    /// `wanted` [rad/s] breaks a row of [`Self::offer`]; not exactly: it may say so where none is.
    #[must_use]
    pub(crate) fn may_break(
        &self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        wanted: &[f64; J],
        elapsed: f64,
    ) -> bool {
        let linear: Vector3<f64> =
            kinematics.jacobian.fixed_rows::<3>(0) * SVector::<f64, J>::from_column_slice(wanted);
        if !(linear.norm_squared() <= self.speed * self.speed) {
            return true;
        }
        let mut broken = false;
        self.ways(kinematics, motion, elapsed, |way| {
            let v = dot(&way.row, wanted) + way.bent;
            let [below, above] = way.room;
            let room = if v < 0.0 { below } else { above };
            broken |=
                !(v.abs() <= self.fastest(&way, motion, room, elapsed, if v < 0.0 { -1.0 } else { 1.0 }));
        });
        broken
    }

    /// Offers the rows of a step of `elapsed` [s] inside `allowed`; `wanted` [rad/s] tells in which direction the tool is fast.
    pub(crate) fn offer(
        &self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        wanted: &[f64; J],
        allowed: &VelocityBox<J>,
        elapsed: f64,
        offered: &mut Offered<J>,
    ) {
        self.ways(kinematics, motion, elapsed, |way| {
            let [below, above] = way.room;
            for (sign, room) in [(-1.0, below), (1.0, above)] {
                let fastest = self.fastest(&way, motion, room, elapsed, sign);
                let row = way.row.map(|c| -sign * c * WEIGHT);
                offered.offer(&row, (sign * way.bent - fastest) * WEIGHT, allowed);
            }
        });
        let jacobian = kinematics.jacobian.fixed_rows::<3>(0);
        let linear: Vector3<f64> = jacobian * SVector::<f64, J>::from_column_slice(wanted);
        let speed = linear.norm();
        if speed > self.speed {
            let [row] = jacobian.tr_mul(&(linear * (-WEIGHT / speed))).data.0;
            offered.offer(&row, -self.speed * WEIGHT, allowed);
        }
    }

    /// Calls `see` with the plane's axes and the tilt.
    fn ways(
        &self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        elapsed: f64,
        mut see: impl FnMut(Way<J>),
    ) {
        let bending = kinematics.jacobian_dot_qd(&motion.qd) * (0.5 * elapsed);
        let linear: Vector3<f64> = bending.fixed_rows::<3>(0).into_owned();
        let tool = self.plane.point_from_base(&kinematics.position);
        let axes = self.plane.rotation.matrix();
        for ((axis, at), [low, high]) in axes.column_iter().zip(&tool).zip(&self.inner) {
            let [row] = kinematics.jacobian.fixed_rows::<3>(0).tr_mul(&axis).data.0;
            see(Way { row, bent: linear.dot(&axis), room: [at - low, high - at] });
        }
        let (tilt, about) = self.tilted(kinematics);
        let [row] = kinematics.jacobian.fixed_rows::<3>(3).tr_mul(&about).data.0;
        let bent = bending.fixed_rows::<3>(3).dot(&about);
        see(Way { row, bent, room: [f64::INFINITY, self.tilt - tilt] });
    }

    /// The fastest along `way`, in the direction `sign`, from which `room` is enough to come to rest; 0 where there is none.
    fn fastest(&self, way: &Way<J>, motion: &JointMotion<J>, room: f64, elapsed: f64, sign: f64) -> f64 {
        if room <= 0.0 {
            return 0.0;
        }
        if room == f64::INFINITY {
            return room;
        }
        let most =
            |of: &[f64; J]| COUNTED_ON * way.row.iter().zip(of).map(|(c, most)| c.abs() * most).sum::<f64>();
        let braking = most(self.limits.acceleration());
        let Some(jerk) = self.limits.jerk() else {
            // The root of v·h + v²/(2a) = room.
            return viable_velocity(room, elapsed, 0.0, braking.max(f64::MIN_POSITIVE), f64::INFINITY);
        };
        let limits = AxisLimits {
            jerk_mps3: most(jerk).max(f64::MIN_POSITIVE),
            acceleration_mps2: braking,
            velocity_mps: f64::INFINITY,
            position_m: [f64::NEG_INFINITY, room],
        };
        let now = sign * dot(&way.row, &motion.qd);
        let enough = |v: f64| {
            let state = AxisState {
                position: v * elapsed,
                velocity: v,
                acceleration: ((v - now) / elapsed).clamp(-braking, braking),
            };
            let [_, farthest] = limits.stopping_m(&state);
            farthest <= room
        };
        let (mut good, mut bad) = (0.0, room / elapsed);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (good + bad);
            if enough(middle) {
                good = middle;
            } else {
                bad = middle;
            }
        }
        good
    }
}

fn dot<const J: usize>(a: &[f64; J], b: &[f64; J]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
