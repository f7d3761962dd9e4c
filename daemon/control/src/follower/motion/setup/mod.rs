//! Planner and inverse kinematics as the settings describe them, and the limits with which they work
//! together.

mod rest;

pub(super) use rest::comes_to_rest;

use nalgebra::{SVector, Vector3};

use crate::clearance::Clearance;
use crate::envelope::Envelope;
use crate::follower::{FollowerError, FollowerSettings};
use crate::ik::Ik;
use crate::ik::task::{self, ToolTarget};
use crate::mpc::{Mpc, MpcSettings};
use crate::qp::cholesky::Cholesky;

/// A plan may ask for this multiple of the acceleration and velocity that the joints give along one axis at
/// home: in most poses and with the tool tilting they give more, and a little lag is better than a slow plan.
/// A jerk that the joints do not give would make it oscillate.
const ACCELERATION_ASKED: f64 = 2.6;
const VELOCITY_ASKED: f64 = 1.5;
/// Stops are planned with this multiple of the acceleration that the joints give.
const ACCELERATION_STOPS: f64 = 1.2;

/// Speeds from which a plan must be able to foresee a stop, per axis \[m/s\]; with half of them in the plane
/// the tool oscillates by 18 mm.
const USEFUL_MPS: [f64; 3] = [0.1, 0.1, 0.05];
/// The lowest limits that a plan can be made with.
const SLOWEST_MPS: f64 = 1e-3;
const LEAST_MPS2: f64 = 0.01;
const LEAST_MPS3: f64 = 1.0;

/// The plan's limits, lowered to what the joints give and to speeds that can be stopped within the horizon.
///
/// A plan that looks ahead for less than a stop takes brakes too late: it overshoots its target and
/// oscillates.
pub(in crate::follower) fn paced<const N: usize, const J: usize>(
    settings: &FollowerSettings<J>,
) -> MpcSettings {
    let mut mpc = settings.mpc;
    if mpc.unlimited {
        return mpc;
    }
    let horizon_s = mpc.step_s * N as f64;
    for (limits, axis) in mpc.axes.iter_mut().zip(settings.plane.rotation.matrix().column_iter()) {
        let needs = needs(settings, &axis.into_owned());
        let gives = |of: &[f64; J]| {
            needs.iter().zip(of).map(|(q, most)| most / q.abs()).fold(f64::INFINITY, f64::min)
        };
        let acceleration = gives(settings.limits.acceleration());
        limits.velocity_mps = limits.velocity_mps.min(VELOCITY_ASKED * gives(settings.limits.velocity()));
        if let Some(jerk) = settings.limits.jerk() {
            limits.jerk_mps3 = limits.jerk_mps3.min(gives(jerk));
        }
        let wanted = limits.acceleration_mps2;
        limits.acceleration_mps2 = wanted.min(ACCELERATION_STOPS * acceleration);
        // All three axes together are no faster than the tool may be.
        let fastest = settings.safety.envelope.max_speed_mps.unwrap_or(f64::INFINITY) / 3.0_f64.sqrt();
        limits.velocity_mps = limits.stoppable_mps(horizon_s).min(fastest).max(SLOWEST_MPS);
        limits.acceleration_mps2 = wanted.min(ACCELERATION_ASKED * acceleration).max(LEAST_MPS2);
        limits.jerk_mps3 = limits.jerk_mps3.max(LEAST_MPS3);
    }
    mpc
}

/// Refuses a jerk with which a plan does not foresee a stop from a useful speed: it would oscillate slowly
/// and widely.
fn sees_stops<const N: usize, const J: usize>(settings: &FollowerSettings<J>) -> Result<(), FollowerError> {
    if settings.mpc.unlimited {
        return Ok(());
    }
    let horizon_s = settings.mpc.step_s * N as f64;
    let pairs = paced::<N, J>(settings).axes.into_iter().zip(&settings.mpc.axes);
    for (axis, ((paced, asked), useful)) in pairs.zip(USEFUL_MPS).enumerate() {
        let speed = useful.min(asked.velocity_mps);
        let needed_mps3 = 4.0 * speed / (horizon_s * horizon_s);
        let jerk_mps3 = paced.jerk_mps3;
        if !(jerk_mps3 >= needed_mps3) {
            let own = jerk_mps3 >= asked.jerk_mps3;
            let whose = if own { "the plan's limits" } else { "the joints' jerk limits" };
            return Err(FollowerError::LittleJerk { whose, axis, jerk_mps3, needed_mps3 });
        }
    }
    Ok(())
}

/// Joint velocities of the IK for a tool velocity of 1 m/s along `axis` at home \[rad/m\].
fn needs<const J: usize>(settings: &FollowerSettings<J>, axis: &Vector3<f64>) -> [f64; J] {
    let kinematics = settings.chain.forward(&settings.ik.home);
    let tool = kinematics.rotation.column(2).into_owned();
    let target = ToolTarget { velocity: *axis, ..ToolTarget::at_rest(kinematics.position, tool, None) };
    let task = task::assemble(&kinematics, &settings.ik.home, &[0.0; J], &target, &settings.ik, 1e-3);
    let [g] = task.g.data.0;
    Cholesky::new(&task.h.data.0).map_or([0.0; J], |factor| factor.solve(&g.map(|g| -g)))
}

pub(super) fn planner<const N: usize, const J: usize>(
    settings: &FollowerSettings<J>,
) -> Result<Mpc<N>, FollowerError> {
    // Report a number outside its range first.
    settings.mpc.validate()?;
    sees_stops::<N, J>(settings)?;
    let mut mpc = Mpc::new(&paced::<N, J>(settings))?;
    mpc.settles(settings.period_ns as f64 * 1e-9)?;
    Ok(mpc)
}

pub(super) fn inverse_kinematics<const J: usize>(
    settings: &FollowerSettings<J>,
) -> Result<Ik<J>, FollowerError> {
    let mut ik = Ik::new(settings.limits, settings.ik).with_backend(settings.ik_backend)?;
    if let Some(wanted) = &settings.clearance {
        let period_s = settings.period_ns as f64 * 1e-9;
        ik = ik.keeping_clear(Clearance::new(&settings.chain, &settings.limits, period_s, wanted)?);
    }
    if settings.mpc.unlimited {
        return Ok(ik);
    }
    let axes = settings.mpc.limits();
    let speeds = SVector::<f64, 3>::from(axes.map(|axis| axis.velocity_mps));
    let fastest = speeds.norm() + settings.ik.correction_mps;
    let workspace = axes.map(|axis| axis.position_m);
    let envelope = &settings.safety.envelope;
    let (chain, plane, limits) = (&settings.chain, settings.plane, &settings.limits);
    Ok(ik.inside(Envelope::new(envelope, chain, plane, workspace, fastest, limits)?))
}
