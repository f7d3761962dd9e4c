//! The path that a stop keeps: fixed in its first tick, in the plane's frame.
//!
//! The floor is the pressing depth, or the tip's height where that is lower already; over the paper only,
//! because elsewhere the plane is nothing. A tip that writes keeps its line too. A joint that the path holds
//! up makes up for it: it is compared with where it would be if it braked by itself, and the line is given up
//! where it costs too much.
//!
//! Contract: total; a stop never waits for its path. Once the joints by themselves would have been at rest
//! for [`ENDS_S`] the path is let go of, and the stop ends joint by joint.

#![expect(clippy::indexing_slicing, reason = "indices run over the joints, the length of every array")]

use nalgebra::Vector3;

use super::Mover;
use crate::arm::JointMotion;
use crate::follower::io::Health;
use crate::guard::{Commanded, StopProfile};
use crate::ik::StopPath;
use crate::plane::Plane;
use crate::state::state;
use crate::units::Stamp;

/// A tip lower than this above the pressing depth writes \[m\], if it moves faster than this \[m/s\].
const WRITES_M: f64 = 1e-3;
const WRITES_MPS: f64 = 0.01;
/// The line is let go of while it keeps a joint back by more than this \[s\], at the joint's deceleration.
const LINE_COSTS_S: f64 = 0.008;
/// Longest that the path may delay the end of the command's motion \[s\]; 0.03 is the most seen in strokes.
const ENDS_S: f64 = 0.1;
/// So far beside the workspace the paper still counts \[m\].
const BESIDE_M: f64 = 0.01;

/// What a stop keeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct KeptPath<const J: usize> {
    /// The tip goes no lower \[m\]; −∞: anything goes.
    floor: f64,
    /// Across the line in the plane, a unit vector.
    across: Option<[f64; 2]>,
    /// Where the joints would be if each braked by itself.
    alone: Commanded<J>,
    /// How long they would have been at rest there \[s\].
    over_s: f64,
}

state! { whole [const J: usize] KeptPath<J> { floor, across, alone, over_s } }

impl<const J: usize> KeptPath<J> {
    /// For a stop that begins at `command` with the tool at `tip` \[m\], moving at `velocity` \[m/s\].
    fn begun(
        command: &Commanded<J>,
        plane: &Plane,
        workspace: &[[f64; 2]; 2],
        tip: &Vector3<f64>,
        velocity: &Vector3<f64>,
    ) -> Self {
        let beside =
            |(at, [low, high]): (&f64, &[f64; 2])| !(*at >= low - BESIDE_M && *at <= high + BESIDE_M);
        if tip.iter().zip(workspace).any(beside) {
            return Self { floor: f64::NEG_INFINITY, across: None, alone: *command, over_s: 0.0 };
        }
        let speed = velocity.x.hypot(velocity.y);
        let writes = tip.z <= WRITES_M - plane.press_depth && speed > WRITES_MPS;
        Self {
            floor: tip.z.min(-plane.press_depth),
            across: writes.then(|| [-velocity.y / speed, velocity.x / speed]),
            alone: *command,
            over_s: 0.0,
        }
    }

    /// The same, seen from a tool at `tip` \[m\].
    fn seen(&self, plane: &Plane, tip: &Vector3<f64>) -> StopPath {
        StopPath {
            normal: -plane.tool_axis(),
            room_m: tip.z - self.floor,
            across: self.across.map(|[x, y]| plane.vector_to_base(&Vector3::new(x, y, 0.0))),
        }
    }

    /// How much longer than alone a joint at `qd` \[rad/s\] would take, braking by itself from now on \[s\].
    fn behind_s(&self, qd: &[f64; J], deceleration: &[f64; J]) -> f64 {
        let joints = qd.iter().zip(self.alone.qd()).zip(deceleration);
        joints.map(|((qd, alone), decel)| (qd.abs() - alone.abs()) / decel).fold(0.0, f64::max)
    }

    /// Lets the joints that brake by themselves go on to `reach`.
    fn pass(&mut self, stop: &StopProfile<J>, reach: Stamp) {
        let qd = stop.next(&self.alone, reach);
        let (h, before) = (reach.seconds_since(self.alone.stamp()), *self.alone.motion());
        if !(h > 0.0) {
            return;
        }
        if StopProfile::is_done(&self.alone) {
            self.over_s += h;
        }
        let q = std::array::from_fn(|j| before.q[j] + qd[j] * h);
        let after = JointMotion { q, qd, qdd: std::array::from_fn(|j| (qd[j] - before.qd[j]) / h) };
        self.alone = Commanded::new(reach, after).unwrap_or(self.alone);
    }
}

