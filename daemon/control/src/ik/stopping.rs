//! Joint velocities of a stop: those of every joint's own braking, changed no more than rows need.
//!
//! Joints that brake by themselves do not keep the tool's path: they stop one after the other, and a tip that
//! wrote goes into the paper. Rows of a stop hold it up: clearance and envelope as in every tick, and the
//! *path*,
//!
//!   nᵀJ q̇ + ½h·nᵀJ̇q̇ ≥ −v,   v: the fastest from which the tip is at rest at the floor,
//!   lᵀJ q̇ + ½h·lᵀJ̇q̇ ∈ [min(w, 0), max(w, 0)],   w: the next speed of a stop of its own across the line,
//!
//! with half of the acceleration and jerk that the joints give along n and l. The paper comes before the
//! line.
//!
//! Contract: no allocation, no panic; total. Rows of the path move no joint outside the stop's own limit of
//! jerk; where they cannot be kept they are violated least. Absent: a way back up, or back onto the line.

use nalgebra::{SMatrix, SVector, Vector3};

use super::Ik;
use crate::arm::limits::{self, slowed};
use crate::arm::{JointLimits, JointMotion, Kinematics, VelocityBox, velocity_box};
use crate::clearance::{ClearanceReport, Inside};
use crate::envelope::fastest_stoppable;
use crate::qp::offered::OfferedRows;
use crate::qp::row_qp::{self, ROW_TOLERANCE, RowSolution};

/// Price of the rows relative to a clearance row; below those of the envelope.
const FLOOR_WEIGHT: f64 = 0.05;
const LINE_WEIGHT: f64 = 0.005;
/// Share of the joints' acceleration and jerk that a stop across the line uses.
const COUNTED_ON: f64 = 0.5;
/// Least jerk of such a stop \[m/s³\], where the joints give hardly any: a number to divide by.
const LEAST_MPS3: f64 = 1e-3;

/// The path that a stop keeps, seen from where the tool is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StopPath {
    /// Away from the paper, a unit vector of the base frame.
    pub normal: Vector3<f64>,
    /// How far the tip may still go against the normal \[m\]; negative below the floor.
    pub room_m: f64,
    /// Across the line, a unit vector of the base frame at right angles to the normal; `None`: there is no
    /// line to keep.
    pub across: Option<Vector3<f64>>,
}

/// Joint velocities of a stop, and the effect of the rows on them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StopStep<const J: usize> {
    /// \[rad/s\], inside the velocity box if the wanted velocities are.
    pub qd: [f64; J],
    /// `held` and `yielded` are 0 if nothing was changed.
    pub clearance: ClearanceReport,
    /// See [`super::IkReport::envelope`].
    pub envelope: [u32; 2],
    /// What became of the path.
    pub path: PathKept,
}

/// What became of the path in one step of a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PathKept {
    /// Nothing was changed for it.
    #[default]
    Free,
    /// The velocities keep it, as far as joint limits allow.
    Kept,
    /// They do not: nothing certified was found, or nothing was to be solved.
    Lost,
}

/// The rows of a path in one step.
struct PathRows<const J: usize> {
    /// c and b of c·q̇ ≥ b \[m/rad, m/s\].
    floor: ([f64; J], f64),
    /// c and both bounds of c·q̇.
    line: Option<([f64; J], [f64; 2])>,
}

impl<const J: usize> PathRows<J> {
    fn new(
        path: &StopPath,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        limits: &JointLimits<J>,
        elapsed: f64,
    ) -> Self {
        let linear = kinematics.jacobian.fixed_rows::<3>(0);
        let bending = kinematics.jacobian_dot_qd(&motion.qd).fixed_rows::<3>(0).into_owned();
        let along = |direction: &Vector3<f64>| {
            let [row] = linear.tr_mul(direction).data.0;
            (row, 0.5 * elapsed * bending.dot(direction))
        };
        let (row, bent) = along(&path.normal);
        let fastest = fastest_stoppable(limits, &row, motion, path.room_m, elapsed, -1.0);
        let line = path.across.map(|across| {
            let (row, bent) = along(&across);
            let most =
                |of: &[f64; J]| COUNTED_ON * row.iter().zip(of).map(|(c, most)| c.abs() * most).sum::<f64>();
            let jerk = limits.jerk().map_or(f64::INFINITY, most).max(LEAST_MPS3);
            let (v, a) = (dot(&row, &motion.qd), dot(&row, &motion.qdd) + bending.dot(&across));
            let next = slowed(v, a, elapsed, most(limits.acceleration()), jerk);
            (row, [next.min(0.0) - bent, next.max(0.0) - bent])
        });
        Self { floor: (row, -fastest - bent), line }
    }

