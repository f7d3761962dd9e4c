//! From a robot description to the joints of one serial chain, base to tip. Start-up only: allocates, returns
//! errors.
//!
//! Contract: reads a string, never a file. Accepts revolute, continuous and fixed joints; refuses whatever
//! the control law cannot follow, naming the joint or link and its line. Collision geometry becomes capsules
//! ([`crate::clearance`]), inertials the masses of [`crate::arm::Dynamics`]; all else is ignored
//! (`document.rs`).

use nalgebra::{Matrix3, Rotation3, Vector3};
use urdf_rs::{Joint, JointType, Robot};

use crate::arm::bodies::{Bodies, LinkPose, bodies, poses, still};
use crate::arm::chain_error::{ChainError, LONGEST_NAME};
use crate::arm::description::Description;
use crate::arm::dynamics::{DynamicsError, Inertia, inertias};

/// Names that a message lists at most.
const MOST_NAMED: usize = 40;

/// One moving joint with the fixed transform that leads to it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct UrdfJoint {
    pub(super) name: String,
    /// Previous joint's frame → this joint's frame at q = 0 (3 x 3).
    pub(super) rotation: Matrix3<f64>,
    /// Origin of this joint in the previous joint's frame \[m\].
    pub(super) translation: Vector3<f64>,
    /// Unit axis in this joint's frame.
    pub(super) axis: Vector3<f64>,
    /// \[lower, upper\] \[rad\], infinite for a continuous joint.
    pub(super) position: [f64; 2],
    /// \[rad/s\]
    pub(super) velocity: f64,
    /// \[Nm\]
    pub(super) effort: f64,
    /// Coulomb friction \[Nm\] and viscous friction \[Nm s/rad\], 0 where the description has none.
    pub(super) friction: [f64; 2],
}

/// A serial chain: moving joints base to tip, then the fixed transform to the tip link.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Segments {
    pub(super) segments: Vec<UrdfJoint>,
    pub(super) tip_rotation: Matrix3<f64>,
    pub(super) tip_translation: Vector3<f64>,
    pub(super) base: String,
    pub(super) tip: String,
    /// The base and all links that do not move against it.
    pub(super) still: Vec<StillLink>,
    /// The links that do not move against the last joint, in its frame.
    pub(super) wrist: Vec<StillLink>,
    pub(super) bodies: Bodies,
    /// What moves with each joint; a description with wrong inertials can still be followed.
    pub(super) inertias: Result<Vec<Inertia>, DynamicsError>,
}

/// A link that does not move against the base, or against the last joint.
#[derive(Debug, Clone, PartialEq)]
pub struct StillLink {
    /// Name of the link in the description.
    pub name: String,
    /// Its frame → that of the base or joint (3 x 3).
    pub rotation: Matrix3<f64>,
    /// Its origin in that frame \[m\].
    pub translation: Vector3<f64>,
    /// It hangs below the base, or is it, by parents and children; not where the base hangs below it.
    pub below: bool,
}

impl StillLink {
    fn of(pose: &LinkPose<'_>) -> Option<Self> {
        let (rotation, translation) = pose.place.clone().ok()?;
        Some(Self { name: pose.name.to_owned(), rotation, translation, below: pose.below })
    }
}

/// Reads the chain from `base` (default: the only root) to `tip` (default: the only leaf).
pub(super) fn segments(text: &str, base: Option<&str>, tip: Option<&str>) -> Result<Segments, ChainError> {
    let description = Description::read(text, false)?;
    let robot = &description.robot;
    let base = match base {
        Some(name) => known_link(robot, name)?,
        None => only_root(robot)?,
    };
    let fixed = still(&description, &base)?;
    let (path, tip) = match tip {
        Some(name) => {
            let tip = known_link(robot, name)?;
            (path_up(&description, &base, &fixed, &tip)?, tip)
        }
        None => {
            let path = path_down(&description, &base)?;
            let tip = path.last().map_or_else(|| base.clone(), |joint| joint.child.link.clone());
            let at_base = |joint: &&Joint| fixed.iter().any(|pose| pose.name == joint.child.link);
            (path.into_iter().skip_while(at_base).collect(), tip)
        }
    };
    // Where the path leaves what is fixed to the base.
    let foot = path.first().map_or(&tip, |joint| &joint.parent.link);
    let foot = fixed.iter().find(|pose| pose.name == foot).map(|pose| pose.place.clone());
    let (mut rotation, mut translation) = foot.unwrap_or(Ok((Matrix3::identity(), Vector3::zeros())))?;
    let poses = poses(&description, fixed, &path)?;
    let moving_joints = path.iter().filter(|joint| joint.joint_type != JointType::Fixed).count();
    let at = |link: usize| poses.iter().filter(move |pose| pose.link == link).filter_map(StillLink::of);
    let (still, wrist) = (at(0).collect(), at(moving_joints).collect());
    let bodies = bodies(&description, &poses)?;
    let inertias = inertias(&description, &poses, moving_joints);
    let mut segments: Vec<UrdfJoint> = Vec::new();
    for joint in path {
        let (r, t) = origin(&description, joint)?;
        translation += rotation * t;
        rotation *= r;
        if let Some(position) = moving(&description, joint)? {
            description.alone(joint, segments.iter().map(|joint| &joint.name))?;
            segments.push(segment(&description, joint, position, rotation, translation)?);
            (rotation, translation) = (Matrix3::identity(), Vector3::zeros());
        }
    }
    Ok(Segments {
        segments,
        tip_rotation: rotation,
        tip_translation: translation,
        base,
        tip,
        still,
        wrist,
        bodies,
        inertias,
    })
}

