//! Where an arm has to stand to be armed.

use nalgebra::Vector3;

use crate::arm::{Chain, JointLimits, Kinematics};
use crate::follower::FollowerSettings;
use crate::follower::io::Refusal;
use crate::mpc::AxisLimits;
use crate::plane::Plane;

/// Bounds on the pose of an arm that is to be armed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arming {
    plane: Plane,
    workspace: [AxisLimits; 3],
    /// Farthest that the tool may stand outside the workspace \[m\].
    margin: f64,
    cos_tilt: f64,
}

impl Arming {
    pub(super) fn new<const J: usize>(settings: &FollowerSettings<J>) -> Self {
        let safety = &settings.safety;
        Self {
            plane: settings.plane,
            workspace: settings.mpc.limits(),
            margin: safety.arm_workspace_margin,
            cos_tilt: safety.arm_max_tilt.cos(),
        }
    }

    /// The pose of an arm that stands at `q` \[rad\], and its tool in the plane \[m\].
    ///
    /// # Errors
    ///
    /// The arm may not be armed there.
    pub(super) fn pose<const J: usize>(
        &self,
        limits: &JointLimits<J>,
        chain: &Chain<J>,
        q: &[f64; J],
    ) -> Result<(Kinematics<J>, Vector3<f64>), Refusal> {
        let inside = |(q, [low, high]): (&f64, &[f64; 2])| *q >= *low && *q <= *high;
        if !q.iter().zip(limits.position()).all(inside) {
            return Err(Refusal::OutsideJointLimits);
        }
        let kinematics = chain.forward(q);
        let tool = self.plane.point_from_base(&kinematics.position);
        let within = |(x, axis): (&f64, &AxisLimits)| {
            let [low, high] = axis.position_m;
            *x >= low - self.margin && *x <= high + self.margin
        };
        if !tool.iter().zip(&self.workspace).all(within) {
            return Err(Refusal::ToolOutsideWorkspace);
        }
        let axis = kinematics.rotation.column(2).dot(&self.plane.tool_axis());
        if !(axis >= self.cos_tilt) {
            return Err(Refusal::ToolNotAligned);
        }
        Ok((kinematics, tool))
    }
}

impl<const J: usize> FollowerSettings<J> {
    /// Whether an arm that stands still at `q` \[rad\] may be armed there.
    ///
    /// # Errors
    /// [`Refusal::OutsideJointLimits`], [`Refusal::ToolOutsideWorkspace`] or [`Refusal::ToolNotAligned`].
    pub fn may_arm_at(&self, q: &[f64; J]) -> Result<(), Refusal> {
        Arming::new(self).pose(&self.limits, &self.chain, q).map(drop)
    }
}