impl<const N: usize, const J: usize> Mover<N, J> {
    /// The next step of a stop that goes on, or begins, and ends this tick at `reach`: joint velocities
    /// \[rad/s\], and the path to keep; no path at rest, or where the stop has waited for it too long.
    pub(super) fn next_of_stop(&mut self, reach: Stamp, health: &mut Health) -> ([f64; J], Option<StopPath>) {
        let Self { held, kept, plane, limits, stop, guard, .. } = self;
        let Some(held) = held else { return ([0.0; J], None) };
        if StopProfile::is_done(&held.command) {
            return (stop.next(&held.command, reach), None);
        }
        let tip = plane.point_from_base(&held.kinematics.position);
        let kept = kept.get_or_insert_with(|| {
            let motion = held.kinematics.tool_motion(held.command.qd(), held.command.qdd());
            let [x, y, _] = limits.map(|axis| axis.position_m);
            let velocity = plane.vector_from_base(&motion.velocity);
            KeptPath::begun(&held.command, plane, &[x, y], &tip, &velocity)
        });
        let wanted = stop.next_held_up(&held.command, reach, kept.alone.qd());
        let mut path = kept.seen(plane, &tip);
        if kept.behind_s(held.command.qd(), guard.limits().deceleration()) > LINE_COSTS_S {
            path.across = None;
        }
        kept.pass(stop, reach);
        if kept.over_s > ENDS_S {
            health.set(Health::PATH_LOST);
            return (wanted, None);
        }
        (wanted, Some(path))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;
    use crate::arm::JointLimits;

    const TICK_NS: u64 = 2_000_000;

    fn paper() -> Plane {
        Plane {
            origin: Vector3::zeros(),
            rotation: Rotation3::identity(),
            pen_scale: 1.0,
            pen_origin: [0.0; 2],
            lift_height: 0.01,
            press_depth: 0.001,
        }
    }

    fn begun(tip: [f64; 3], velocity: [f64; 3]) -> KeptPath<2> {
        let motion = JointMotion { q: [0.0; 2], qd: [1.0, -0.5], qdd: [0.0; 2] };
        let command = Commanded::new(Stamp(TICK_NS), motion).unwrap();
        KeptPath::begun(&command, &paper(), &[[-0.1, 0.1]; 2], &tip.into(), &velocity.into())
    }

    #[test]
    fn the_floor_is_the_pressing_depth_or_the_tip_below_it_and_only_over_the_paper() {
        let along_x = [0.1, 0.0, 0.0];
        let writing = begun([0.0, 0.0, -0.0005], along_x);
        assert_eq!((writing.floor, writing.across), (-0.001, Some([0.0, 1.0])));
        assert_eq!(begun([0.0, 0.0, -0.0012], along_x).floor, -0.0012);
        let above = begun([0.0, 0.0, 0.005], along_x);
        assert_eq!((above.floor, above.across), (-0.001, None));
        assert_eq!(begun([0.109, 0.0, 0.0], along_x).floor, -0.001);
        for beside in [[0.111, 0.0, 0.0], [0.0, f64::NAN, 0.0]] {
            let free = begun(beside, along_x);
            assert_eq!((free.floor, free.across), (f64::NEG_INFINITY, None));
        }
    }

    /// 1 rad/s at 20 rad/s² and the stop's own jerk.
    #[test]
    fn the_path_is_let_go_of_a_tenth_of_a_second_after_the_joints_alone_would_rest() {
        let limits = JointLimits::new([[-6.0, 6.0]; 2], [3.0; 2], [20.0; 2]).unwrap();
        let (stop, mut kept) = (StopProfile::new(limits), begun([0.0; 3], [0.1, 0.0, 0.0]));
        let (mut rested_at, mut let_go_at) = (None, None);
        for tick in 1..200_u64 {
            kept.pass(&stop, Stamp((tick + 1) * TICK_NS));
            if StopProfile::is_done(&kept.alone) {
                rested_at.get_or_insert(tick);
            }
            if kept.over_s > ENDS_S {
                let_go_at.get_or_insert(tick);
            }
        }
        let (rested, let_go) = (rested_at.unwrap() * TICK_NS, let_go_at.unwrap() * TICK_NS);
        assert!((50_000_000..90_000_000).contains(&rested), "{rested}");
        assert!((100_000_000..=104_000_000).contains(&(let_go - rested)), "{rested} {let_go}");
        // Time that does not pass changes nothing.
        let before = kept;
        kept.pass(&stop, Stamp(TICK_NS));
        assert_eq!(kept, before);
    }
}
