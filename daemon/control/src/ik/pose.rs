//! Joint positions for a tool pose, found by iterating the IK step. For start-up checks, not for the loop.
//!
//! Contract: respects position limits only. Local: the answer belongs to the solution branch of the seed.
//! Where the steps of the loop end short of the pose, because the loop is damped near singularities, damped
//! Newton steps with a control of the step go on (Levenberg and Marquardt): at once, then along the way from
//! the seed's pose. All are judged by the same bound.

use nalgebra::{SMatrix, SVector, Vector3};

use super::task::{self, IkSettings, Task, ToolTarget};
use crate::arm::chain::Chain;
use crate::qp::box_qp;

/// Pose error that counts as reached: 1 nm, and 1 nm at the orientation length (10 nrad).
const TOLERANCE_M: f64 = 1e-9;
const MAX_STEPS: usize = 300;
const MAX_TURN: f64 = 0.3;
/// Pieces of the way from the seed's pose to the target.
const WAYPOINTS: usize = 24;
/// Damping with which damped steps begin, and its least and most \[m²\]; beyond the most no step helps.
const DAMPING_M2: [f64; 3] = [1e-6, 1e-14, 1e3];

/// Joint positions \[rad\] inside the URDF's limits at which the tool is at `target` (its velocity is
/// ignored).
///
/// `seed` \[rad\] selects the solution branch. `None` if no steps get within 1 nm and 10 nrad: unreachable,
/// behind a limit, or too far from the seed. Without `target.spin` any rotation about the tool axis is
/// accepted.
#[must_use]
pub fn solve_pose<const J: usize>(
    chain: &Chain<J>,
    seed: &[f64; J],
    target: &ToolTarget,
) -> Option<[f64; J]> {
    let target = ToolTarget { velocity: Vector3::zeros(), ..*target };
    let mut q = *seed;
    for (q, [lower, upper]) in q.iter_mut().zip(&chain.limits().position) {
        *q = q.max(*lower).min(*upper);
    }
    plain(chain, q, &target)
        .or_else(|| damped(chain, q, &target).ok())
        .or_else(|| along_the_way(chain, q, &target))
}

/// The settings that judge a pose, and with which the loop's own steps are taken.
fn settings<const J: usize>(seed: &[f64; J], target: &ToolTarget) -> IkSettings<J> {
    let mut settings = IkSettings::for_period(1.0, *seed);
    settings.gain_hz = 1.0;
    settings.correction_mps = 0.1;
    settings.correction_mps2 = f64::INFINITY;
    settings.damping_floor_m2 = 1e-12;
    settings.spin_weight = if target.spin.is_some() { 1.0 } else { 0.1 };
    settings
}

fn task<const J: usize>(
    chain: &Chain<J>,
    q: &[f64; J],
    target: &ToolTarget,
    settings: &IkSettings<J>,
) -> Task<J> {
    task::assemble(&chain.forward(q), q, &[0.0; J], target, settings, 1.0)
}

/// The step that is least in H and g, inside the limits and no larger than [`MAX_TURN`].
fn step<const J: usize>(
    chain: &Chain<J>,
    q: &[f64; J],
    h: &SMatrix<f64, J, J>,
    g: &SVector<f64, J>,
) -> Option<[f64; J]> {
    let room = chain.limits().position.iter().zip(q);
    let lower = SVector::<f64, J>::from_iterator(room.clone().map(|([l, _], q)| (l - q).max(-MAX_TURN)));
    let upper = SVector::<f64, J>::from_iterator(room.map(|([_, u], q)| (u - q).min(MAX_TURN)));
    let solved = box_qp::solve(h, g, &lower, &upper);
    solved.status.usable().then(|| {
        let mut next = *q;
        for (q, dq) in next.iter_mut().zip(&solved.x) {
            *q += dq;
        }
        next
    })
}

/// The steps of the loop.
fn plain<const J: usize>(chain: &Chain<J>, mut q: [f64; J], target: &ToolTarget) -> Option<[f64; J]> {
    let settings = settings(&q, target);
    for _ in 0..MAX_STEPS {
        let task = task(chain, &q, target, &settings);
        if task.wanted.norm() <= TOLERANCE_M {
            return Some(q);
        }
        q = step(chain, &q, &task.h, &task.g)?;
    }
    None
}

/// Newton steps whose damping falls while they help and grows until they do; the nearest pose where they do
/// not reach.
///
/// *Source*: Marquardt 1963, *An Algorithm for Least-Squares Estimation of Nonlinear Parameters*, with
/// bounds.
fn damped<const J: usize>(
    chain: &Chain<J>,
    mut q: [f64; J],
    target: &ToolTarget,
) -> Result<[f64; J], [f64; J]> {
    let judging = settings(&q, target);
    // One measure for all steps: weights do not change on the way, and nothing but the target counts.
    let mut settings = judging;
    (settings.normal_weight, settings.tilt_weight) = (1.0, 1.0);
    (settings.correction_mps, settings.damping_peak_m2) = (f64::INFINITY, 0.0);
    settings.damping_floor_m2 = DAMPING_M2[1];
    if target.spin.is_none() {
        settings.spin_weight = 0.0;
    }
    let [mut damping, least, most] = DAMPING_M2;
    let mut now = task(chain, &q, target, &settings);
    for _ in 0..MAX_STEPS {
        if task(chain, &q, target, &judging).wanted.norm() <= TOLERANCE_M {
            return Ok(q);
        }
        let h = now.h + SMatrix::identity() * damping;
        let next = step(chain, &q, &h, &now.g).map(|next| (next, task(chain, &next, target, &settings)));
        match next {
            Some((next, at)) if at.wanted.norm() < now.wanted.norm() => {
                (q, now) = (next, at);
                damping = (0.1 * damping).max(least);
            }
            _ => damping *= 5.0,
        }
        if damping > most {
            break;
        }
    }
    Err(q)
}

/// Damped steps to poses between that of `seed` and the target, one after the other.
fn along_the_way<const J: usize>(chain: &Chain<J>, seed: [f64; J], target: &ToolTarget) -> Option<[f64; J]> {
    let from = chain.forward(&seed);
    let axis: Vector3<f64> = from.rotation.column(2).into();
    let mut q = seed;
    for index in 1..WAYPOINTS {
        let share = index as f64 / WAYPOINTS as f64;
        let towards = axis.lerp(&target.axis, share);
        if towards.norm() < 1e-3 {
            return None;
        }
        let between = ToolTarget {
            position: from.position.lerp(&target.position, share),
            axis: towards.normalize(),
            spin: None,
            ..*target
        };
        // A pose on the way need not be reached: limits may allow the target and not the straight line.
        q = damped(chain, q, &between).unwrap_or_else(|nearest| nearest);
    }
    damped(chain, q, target).ok()
}

#[cfg(test)]
mod tests;