/// Reads a robot description for whoever opens its meshes: links with the meshes of their collision geometry
/// or, where they have none, of their visuals; joints.
///
/// # Errors
/// Too large or too deep, a xacro file, not XML, not URDF, no links, or one that cannot be read.
pub fn description(text: &str) -> Result<Robot, ChainError> {
    let description = Description::read(text, true)?;
    description.first_fault()?;
    Ok(description.robot)
}

fn known_link(robot: &Robot, name: &str) -> Result<String, ChainError> {
    if robot.links.iter().any(|l| l.name == name) {
        return Ok(name.to_owned());
    }
    let known = names(robot.links.iter().map(|l| &l.name));
    Err(ChainError::UnknownLink { link: name.to_owned(), known })
}

fn only_root(robot: &Robot) -> Result<String, ChainError> {
    let is_root = |name: &str| !robot.joints.iter().any(|j| j.child.link == name);
    let roots: Vec<&String> = robot.links.iter().map(|l| &l.name).filter(|n| is_root(n)).collect();
    match roots.as_slice() {
        [root] => Ok((*root).clone()),
        _ => Err(ChainError::Root { count: roots.len(), links: names(roots.into_iter()) }),
    }
}

/// Joints to `tip` from a link that is `fixed` to `base`, found by walking up: side branches (a gripper) do
/// not matter.
fn path_up<'a>(
    description: &'a Description,
    base: &str,
    fixed: &[LinkPose<'_>],
    tip: &str,
) -> Result<Vec<&'a Joint>, ChainError> {
    let robot = &description.robot;
    let mut path = Vec::new();
    let mut link = tip;
    while !fixed.iter().any(|pose| pose.name == link) {
        let mut parents = robot.joints.iter().filter(|j| j.child.link == link);
        let Some(joint) = parents.next() else {
            let from = format!("; the way up from there ends at link {}", description.link_part(link));
            return Err(ChainError::Disconnected { base: base.to_owned(), tip: tip.to_owned(), from });
        };
        if parents.next().is_some() || path.len() >= robot.joints.len() {
            return Err(ChainError::Loop { link: description.link_part(link) });
        }
        description.ends(joint)?;
        path.push(joint);
        link = &joint.parent.link;
    }
    path.reverse();
    Ok(path)
}

/// Joints from `base` to the only leaf.
fn path_down<'a>(description: &'a Description, base: &str) -> Result<Vec<&'a Joint>, ChainError> {
    let robot = &description.robot;
    let mut path: Vec<&Joint> = Vec::new();
    let mut link = base;
    loop {
        let children: Vec<&Joint> = robot.joints.iter().filter(|j| j.parent.link == link).collect();
        match children.as_slice() {
            [] => return Ok(path),
            [joint] if path.len() < robot.joints.len() => {
                description.ends(joint)?;
                path.push(joint);
                link = &joint.child.link;
            }
            [_] => return Err(ChainError::Loop { link: description.link_part(link) }),
            _ => {
                let joints = names(children.iter().map(|j| &j.name));
                return Err(ChainError::Branch { link: description.link_part(link), joints });
            }
        }
    }
}

/// The first of `all`, for a message, and how many there are beyond.
fn names<'a>(mut all: impl Iterator<Item = &'a String>) -> String {
    let named: Vec<String> = all.by_ref().take(MOST_NAMED).map(|n| format!("`{n:.LONGEST_NAME$}`")).collect();
    let named = named.join(", ");
    match all.count() {
        0 => named,
        more => format!("{named} and {more} more"),
    }
}

