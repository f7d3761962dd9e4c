//! The envelope as rows on the joint velocities of one step.

use nalgebra::{SVector, Vector3, Vector6};

use super::{Envelope, TILT_MARGIN_RAD};
use crate::arm::Kinematics;
use crate::arm::limits::{JointLimits, JointMotion, VelocityBox, viable_velocity};
use crate::arm::silence::Silence;
use crate::mpc::AxisLimits;
use crate::qp::offered::OfferedRows;
use crate::units::AxisState;

/// Price of an envelope row relative to a clearance row.
const WEIGHT: f64 = 0.1;
/// Fraction of the largest deceleration that rows assume.
const COUNTED_ON: f64 = 0.5;
/// Bisections for the fastest speed that can still be stopped, where joints have jerk limits.
const HALVINGS: u32 = 24;
/// Share of the margin over the largest tilt that silence may use.
const SILENT_TILT: f64 = 0.5;

/// The two bounds along one direction.
#[derive(Debug, Clone, Copy)]
enum Side {
    Below,
    Above,
}

const SIDES: [Side; 2] = [Side::Below, Side::Above];

impl Side {
    const fn sign(self) -> f64 {
        match self {
            Self::Below => -1.0,
            Self::Above => 1.0,
        }
    }

    const fn of(self, [below, above]: [f64; 2]) -> f64 {
        match self {
            Self::Below => below,
            Self::Above => above,
        }
    }
}

/// The bounds along one direction: an axis of the plane, or the tilt.
struct BoundDirection<const J: usize> {
    /// Velocity along it is row · q̇ \[m/rad or 1\].
    row: [f64; J],
    /// Added to it by the curvature of the motion within the step \[m/s\].
    bent: f64,
    /// Room to the lower and the upper bound \[m, rad\].
    room: [f64; 2],
}

