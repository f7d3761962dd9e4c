//! Inverse kinematics: from what the tool should do to joint velocities the arm may have, as one QP per tick.
//!
//!   min over q̇ in the box:  ½ ‖J(q) q̇ − v*‖²_W + ½ λ‖q̇‖² + posture        v* = velocity + K·pose error
//!
//! Near a plane, a box or the arm itself, rows of [`crate::clearance`] are added, and near the bounds of the
//! tool's [`crate::envelope`] rows of that. A tick whose solution satisfies them all is solved without them.
//!
//! Contract: no allocation, no panic; the answer is finite and inside [`crate::arm::velocity_box`] whatever
//! the input. All kinematics belong to the joint positions last *commanded*, never to measured ones.
//! Singularities are met by damping that grows smoothly; there is no stop and no jump. Absent: planning, ways
//! around obstacles, several solution branches.

pub mod task;
pub mod pose;
mod stopping;

use crate::state::{choices, state};
use nalgebra::{SVector, Vector3};
use thiserror::Error;

use crate::arm::{JointLimits, JointMotion, Kinematics, VelocityBox, limits, velocity_box};
use crate::clearance::{Clearance, ClearanceReport, Inside};
use crate::envelope::Envelope;
use crate::qp::offered::OfferedRows;

pub use pose::solve_pose;
pub use stopping::{PathKept, StopPath, StopStep};
pub use task::{IkSettings, ToolTarget};

use crate::qp::QpStatus;
use crate::qp::backend::{Backend, OtherBox};
use crate::qp::box_qp::{self, ActiveBounds, BoxSolution};
use crate::qp::cholesky::Cholesky;
use crate::qp::row_qp::{self, ROW_TOLERANCE};

/// One IK step: joint velocities and how they came about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkStep<const J: usize> {
    /// \[rad/s\], inside the velocity box.
    pub qd: [f64; J],
    /// How they were found.
    pub report: IkReport,
}

/// Evidence of one IK step; the default is that of no step yet.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct IkReport {
    /// What produced the velocities.
    pub source: IkSource,
    /// How the QP ended.
    pub status: QpStatus,
    /// Steps of the active-set method.
    pub iterations: u32,
    /// Joints held by the box, one bit each, joint 0 lowest.
    pub active: ActiveBounds,
    /// KKT residual of the QP; NaN where nothing was solved.
    pub kkt_residual: f64,
    /// Wanted minus achieved velocity of the tool origin, base frame \[m/s\]: effect of limits and damping.
    pub velocity_error: Vector3<f64>,
    /// Size of the tilt rate that was wanted and not achieved \[rad/s\]; spin does not count.
    pub tilt_error: f64,
    /// λ used \[m²\].
    pub damping: f64,
    /// Distance to the nearest singularity \[m\], see [`task::singularity`].
    pub singularity: f64,
    /// Effect of the clearance rows.
    pub clearance: ClearanceReport,
    /// Rows of the tool's envelope that held the motion back, and rows that could not be satisfied.
    pub envelope: [u32; 2],
}

state! {
    [] IkReport {
        source, status, iterations, active, kkt_residual, velocity_error, tilt_error, damping,
        singularity, clearance, envelope,
    }
}

/// What produced the joint velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum IkSource {
    /// The optimum of the box QP.
    #[default]
    Optimum,
    /// Damped least squares clamped into the box, because the QP gave no usable answer.
    Clamped,
    /// Braking, because the input was not finite or no usable answer keeps the arm clear.
    Brake,
}

choices! { IkSource { Optimum, Clamped, Brake } }

/// Another solver refused to be set up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("{solver} could not be set up for a box of {joints} joint velocities: use the exact backend")]
pub struct BackendError {
    /// Name of the solver that refused.
    pub solver: &'static str,
    /// Number of joints of the arm.
    pub joints: usize,
}