    fn kept_by(&self, qd: &[f64; J]) -> bool {
        let (row, least) = &self.floor;
        let above = dot(row, qd) >= least - ROW_TOLERANCE / FLOOR_WEIGHT;
        let on = |(row, [least, most]): &([f64; J], [f64; 2])| {
            let (across, rounding) = (dot(row, qd), ROW_TOLERANCE / LINE_WEIGHT);
            across >= least - rounding && across <= most + rounding
        };
        above && self.line.as_ref().is_none_or(on)
    }

    fn offer(&self, allowed: &VelocityBox<J>, offered: &mut OfferedRows<J>) {
        let mut put = |row: &[f64; J], bound: f64, weight: f64| {
            offered.offer(&row.map(|c| c * weight), bound * weight, allowed);
        };
        let (row, least) = &self.floor;
        put(row, *least, FLOOR_WEIGHT);
        if let Some((row, [least, most])) = &self.line {
            put(row, *least, LINE_WEIGHT);
            put(row, *most, -LINE_WEIGHT);
        }
    }
}

impl<const J: usize> Ik<J> {
    /// The velocities nearest to `wanted` \[rad/s\], a step of a stop, that satisfy the rows; `path`: what
    /// the stop keeps, if anything. With `solve` false the path is given up where `wanted` leaves it.
    ///
    /// Joints that brake independently can close a gap that they kept together. Rows of a stop demand no
    /// retreat, so zero velocity satisfies them all: the minimiser of ‖q̇ − wanted‖² over box and rows is
    /// never farther from rest than `wanted`, if rest is in the box.
    #[must_use]
    pub fn stopping(
        &mut self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        wanted: &[f64; J],
        elapsed: f64,
        path: Option<&StopPath>,
        solve: bool,
    ) -> StopStep<J> {
        let allowed = velocity_box(motion, &self.limits, elapsed);
        let held = self.breaks(kinematics, motion, wanted, &allowed, elapsed, Inside::Stay);
        let rows = path.map(|path| PathRows::new(path, kinematics, motion, &self.eased, elapsed));
        let rows = rows.filter(|rows| !rows.kept_by(wanted));
        let lost = if rows.is_some() { PathKept::Lost } else { PathKept::Free };
        if let Some(rows) = rows.filter(|_| solve) {
            // Only what must not be touched is worth a jolt, and only where it is not kept without one.
            let gently = velocity_box(motion, &self.eased, elapsed);
            for inside in [Some(gently), held.broken.then_some(allowed)].into_iter().flatten() {
                self.offer(kinematics, motion, wanted, &inside, elapsed);
                let bits = |rows: usize| u32::MAX.checked_shr(32 - rows.min(32) as u32).unwrap_or(0);
                let others = bits(self.offered.rows().len());
                let with_floor = bits(self.offered.rows().len() + 1);
                rows.offer(&inside, &mut self.offered);
                let kept = self.nearest_kept(wanted, &inside);
                let gentle = kept.yielded & with_floor == 0 || inside == allowed || !held.broken;
                if kept.status.usable() && gentle {
                    let (clearance, envelope) = held.reports([kept.held & others, kept.yielded & others]);
                    let qd = inside.nearest(&kept.x.into());
                    return StopStep { qd, clearance, envelope, path: PathKept::Kept };
                }
            }
        }
        if !held.broken {
            let (clearance, envelope) = held.reports([0; 2]);
            return StopStep { qd: *wanted, clearance, envelope, path: lost };
        }
        self.offer(kinematics, motion, wanted, &allowed, elapsed);
        let kept = self.nearest_kept(wanted, &allowed);
        let (clearance, envelope) = held.reports([kept.held, kept.yielded]);
        let qd = if kept.status.usable() {
            allowed.nearest(&kept.x.into())
        } else {
            allowed.nearest(&limits::braking_straight(&motion.qd, self.limits.acceleration(), elapsed))
        };
        StopStep { qd, clearance, envelope, path: lost }
    }

    /// The velocities in `inside` nearest to `wanted` \[rad/s\] that satisfy the rows offered.
    fn nearest_kept(&self, wanted: &[f64; J], inside: &VelocityBox<J>) -> RowSolution<J> {
        let (lower, upper) = (SVector::from(inside.lower), SVector::from(inside.upper));
        row_qp::solve(&SMatrix::identity(), &-SVector::from(*wanted), &lower, &upper, self.offered.rows())
    }
}

fn dot<const J: usize>(a: &[f64; J], b: &[f64; J]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