/// The fixed transform of a joint of `description` that the chain uses.
pub(super) fn origin(
    description: &Description,
    joint: &Joint,
) -> Result<(Matrix3<f64>, Vector3<f64>), ChainError> {
    description.usable(joint)?;
    let [x, y, z] = joint.origin.xyz.0;
    let [roll, pitch, yaw] = joint.origin.rpy.0;
    if ![x, y, z, roll, pitch, yaw].iter().all(|v| v.is_finite()) {
        return Err(ChainError::Origin { joint: description.joint_part(joint) });
    }
    Ok((Rotation3::from_euler_angles(roll, pitch, yaw).into_inner(), Vector3::new(x, y, z)))
}

/// Position limits of a moving joint, `None` for a fixed one.
fn moving(description: &Description, joint: &Joint) -> Result<Option<[f64; 2]>, ChainError> {
    let kind = match joint.joint_type {
        JointType::Fixed => return Ok(None),
        JointType::Revolute => {
            let (lower, upper) = (joint.limit.lower, joint.limit.upper);
            let bad = |what, value| limit_error(description, joint, what, value, "rad");
            if !lower.is_finite() {
                return Err(bad("lower position limit", lower));
            }
            if !(upper.is_finite() && lower < upper) {
                return Err(bad("upper position limit", upper));
            }
            return independent(description, joint, [lower, upper]);
        }
        JointType::Continuous => return independent(description, joint, [-f64::INFINITY, f64::INFINITY]),
        JointType::Prismatic => "prismatic",
        JointType::Floating => "floating",
        JointType::Planar => "planar",
        JointType::Spherical => "spherical",
    };
    Err(ChainError::Kind { joint: description.joint_part(joint), kind })
}

fn independent(
    description: &Description,
    joint: &Joint,
    position: [f64; 2],
) -> Result<Option<[f64; 2]>, ChainError> {
    match &joint.mimic {
        Some(m) => Err(ChainError::Mimic { joint: description.joint_part(joint), other: m.joint.clone() }),
        None => Ok(Some(position)),
    }
}

fn segment(
    description: &Description,
    joint: &Joint,
    position: [f64; 2],
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
) -> Result<UrdfJoint, ChainError> {
    let [x, y, z] = joint.axis.xyz.0;
    let length = Vector3::new(x, y, z).norm();
    if !(length.is_finite() && length > 1e-6) {
        return Err(ChainError::Axis { joint: description.joint_part(joint), x, y, z });
    }
    let (velocity, effort) = (joint.limit.velocity, joint.limit.effort);
    if !(velocity.is_finite() && velocity > 0.0) {
        return Err(limit_error(description, joint, "velocity limit", velocity, "rad/s"));
    }
    if !(effort.is_finite() && effort >= 0.0) {
        return Err(limit_error(description, joint, "effort limit", effort, "Nm"));
    }
    let dynamics = joint.dynamics.as_ref();
    let friction = dynamics.map_or([0.0; 2], |dynamics| [dynamics.friction, dynamics.damping]);
    for (what, value) in ["friction", "damping"].into_iter().zip(friction) {
        if !(value.is_finite() && value >= 0.0) {
            return Err(ChainError::Friction { joint: description.joint_part(joint), what, value });
        }
    }
    let axis = Vector3::new(x, y, z) / length;
    let name = joint.name.clone();
    Ok(UrdfJoint { name, rotation, translation, axis, position, velocity, effort, friction })
}

fn limit_error(
    description: &Description,
    joint: &Joint,
    what: &'static str,
    value: f64,
    unit: &'static str,
) -> ChainError {
    ChainError::Limit { joint: description.joint_part(joint), what, value, unit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_text_in_a_refusal_is_short() {
        let links: String = (0..5000).map(|n| format!("<link name=\"{n}{}\"/>", "x".repeat(500))).collect();
        let all = format!("<robot name=\"r\">{links}</robot>");
        let many = segments(&all, None, None).map(|_| ()).unwrap_err().to_string();
        assert!(many.len() < 4000 && many.contains("and 4960 more"), "{} bytes: {many:.300}", many.len());
        let quoted = format!("<robot name=\"r\"><link name=\"{}\"", "<".repeat(900));
        let message = description(&quoted).unwrap_err().to_string();
        assert!(message.len() < 2000 && message.contains("cannot be read as URDF"), "{message}");
    }
}