impl<const J: usize> Envelope<J> {
    /// Whether `wanted` \[rad/s\] may violate a row of [`Self::offer`]; conservative.
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
        let bending = kinematics.jacobian_dot_qd(&motion.qd) * (0.5 * elapsed);
        for way in self.ways(kinematics, &bending, &self.inner, self.tilt) {
            let v = dot(&way.row, wanted) + way.bent;
            let side = if v < 0.0 { Side::Below } else { Side::Above };
            broken |= !(v.abs() <= self.fastest(&way, motion, elapsed, side));
        }
        self.silent_ways(kinematics, motion, elapsed, |row, most| {
            broken |= !(dot(row, wanted) <= most);
        });
        broken
    }

    /// Offers the rows of a step of `elapsed` \[s\] inside `allowed`; `wanted` \[rad/s\] tells in which
    /// direction the tool is fast.
    pub(crate) fn offer(
        &self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        wanted: &[f64; J],
        allowed: &VelocityBox<J>,
        elapsed: f64,
        offered: &mut OfferedRows<J>,
    ) {
        let bending = kinematics.jacobian_dot_qd(&motion.qd) * (0.5 * elapsed);
        for way in self.ways(kinematics, &bending, &self.inner, self.tilt) {
            for side in SIDES {
                let (fastest, sign) = (self.fastest(&way, motion, elapsed, side), side.sign());
                let row = way.row.map(|c| -sign * c * WEIGHT);
                offered.offer(&row, (sign * way.bent - fastest) * WEIGHT, allowed);
            }
        }
        self.silent_ways(kinematics, motion, elapsed, |row, most| {
            offered.offer(&row.map(|c| -c * WEIGHT), -most * WEIGHT, allowed);
        });
        let jacobian = kinematics.jacobian.fixed_rows::<3>(0);
        let linear: Vector3<f64> = jacobian * SVector::<f64, J>::from_column_slice(wanted);
        let speed = linear.norm();
        if speed > self.speed {
            let [row] = jacobian.tr_mul(&(linear * (-WEIGHT / speed))).data.0;
            offered.offer(&row, -self.speed * WEIGHT, allowed);
        }
    }

    /// The plane's axes and the tilt, with the room inside `bounds` \[m\] and `most` \[rad\].
    fn ways(
        &self,
        kinematics: &Kinematics<J>,
        bending: &Vector6<f64>,
        bounds: &[[f64; 2]; 3],
        most: f64,
    ) -> [BoundDirection<J>; 4] {
        let linear: Vector3<f64> = bending.fixed_rows::<3>(0).into_owned();
        let tool = self.plane.point_from_base(&kinematics.position);
        let axes = self.plane.rotation.matrix();
        let along = |axis: usize, at: f64, [low, high]: [f64; 2]| {
            let column = axes.column(axis);
            let [row] = kinematics.jacobian.fixed_rows::<3>(0).tr_mul(&column).data.0;
            BoundDirection { row, bent: linear.dot(&column), room: [at - low, high - at] }
        };
        let [x, y, z] = *bounds;
        let (tilt, about) = self.tilted(kinematics);
        let [row] = kinematics.jacobian.fixed_rows::<3>(3).tr_mul(&about).data.0;
        let bent = bending.fixed_rows::<3>(3).dot(&about);
        let tilt = BoundDirection { row, bent, room: [f64::INFINITY, most - tilt] };
        [along(0, tool.x, x), along(1, tool.y, y), along(2, tool.z, z), tilt]
    }

    /// Calls `see` with rows c and bounds b \[m/s\] such that c·q̇ ≤ b keeps the point inside where the arm
    /// comes to rest if the next command is the last one for long, and the point where it turns back on the
    /// way there, or lets them lie no farther out than the tool is. Every joint brakes by itself then, which
    /// is not straight for the tool.
    fn silent_ways(
        &self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        elapsed: f64,
        mut see: impl FnMut(&[f64; J], f64),
    ) {
        let Some(gap_s) = self.gaps.expected_s else { return };
        let most = self.tilt + SILENT_TILT * TILT_MARGIN_RAD;
        let ways = |at: &Kinematics<J>| self.ways(at, &Vector6::zeros(), &self.inner, most);
        let silent = |braked| Silence::braking(&self.chain, &self.limits, motion, elapsed + gap_s, braked);
        let mut keep = |at: &Silence<J>, way: &BoundDirection<J>, here: &BoundDirection<J>, side: Side| {
            let mut row = way.row.map(|c| side.sign() * c);
            row.iter_mut().zip(&at.gain).for_each(|(c, gain)| *c *= gain * self.rate);
            let now = dot(&row, &motion.qd);
            see(&row, now + self.rate * (side.of(way.room) - side.of(here.room).min(0.0)));
        };
        let rest = silent(f64::INFINITY);
        for (index, (way, here)) in ways(&rest.kinematics).iter().zip(&ways(kinematics)).enumerate() {
            for side in SIDES {
                keep(&rest, way, here, side);
                let outward = way.row.map(|c| side.sign() * c);
                let Some(braked) = Silence::turns(&self.limits, motion, &outward) else { continue };
                let turning = silent(braked);
                if let Some(way) = ways(&turning.kinematics).get(index) {
                    keep(&turning, way, here, side);
                }
            }
        }
    }

    /// See [`fastest_stoppable`].
    fn fastest(&self, way: &BoundDirection<J>, motion: &JointMotion<J>, elapsed: f64, side: Side) -> f64 {
        fastest_stoppable(&self.limits, &way.row, motion, side.of(way.room), elapsed, side.sign())
    }
}

