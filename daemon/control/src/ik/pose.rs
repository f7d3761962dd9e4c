//! Joint positions for a tool pose, found by iterating the IK step. For start-up checks, not for the loop.
//!
//! Contract: respects position limits only. Local: the answer belongs to the solution branch of the seed.

use nalgebra::{SVector, Vector3};

use super::task::{self, IkSettings, ToolTarget};
use crate::arm::chain::{Chain, Kinematics};
use crate::qp::box_qp;

/// Pose error that counts as reached: 1 nm, and 1 nm at the orientation length (10 nrad).
const TOLERANCE_M: f64 = 1e-9;
const MAX_STEPS: usize = 300;
const MAX_TURN: f64 = 0.3;

/// Joint positions \[rad\] inside the URDF's limits at which the tool is at `target` (its velocity is
/// ignored).
///
/// `seed` \[rad\] selects the solution branch. `None` if 300 steps do not get within 1 nm and 10 nrad:
/// unreachable, behind a limit, or too far from the seed. Without `target.spin` any rotation about the tool
/// axis is accepted.
#[must_use]
pub fn solve_pose<const J: usize>(
    chain: &Chain<J>,
    seed: &[f64; J],
    target: &ToolTarget,
) -> Option<[f64; J]> {
    let mut settings = IkSettings::for_period(1.0, *seed);
    settings.gain_hz = 1.0;
    settings.correction_mps = 0.1;
    settings.correction_mps2 = f64::INFINITY;
    settings.damping_floor_m2 = 1e-12;
    settings.spin_weight = if target.spin.is_some() { 1.0 } else { 0.1 };
    let target = ToolTarget { velocity: Vector3::zeros(), ..*target };

    let mut q = *seed;
    for (q, [lower, upper]) in q.iter_mut().zip(&chain.limits().position) {
        *q = q.max(*lower).min(*upper);
    }
    for _ in 0..MAX_STEPS {
        let kinematics: Kinematics<J> = chain.forward(&q);
        let task = task::assemble(&kinematics, &q, &[0.0; J], &target, &settings, 1.0);
        if task.wanted.norm() <= TOLERANCE_M {
            return Some(q);
        }
        let room = chain.limits().position.iter().zip(&q);
        let lower = SVector::<f64, J>::from_iterator(room.clone().map(|([l, _], q)| (l - q).max(-MAX_TURN)));
        let upper = SVector::<f64, J>::from_iterator(room.map(|([_, u], q)| (u - q).min(MAX_TURN)));
        let solved = box_qp::solve(&task.h, &task.g, &lower, &upper);
        if !solved.status.usable() {
            return None;
        }
        for (q, dq) in q.iter_mut().zip(&solved.x) {
            *q += dq;
        }
    }
    None
}