/// The IK of one arm.
#[derive(Debug)]
pub struct Ik<const J: usize> {
    limits: JointLimits<J>,
    /// The same with the jerk of a stop.
    eased: JointLimits<J>,
    settings: IkSettings<J>,
    other: Option<Box<OtherBox<J>>>,
    clearance: Option<Box<Clearance<J>>>,
    envelope: Option<Box<Envelope<J>>>,
    /// Whether the tool's envelope is kept; not on the way home, where the pen does not lead the tool.
    envelope_in_force: bool,
    offered: OfferedRows<J>,
}

state! {
    [const J: usize] Ik<J> { envelope_in_force, offered }
    present { other, clearance, envelope }
    fixed { limits, eased, settings }
}

impl<const J: usize> Ik<J> {
    /// An IK that keeps `limits` and weighs by `settings`, solved exactly.
    #[must_use]
    pub fn new(limits: JointLimits<J>, settings: IkSettings<J>) -> Self {
        Self {
            limits,
            eased: limits.with_jerk(limits::stop_jerk(&limits)).unwrap_or(limits),
            settings,
            other: None,
            clearance: None,
            envelope: None,
            envelope_in_force: true,
            offered: OfferedRows::default(),
        }
    }

    /// The same IK with another solver.
    ///
    /// # Errors
    ///
    /// The solver refuses to be set up.
    pub fn with_backend(mut self, backend: Backend) -> Result<Self, BackendError> {
        self.other = match backend {
            Backend::Exact => None,
            Backend::Other(solver) => {
                let refused = BackendError { solver: solver.name(), joints: J };
                Some(Box::new(OtherBox::new(solver).ok_or(refused)?))
            }
        };
        Ok(self)
    }

    /// The same IK with clearance rows. Problems with rows are always solved exactly.
    #[must_use]
    pub fn keeping_clear(mut self, clearance: Clearance<J>) -> Self {
        self.clearance = Some(Box::new(clearance));
        self
    }

    /// The same IK keeping the tool inside `envelope`.
    #[must_use]
    pub fn inside(mut self, envelope: Envelope<J>) -> Self {
        self.envelope = Some(Box::new(envelope));
        self
    }

    /// The clearance, if any.
    #[must_use]
    pub fn clearance(&self) -> Option<&Clearance<J>> {
        self.clearance.as_deref()
    }

    /// Puts the tool's envelope in force, as it is initially, or out of force.
    pub const fn bind(&mut self, in_force: bool) {
        self.envelope_in_force = in_force;
    }

    /// The tool's envelope, if there is one and it is in force.
    pub fn envelope(&mut self) -> Option<&mut Envelope<J>> {
        self.envelope.as_deref_mut().filter(|_| self.envelope_in_force)
    }

    /// The limits that it keeps.
    #[must_use]
    pub const fn limits(&self) -> &JointLimits<J> {
        &self.limits
    }

    /// Weights and gains of the task.
    #[must_use]
    pub const fn settings(&self) -> &IkSettings<J> {
        &self.settings
    }

