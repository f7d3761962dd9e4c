//! Inverse kinematics: from what the tool should do to joint velocities the arm may have, as one box QP per tick.
//!
//!   min over q̇ in the box:  ‖J(q) q̇ − v*‖²_W + λ‖q̇‖² + posture        v* = velocity + K·pose error
//!
//! Contract: no allocation, no panic; the answer is finite and inside [`limit::velocity_box`] whatever the input. All
//! kinematics belong to the joint positions last *commanded*, never to measured ones. Singularities are met by damping that
//! grows smoothly; there is no stop and no jump. Absent: planning, collision, several solution branches.

pub mod chain;
mod sincos;
mod urdf;
pub mod limit;
pub mod task;
pub mod reach;
pub mod clearance;

use nalgebra::{SVector, Vector3};
use thiserror::Error;

pub use chain::{Chain, ChainLimits, Kinematics, ToolMotion};
pub use limit::{JointLimits, JointMotion, LimitError, VelocityBox, velocity_box};
pub use reach::solve_pose;
pub use task::{IkSettings, ToolTarget};
pub use urdf::ChainError;

use crate::qp::QpStatus;
use crate::qp::box_qp::{self, ActiveBounds};
use crate::qp::cholesky::Cholesky;
use crate::qp::clarabel::{ClarabelBox, ClarabelProfile};

/// One IK step: joint velocities and how they came about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkStep<const J: usize> {
    /// [rad/s], inside the velocity box.
    pub qd: [f64; J],
    /// How they were found.
    pub report: IkReport,
}

/// Evidence of one IK step; the default is that of no step yet.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct IkReport {
    /// Who produced the velocities.
    pub source: IkSource,
    /// How the QP ended.
    pub status: QpStatus,
    /// Active-set steps.
    pub iterations: u32,
    /// Joints held by the box, one bit each, joint 0 lowest.
    pub active: ActiveBounds,
    /// KKT residual of the QP; NaN where nothing was solved.
    pub kkt_residual: f64,
    /// Wanted minus achieved velocity of the tool origin, base frame [m/s]: what limits and damping took away.
    pub velocity_error: Vector3<f64>,
    /// Size of the tilt rate that was wanted and not achieved [rad/s]; spin does not count.
    pub tilt_error: f64,
    /// λ used [m²].
    pub damping: f64,
    /// Distance to the nearest singularity [m], see [`task::singularity`].
    pub singularity: f64,
}

/// Who produced the joint velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum IkSource {
    /// The box QP.
    #[default]
    Optimum,
    /// Damped least squares clamped into the box, because the QP gave no usable answer.
    Clamped,
    /// Braking, because the input was not finite.
    Brake,
}

/// Which solver finds the joint velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum IkBackend {
    /// The exact dual active set. Allocates nothing.
    #[default]
    Exact,
    /// Clarabel, for comparison. Allocates once or twice per step and is good to about 1e-4 rad/s.
    Clarabel(ClarabelProfile),
}

/// Clarabel refused to be set up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("clarabel could not be set up for a box of {joints} joint velocities; use the exact backend")]
pub struct BackendError {
    /// Number of joints.
    pub joints: usize,
}

/// The IK of one arm.
#[derive(Debug)]
pub struct Ik<const J: usize> {
    limits: JointLimits<J>,
    settings: IkSettings<J>,
    clarabel: Option<Box<ClarabelBox<J>>>,
}

impl<const J: usize> Ik<J> {
    /// An IK that keeps `limits` and weighs by `settings`, solved exactly.
    #[must_use]
    pub const fn new(limits: JointLimits<J>, settings: IkSettings<J>) -> Self {
        Self { limits, settings, clarabel: None }
    }

    /// The same IK with another solver.
    ///
    /// *Errors*: clarabel refuses its settings.
    pub fn with_backend(mut self, backend: IkBackend) -> Result<Self, BackendError> {
        self.clarabel = match backend {
            IkBackend::Exact => None,
            IkBackend::Clarabel(profile) => {
                Some(Box::new(ClarabelBox::new(profile).ok_or(BackendError { joints: J })?))
            }
        };
        Ok(self)
    }

    /// Limits kept.
    #[must_use]
    pub const fn limits(&self) -> &JointLimits<J> {
        &self.limits
    }

    /// Weights and gains.
    #[must_use]
    pub const fn settings(&self) -> &IkSettings<J> {
        &self.settings
    }

    /// Joint velocities for the next `elapsed` seconds.
    ///
    /// `motion`: last command; `kinematics`: [`Chain::forward`] at `motion.q`. The next joint position is q + q̇·elapsed.
    #[must_use]
    pub fn step(
        &mut self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        target: &ToolTarget,
        elapsed: f64,
    ) -> IkStep<J> {
        let allowed = velocity_box(motion, &self.limits, elapsed);
        let task = task::assemble(kinematics, &motion.q, &motion.qd, target, &self.settings, elapsed);
        let (lower, upper) = (SVector::from(allowed.lower), SVector::from(allowed.upper));
        let solved = match &mut self.clarabel {
            None => box_qp::solve(&task.h, &task.g, &lower, &upper),
            Some(clarabel) => clarabel.solve(&task.h, &task.g, &lower, &upper),
        };
        let (source, qd) = if solved.status.usable() {
            (IkSource::Optimum, allowed.nearest(&solved.x.into()))
        } else {
            fallback(&task, motion, &allowed, &self.limits, elapsed)
        };
        let missed = task.wanted - task.rows * SVector::from(qd);
        let length = self.settings.orientation_m;
        let report = IkReport {
            source,
            status: solved.status,
            iterations: solved.iterations,
            active: solved.active,
            kkt_residual: solved.kkt_residual,
            velocity_error: missed.fixed_rows::<3>(0).into_owned(),
            tilt_error: missed.fixed_rows::<2>(3).norm() / length,
            damping: task.damping,
            singularity: task.singularity,
        };
        IkStep { qd, report }
    }
}

/// A legal answer without the QP: clamped damped least squares, or braking where that is not finite.
fn fallback<const J: usize>(
    task: &task::Task<J>,
    motion: &JointMotion<J>,
    allowed: &VelocityBox<J>,
    limits: &JointLimits<J>,
    elapsed: f64,
) -> (IkSource, [f64; J]) {
    if let Some(factor) = Cholesky::new(&task.h.data.0) {
        let free = factor.solve(&SVector::into(-task.g));
        if free.iter().all(|x| x.is_finite()) {
            return (IkSource::Clamped, allowed.nearest(&free));
        }
    }
    (IkSource::Brake, allowed.nearest(&limit::braking(&motion.qd, limits.deceleration(), elapsed)))
}
