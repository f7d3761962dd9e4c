//! From the URDF's collision geometry to capsules. Start-up only: allocates, returns errors.
//!
//! Contract: every capsule contains its whole shape. A cylinder gets a half-sphere at either end; a box
//! becomes a capsule along its longest edge. Links attached to the chain by fixed joints (a pen holder)
//! belong to it, branches with moving joints (fingers) do not. A description alone does not tell the size of
//! a mesh: links with meshes are named instead.

use nalgebra::{Matrix3, Rotation3, Vector3};
use urdf_rs::{Geometry, Joint, JointType};

use crate::arm::chain_error::ChainError;
use crate::arm::description::Description;
use crate::arm::urdf::origin;
use crate::geometry::Segment;

/// All points within `radius` of a segment that is fixed to a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Capsule {
    /// Name of the URDF's link.
    pub name: String,
    /// Number of moving joints between base and link; its frame is that of the joint before it (0: the base).
    pub link: usize,
    /// In the link's frame \[m\].
    pub segment: Segment,
    /// \[m\]
    pub radius: f64,
}

/// Shapes of the links of a chain, each in the frame of the moving joint before it.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Bodies {
    pub(super) capsules: Vec<Capsule>,
    /// Links that have geometry, but only meshes.
    pub(super) meshes: Vec<String>,
}

/// The pose of a link in the frame of the moving joint before it, as the URDF has it.
pub(super) struct LinkPose<'a> {
    pub(super) name: &'a str,
    /// Number of moving joints between base and link.
    pub(super) link: usize,
    pub(super) rotation: Matrix3<f64>,
    pub(super) translation: Vector3<f64>,
}

impl LinkPose<'_> {
    fn beyond<'a>(&self, description: &Description, joint: &'a Joint) -> Result<LinkPose<'a>, ChainError> {
        let (r, t) = origin(description, joint)?;
        let (rotation, translation) = (self.rotation * r, self.translation + self.rotation * t);
        Ok(LinkPose { name: &joint.child.link, link: self.link, rotation, translation })
    }
}

/// All links on `path` (base to tip) and those fixed to them.
pub(super) fn poses<'a>(
    description: &'a Description,
    base: &'a str,
    path: &[&'a Joint],
) -> Result<Vec<LinkPose<'a>>, ChainError> {
    let (rotation, translation) = (Matrix3::identity(), Vector3::zeros());
    let mut poses = vec![LinkPose { name: base, link: 0, rotation, translation }];
    for joint in path {
        let Some(last) = poses.last() else { break };
        let mut next = last.beyond(description, joint)?;
        if joint.joint_type != JointType::Fixed {
            (next.rotation, next.translation) = (Matrix3::identity(), Vector3::zeros());
            next.link += 1;
        }
        poses.push(next);
    }
    let mut done = 0;
    while let Some(pose) = poses.get(done) {
        let fixed = description.robot.joints.iter().filter(|joint| {
            joint.parent.link == pose.name
                && joint.joint_type == JointType::Fixed
                && !poses.iter().any(|known| known.name == joint.child.link)
        });
        let branches: Result<Vec<_>, _> = fixed.map(|joint| pose.beyond(description, joint)).collect();
        poses.extend(branches?);
        done += 1;
    }
    Ok(poses)
}

/// The capsules of these links.
pub(super) fn bodies(description: &Description, poses: &[LinkPose<'_>]) -> Result<Bodies, ChainError> {
    let mut found = Bodies::default();
    for pose in poses {
        shapes(description, pose, &mut found)?;
    }
    Ok(found)
}

fn shapes(description: &Description, pose: &LinkPose<'_>, found: &mut Bodies) -> Result<(), ChainError> {
    let Some(link) = description.link(pose.name)? else { return Ok(()) };
    let before = found.capsules.len();
    for collision in &link.collision {
        let [roll, pitch, yaw] = collision.origin.rpy.0;
        let turn: Matrix3<f64> = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner();
        let Some((along, radius)) = capsule(&collision.geometry) else { continue };
        let rotation = pose.rotation * turn;
        let centre = pose.translation + pose.rotation * Vector3::from(collision.origin.xyz.0);
        let half = rotation * along;
        let segment = Segment { from: centre - half, to: centre + half };
        let finite = segment.from.iter().chain(&segment.to).all(|x| x.is_finite());
        if !(finite && radius.is_finite() && radius > 0.0) {
            return Err(ChainError::Shape { link: description.link_part(pose.name) });
        }
        found.capsules.push(Capsule { name: pose.name.to_owned(), link: pose.link, segment, radius });
    }
    if found.capsules.len() == before && !link.collision.is_empty() {
        found.meshes.push(pose.name.to_owned());
    }
    Ok(())
}

/// Half of the capsule's axis in the shape's frame \[m\], and its radius \[m\].
fn capsule(geometry: &Geometry) -> Option<(Vector3<f64>, f64)> {
    match geometry {
        Geometry::Sphere { radius } => Some((Vector3::zeros(), *radius)),
        Geometry::Cylinder { radius, length } | Geometry::Capsule { radius, length } => {
            Some((Vector3::z() * (0.5 * length), *radius))
        }
        Geometry::Box { size } => {
            let half = Vector3::from(size.0) * 0.5;
            let longest = half.imax();
            let mut along = Vector3::zeros();
            let mut rest = half;
            if let (Some(along), Some(rest)) = (along.get_mut(longest), rest.get_mut(longest)) {
                (*along, *rest) = (*rest, 0.0);
            }
            Some((along, rest.norm()))
        }
        Geometry::Mesh { .. } => None,
    }
}