/// The fastest speed \[m/s\] along `row` \[m/rad\] in the direction `sign` from which the tool is at rest
/// within `room` \[m\], with half of what the joints give there: half, because several bounds may be active
/// and the Jacobian changes meanwhile. 0 if there is no room.
pub(crate) fn fastest_stoppable<const J: usize>(
    limits: &JointLimits<J>,
    row: &[f64; J],
    motion: &JointMotion<J>,
    room: f64,
    elapsed: f64,
    sign: f64,
) -> f64 {
    if room <= 0.0 {
        return 0.0;
    }
    if room == f64::INFINITY {
        return room;
    }
    let most = |of: &[f64; J]| COUNTED_ON * row.iter().zip(of).map(|(c, most)| c.abs() * most).sum::<f64>();
    let braking = most(limits.acceleration());
    let Some(jerk) = limits.jerk() else {
        // The root of v·h + v²/(2a) = room.
        return viable_velocity(room, elapsed, 0.0, braking.max(f64::MIN_POSITIVE), f64::INFINITY);
    };
    let limits = AxisLimits {
        jerk_mps3: most(jerk).max(f64::MIN_POSITIVE),
        acceleration_mps2: braking,
        velocity_mps: f64::INFINITY,
        position_m: [f64::NEG_INFINITY, room],
    };
    let now = sign * dot(row, &motion.qd);
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

fn dot<const J: usize>(a: &[f64; J], b: &[f64; J]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;
    use crate::arm::Chain;
    use crate::envelope::EnvelopeSettings;
    use crate::plane::Plane;

    /// Rows are given by hand: of the chain only its number of joints counts.
    const TWO_JOINTS: &str = r#"<robot name="two"><link name="a"/><link name="b"/><link name="c"/>
        <joint name="1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
            <limit lower="-6" upper="6" velocity="3" effort="1"/></joint>
        <joint name="2" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
            <limit lower="-6" upper="6" velocity="3" effort="1"/></joint></robot>"#;
    const ROW: [f64; 2] = [0.5, -0.2];
    /// Half of what the joints give along the row: 10 and 20 rad/s², 100 and 300 rad/s³.
    const BRAKING: f64 = 0.5 * (0.5 * 10.0 + 0.2 * 20.0);
    const JERK: f64 = 0.5 * (0.5 * 100.0 + 0.2 * 300.0);

    fn envelope(jerk: Option<[f64; 2]>) -> Envelope<2> {
        let limits = JointLimits::new([[-6.0, 6.0]; 2], [3.0; 2], [10.0, 20.0]).unwrap();
        let limits = jerk.map_or(limits, |jerk| limits.with_jerk(jerk).unwrap());
        let settings = EnvelopeSettings { margin_m: 0.001, max_tilt_rad: 0.3, max_speed_mps: None };
        let plane = Plane {
            origin: Vector3::zeros(),
            rotation: Rotation3::identity(),
            pen_scale: 1.0,
            pen_origin: [0.0; 2],
            lift_height: 0.01,
            press_depth: 0.0,
        };
        let chain = Chain::from_urdf(TWO_JOINTS, None, None).unwrap();
        Envelope::new(&settings, &chain, plane, [[-0.1, 0.1]; 3], 1.0, &limits).unwrap()
    }

    /// How far a step at `v` after one at `now` leads \[m\], together with the stop after it that ends
    /// without acceleration; integrated in steps of 10 µs.
    fn farthest_m(v: f64, now: f64, elapsed: f64) -> f64 {
        let step = 1e-5;
        let (mut x, mut speed) = (v * elapsed, v);
        let mut a = ((v - now) / elapsed).clamp(-BRAKING, BRAKING);
        let mut most = x;
        while speed > 0.0 {
            x += step * (speed + 0.5 * step * a);
            speed += step * a;
            // The rest of the motion brings the acceleration back to zero.
            let ends = a < 0.0 && speed <= 0.5 * a * a / JERK;
            a = if ends { (a + step * JERK).min(0.0) } else { (a - step * JERK).max(-BRAKING) };
            most = most.max(x);
            if ends && a == 0.0 {
                break;
            }
        }
        most
    }

    #[test]
    fn the_fastest_is_the_fastest_that_can_still_be_stopped() {
        let envelope = envelope(Some([100.0, 300.0]));
        for elapsed in [0.002, 0.008] {
            for room in [1e-4, 0.003, 0.02, 0.1] {
                for now in [-0.1, 0.0, 0.05, 0.2, 0.5] {
                    for sign in [1.0, -1.0] {
                        // Joint 0 moves along the row at `now`.
                        let motion =
                            JointMotion { qd: [sign * now / ROW[0], 0.0], ..JointMotion::at_rest([0.0; 2]) };
                        let way = BoundDirection { row: ROW, bent: 0.0, room: [room, room] };
                        let side = if sign < 0.0 { Side::Below } else { Side::Above };
                        let v = envelope.fastest(&way, &motion, elapsed, side);
                        let far = farthest_m(v, now, elapsed);
                        assert!(far <= room * 1.002 + 2e-6, "{v} m/s from {now}: {far} of {room} m");
                        let far = farthest_m(1.01 * v + 1e-4, now, elapsed);
                        assert!(far > room, "{v} m/s from {now} is too slow: {far} of {room} m");
                    }
                }
            }
        }
    }

    #[test]
    fn without_jerk_limits_the_way_is_that_of_even_braking() {
        let (envelope, still) = (envelope(None), JointMotion::at_rest([0.0; 2]));
        for room in [1e-4, 0.003, 0.1] {
            let fastest = |room: f64| {
                let way = BoundDirection { row: ROW, bent: 0.0, room: [0.0, room] };
                envelope.fastest(&way, &still, 0.008, Side::Above)
            };
            let v = fastest(room);
            assert!((v * 0.008 + v * v / (2.0 * BRAKING) - room).abs() < 1e-12, "{v} m/s in {room} m");
            assert_eq!([0.0, -room, f64::INFINITY].map(fastest), [0.0, 0.0, f64::INFINITY]);
        }
    }
}