    /// Joint velocities for the next `elapsed` seconds.
    ///
    /// `motion`: last command; `kinematics`: `Chain::forward` at `motion.q`. The next joint position is q +
    /// q̇·elapsed.
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
        let solved = match &mut self.other {
            None => box_qp::solve(&task.h, &task.g, &lower, &upper),
            Some(other) => other.solve(&task.h, &task.g, &lower, &upper),
        };
        let mut answer = IkSolution::of(&solved);
        if !answer.status.usable() {
            (answer.source, answer.qd) = fallback(&task, motion, &allowed, &self.limits, elapsed);
        } else {
            answer.qd = allowed.nearest(&answer.qd);
        }
        let mut kept_by = [0; 2];
        let held = self.breaks(kinematics, motion, &answer.qd, &allowed, elapsed, Inside::Retreat);
        if held.broken {
            self.offer(kinematics, motion, &answer.qd, &allowed, elapsed);
            // Scaled so that the price of a row outweighs the task whatever its weights are.
            let scale = 1.0 / self.settings.normal_weight.powi(2).max(1.0);
            let kept =
                row_qp::solve(&(task.h * scale), &(task.g * scale), &lower, &upper, self.offered.rows());
            answer = IkSolution {
                source: IkSource::Optimum,
                qd: allowed.nearest(&kept.x.into()),
                status: kept.status,
                iterations: answer.iterations + kept.iterations,
                active: kept.active,
                kkt_residual: kept.kkt_residual,
            };
            if !kept.status.usable() {
                let straight = limits::braking_straight(&motion.qd, self.limits.acceleration(), elapsed);
                (answer.source, answer.qd) = (IkSource::Brake, allowed.nearest(&straight));
            }
            kept_by = [kept.held, kept.yielded];
        }
        let (clearance, envelope) = held.reports(kept_by);
        let qd = answer.qd;
        let missed = task.wanted - task.rows * SVector::from(qd);
        let length = self.settings.orientation_m * task.tilt_weight;
        let report = IkReport {
            source: answer.source,
            status: answer.status,
            iterations: answer.iterations,
            active: answer.active,
            kkt_residual: answer.kkt_residual,
            velocity_error: task::stretch(&target.axis, 1.0 / self.settings.normal_weight)
                * missed.fixed_rows::<3>(0),
            tilt_error: missed.fixed_rows::<2>(3).norm() / length,
            damping: task.damping,
            singularity: task.singularity,
            clearance,
            envelope,
        };
        IkStep { qd, report }
    }

    /// Whether `wanted` \[rad/s\] violates a row of clearance or envelope.
    fn breaks(
        &mut self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        wanted: &[f64; J],
        allowed: &VelocityBox<J>,
        elapsed: f64,
        inside: Inside,
    ) -> HeldBack {
        let mut held = HeldBack { broken: false, clear: 0 };
        if let Some(clearance) = &mut self.clearance {
            let rows = clearance.rows(kinematics, motion, allowed, elapsed, inside);
            held.clear = rows.len();
            held.broken = !rows.kept_by(wanted, ROW_TOLERANCE);
        }
        if let Some(envelope) = self.envelope.as_ref().filter(|_| self.envelope_in_force) {
            held.broken |= envelope.may_break(kinematics, motion, wanted, elapsed);
        }
        held
    }

    /// Puts the rows of clearance, as [`Self::breaks`] found them, and envelope into `offered`.
    fn offer(
        &mut self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        wanted: &[f64; J],
        allowed: &VelocityBox<J>,
        elapsed: f64,
    ) {
        match &self.clearance {
            Some(clearance) => self.offered.clone_from(clearance.found()),
            None => self.offered.clear(),
        }
        if let Some(envelope) = self.envelope.as_ref().filter(|_| self.envelope_in_force) {
            envelope.offer(kinematics, motion, wanted, allowed, elapsed, &mut self.offered);
        }
    }
}

/// Whether rows hold the motion back, and how many of them, counted from the first, are clearance rows.
#[derive(Debug, Clone, Copy)]
struct HeldBack {
    broken: bool,
    clear: usize,
}

impl HeldBack {
    /// Splits the bits `held` and `yielded` into those of clearance and of the envelope.
    fn reports(&self, [held, yielded]: [u32; 2]) -> (ClearanceReport, [u32; 2]) {
        let clear = u32::MAX.checked_shr(32 - self.clear.min(32) as u32).unwrap_or(0);
        let report = ClearanceReport {
            rows: self.clear as u32,
            held: (held & clear).count_ones(),
            yielded: (yielded & clear).count_ones(),
        };
        (report, [held & !clear, yielded & !clear].map(u32::count_ones))
    }
}

/// Joint velocities and how they were found.
struct IkSolution<const J: usize> {
    source: IkSource,
    qd: [f64; J],
    status: QpStatus,
    iterations: u32,
    active: ActiveBounds,
    kkt_residual: f64,
}

impl<const J: usize> IkSolution<J> {
    fn of(solved: &BoxSolution<J>) -> Self {
        let BoxSolution { x, status, iterations, active, kkt_residual } = *solved;
        Self { source: IkSource::Optimum, qd: x.into(), status, iterations, active, kkt_residual }
    }
}

/// A legal answer without the QP: clamped damped least squares, or braking if that is non-finite.
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
    (IkSource::Brake, allowed.nearest(&limits::braking(&motion.qd, limits.deceleration(), elapsed)))
}
