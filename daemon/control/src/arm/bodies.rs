//! From the URDF's collision geometry to capsules. Start-up only: allocates, returns errors.
//!
//! Contract: every capsule contains its whole shape. A cylinder gets a half-sphere at either end; a box
//! becomes a capsule along its longest edge. Links attached to the chain by fixed joints (a pen holder, a
//! post beside the base) belong to it, branches with moving joints (fingers) do not. No shape is lost: a
//! fixed joint that leads nowhere is refused. A description alone does not tell the size of a mesh: links
//! with meshes are named instead.

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

/// Rotation (3 x 3) and translation \[m\] of a link against the moving joint before it, as the URDF has them.
pub(super) type LinkPlace = (Matrix3<f64>, Vector3<f64>);

/// A link that does not move against the base, or against a joint of the chain.
pub(super) struct LinkPose<'a> {
    pub(super) name: &'a str,
    /// Number of moving joints between base and link.
    pub(super) link: usize,
    /// In the frame of the moving joint before it, or why nobody knows: that counts where a shape stands.
    pub(super) place: Result<LinkPlace, ChainError>,
    /// It hangs below the base or that joint, by parents and children.
    pub(super) below: bool,
}

impl<'a> LinkPose<'a> {
    /// The link at the other end of a joint of this one.
    fn beyond(&self, description: &Description, joint: &'a Joint) -> Self {
        let up = joint.child.link == self.name;
        let place = self.place.clone().and_then(|(rotation, translation)| {
            let (r, t) = origin(description, joint)?;
            if up {
                let rotation = rotation * r.transpose();
                return Ok((rotation, translation - rotation * t));
            }
            Ok((rotation * r, translation + rotation * t))
        });
        let name = if up { &joint.parent.link } else { &joint.child.link };
        LinkPose { name, link: self.link, place, below: self.below && !up }
    }
}

/// The base and all links that do not move against it, whether they hang below it or it below them.
///
/// # Errors
/// As [`fixed_to`].
pub(super) fn still<'a>(
    description: &'a Description,
    base: &'a str,
) -> Result<Vec<LinkPose<'a>>, ChainError> {
    let place = Ok((Matrix3::identity(), Vector3::zeros()));
    let mut poses = vec![LinkPose { name: base, link: 0, place, below: true }];
    fixed_to(description, &mut poses)?;
    Ok(poses)
}

/// The links `still` at the base, all links on `path` (from one of those to the tip) and those fixed to them.
///
/// # Errors
/// As [`fixed_to`]; a joint of the path without an origin.
pub(super) fn poses<'a>(
    description: &'a Description,
    still: Vec<LinkPose<'a>>,
    path: &[&'a Joint],
) -> Result<Vec<LinkPose<'a>>, ChainError> {
    let mut poses = still;
    let first = path.first().and_then(|joint| poses.iter().find(|pose| pose.name == joint.parent.link));
    let Some(mut last) = first.map(|pose| LinkPose { place: pose.place.clone(), below: true, ..*pose })
    else {
        return Ok(poses);
    };
    for joint in path {
        last = last.beyond(description, joint);
        last.place.clone()?;
        if joint.joint_type != JointType::Fixed {
            last.place = Ok((Matrix3::identity(), Vector3::zeros()));
            last.link += 1;
        }
        poses.push(LinkPose { place: last.place.clone(), ..last });
    }
    fixed_to(description, &mut poses)?;
    lost(description, &poses)?;
    Ok(poses)
}

/// Adds all links that fixed joints attach to these.
///
/// # Errors
/// A fixed joint at one of them names a link that is not there, or one of them hangs at two joints.
fn fixed_to<'a>(description: &'a Description, poses: &mut Vec<LinkPose<'a>>) -> Result<(), ChainError> {
    let mut done = 0;
    while let Some(pose) = poses.get(done) {
        let joints = || description.robot.joints.iter();
        if joints().filter(|joint| joint.child.link == pose.name).nth(1).is_some() {
            return Err(ChainError::Loop { link: description.link_part(pose.name) });
        }
        let mut found: Vec<LinkPose<'_>> = Vec::new();
        for joint in joints().filter(|joint| joint.joint_type == JointType::Fixed) {
            if joint.parent.link != pose.name && joint.child.link != pose.name {
                continue;
            }
            description.ends(joint)?;
            let other = pose.beyond(description, joint);
            if !poses.iter().chain(&found).any(|known| known.name == other.name) {
                found.push(other);
            }
        }
        poses.extend(found);
        done += 1;
    }
    Ok(())
}

/// A fixed joint whose parent is not there could stand at the chain: what hangs at it may not be lost. Where
/// its child is not there either, that is any link that hangs nowhere.
fn lost(description: &Description, poses: &[LinkPose<'_>]) -> Result<(), ChainError> {
    let (links, joints) = (&description.robot.links, &description.robot.joints);
    let known = |name: &str| links.iter().any(|link| link.name == name);
    let outside = |name: &str| !poses.iter().any(|pose| pose.name == name);
    let hangs = |name: &str| joints.iter().any(|joint| joint.child.link == name);
    let mut anywhere = false;
    // Of all such joints: what was looked at once is not looked at again.
    let (mut below, mut done) = (Vec::new(), 0);
    for joint in joints.iter().filter(|joint| joint.joint_type == JointType::Fixed) {
        let child = joint.child.link.as_str();
        if known(&joint.parent.link) {
            continue;
        }
        if !known(child) && !anywhere {
            anywhere = true;
            let names = links.iter().map(|link| link.name.as_str());
            below.extend(names.filter(|name| outside(name) && !hangs(name)));
        } else if known(child) && outside(child) && !below.contains(&child) {
            below.push(child);
        }
        while let Some(name) = below.get(done).copied() {
            if description.counts(name) {
                return description.ends(joint);
            }
            for next in joints {
                let child = next.child.link.as_str();
                if next.joint_type == JointType::Fixed && next.parent.link == name && !below.contains(&child)
                {
                    below.push(child);
                }
            }
            done += 1;
        }
    }
    Ok(())
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
        let (rotation, translation) = pose.place.clone()?;
        let centre = translation + rotation * Vector3::from(collision.origin.xyz.0);
        let half = rotation * turn * along;
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

/// Half of the capsule's axis in the shape's frame \[m\], and its radius \[m\]; NaN for a size below 0.
fn capsule(geometry: &Geometry) -> Option<(Vector3<f64>, f64)> {
    let size = |value: f64| if value >= 0.0 { value } else { f64::NAN };
    match geometry {
        Geometry::Sphere { radius } => Some((Vector3::zeros(), *radius)),
        Geometry::Cylinder { radius, length } | Geometry::Capsule { radius, length } => {
            Some((Vector3::z() * (0.5 * size(*length)), *radius))
        }
        Geometry::Box { size: edges } => {
            let half = Vector3::from(edges.0).map(|edge| 0.5 * size(edge));
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

#[cfg(test)]
mod tests;
