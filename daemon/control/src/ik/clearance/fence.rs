//! A box that keeping clear must not drive the tool out of.
//!
//! The plan keeps the tool in its workspace, but what slides along an oblique face moves in directions that the plan did not
//! choose. So wherever a distance holds the arm back, the tool's origin may approach the fence only as distances may shrink:
//!
//!   nᵀJ q̇ + ½h·nᵀJ̇q̇ ≥ min(−ξ (gap to the fence), 0)
//!
//! Distances come first: fence rows are scaled down, and so is the price of breaking them. Where no distance holds the arm
//! back there is no fence, and the motion is the plan's alone.

use nalgebra::{Matrix3, Vector3};

use super::{Clearance, VelocityBox};
use crate::ik::chain::Kinematics;
use crate::ik::limit::JointMotion;
use crate::qp::row_qp::RowSet;

/// Weight of a fence row beside that of a distance.
const WEIGHT: f64 = 0.01;

/// Where the tool's origin may be while something holds the arm back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fence {
    /// Origin of its frame in the base frame [m].
    pub origin: Vector3<f64>,
    /// Columns: its axes in the base frame, orthonormal.
    pub axes: Matrix3<f64>,
    /// [lowest, highest] along its axes [m].
    pub inside: [[f64; 2]; 3],
}

impl<const J: usize> Clearance<J> {
    /// The same with a fence around the tool.
    #[must_use]
    pub fn fenced(mut self, fence: Fence) -> Self {
        self.fence = Some(fence);
        self
    }

    /// The rows found last and those of the fence.
    pub(in crate::ik) fn rows_fenced(
        &mut self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        allowed: &VelocityBox<J>,
        elapsed: f64,
    ) -> &RowSet<J> {
        let Some(fence) = &self.fence else { return &self.found.rows };
        let bending: Vector3<f64> = kinematics.jacobian_dot_qd(&motion.qd).fixed_rows::<3>(0).into_owned();
        let jacobian = kinematics.jacobian.fixed_rows::<3>(0);
        let tool = fence.axes.tr_mul(&(kinematics.position - fence.origin));
        for ((axis, at), [low, high]) in fence.axes.column_iter().zip(&tool).zip(&fence.inside) {
            for (normal, gap) in [(axis * WEIGHT, at - low), (axis * -WEIGHT, high - at)] {
                let [row] = jacobian.tr_mul(&normal).data.0;
                let bound = (-self.rate * gap).min(0.0) * WEIGHT - 0.5 * elapsed * bending.dot(&normal);
                self.found.offer(&row, bound, allowed);
            }
        }
        &self.found.rows
    }
}
