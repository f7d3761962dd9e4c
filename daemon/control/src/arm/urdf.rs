//! From a URDF text to the joints of one serial chain, base to tip. Start-up only: allocates, returns errors.
//!
//! Contract: reads a string, never a file. Accepts revolute, continuous and fixed joints; refuses whatever
//! the control law cannot follow, naming the joint or link. Collision geometry becomes capsules
//! ([`crate::clearance`]), inertials the masses of [`crate::arm::Dynamics`]; visuals and transmissions are
//! ignored.

use nalgebra::{Matrix3, Rotation3, Vector3};
use thiserror::Error;
use urdf_rs::{Joint, JointType, Robot};

use crate::arm::bodies::{Bodies, bodies, poses};
use crate::arm::bounds::bounded;
use crate::arm::dynamics::{DynamicsError, Inertia, inertias};

/// Names that a message lists at most, and characters of each.
const MOST_NAMED: usize = 40;
const LONGEST_NAME: usize = 60;
/// Characters of the reader's own message at most: it may quote the file.
const LONGEST_REASON: usize = 400;

/// Why a robot description cannot be used.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ChainError {
    /// Not XML, or not URDF.
    #[error("the robot description cannot be read as URDF: {reason}")]
    Malformed {
        /// Message of the parser of XML.
        reason: String,
    },
    /// Larger than anything that describes an arm.
    #[error(
        "the robot description has {found} {what}, {most} are the most that are read: name that of one arm"
    )]
    Bound {
        /// What is counted, as in the message.
        what: &'static str,
        /// How many there are; where it stopped counting, at least.
        found: usize,
        /// How many there may be.
        most: usize,
    },
    /// A macro file that has to be expanded first.
    #[error("it is a xacro file: expand it first with `xacro FILE > robot.urdf`, and name robot.urdf")]
    Xacro,
    /// No link at all.
    #[error("the description has no links: it is no description of a robot")]
    Empty,
    /// The named base or tip does not exist.
    #[error("link `{link}` does not exist; the links are: {known}")]
    UnknownLink {
        /// Name of the link that was asked for.
        link: String,
        /// Names of all links, for the message.
        known: String,
    },
    /// No base was named and the description has no single root.
    #[error("the description has {count} root links ({links}); name the base link")]
    Root {
        /// How many links have no parent.
        count: usize,
        /// Names of these links, for the message.
        links: String,
    },
    /// No tip was named and the chain branches.
    #[error("the chain branches at link `{link}` into joints {joints}; name the tip link")]
    Branch {
        /// Link at which the chain branches.
        link: String,
        /// The joints that leave there.
        joints: String,
    },
    /// A link is the child of two joints, or its own ancestor.
    #[error(
        "link `{link}` is the child of more than one joint, or of itself; a serial chain needs exactly one \
         parent"
    )]
    Loop {
        /// Link that is its own ancestor.
        link: String,
    },
    /// The tip is not below the base.
    #[error("link `{tip}` is not below link `{base}`")]
    Disconnected {
        /// Name of the link where the chain begins.
        base: String,
        /// Name of the link where the chain ends.
        tip: String,
    },
    /// A joint type other than revolute, continuous and fixed.
    #[error("joint `{joint}` is {kind}; only revolute, continuous and fixed joints can be followed")]
    Kind {
        /// Name of the joint in the description.
        joint: String,
        /// Its type in URDF.
        kind: &'static str,
    },
    /// A joint that mimics another one is not independent.
    #[error("joint `{joint}` mimics `{other}`; a chain needs independent joints")]
    Mimic {
        /// Name of the joint in the description.
        joint: String,
        /// Name of the other joint.
        other: String,
    },
    /// The wrong number of moving joints.
    #[error("{found} moving joints between `{base}` and `{tip}`, but {expected} are needed")]
    Count {
        /// Moving joints that the description has.
        found: usize,
        /// Moving joints that the arm has.
        expected: usize,
        /// Name of the link where the chain begins.
        base: String,
        /// Name of the link where the chain ends.
        tip: String,
    },
    /// The axis is shorter than 1e-6 or NaN.
    #[error("joint `{joint}`: axis [{x}, {y}, {z}] has no direction")]
    Axis {
        /// Name of the joint in the description.
        joint: String,
        /// Component of the axis, as in the description.
        x: f64,
        /// Component of the axis, as in the description.
        y: f64,
        /// Component of the axis, as in the description.
        z: f64,
    },
    /// An origin is non-finite.
    #[error("joint `{joint}`: origin xyz or rpy is not a finite number")]
    Origin {
        /// Name of the joint in the description.
        joint: String,
    },
    /// A shape of the collision geometry has an invalid size or origin.
    #[error(
        "link `{link}`: a shape of its collision geometry has a size that is not positive, or a number that \
         is not finite"
    )]
    Shape {
        /// Name of the link in the description.
        link: String,
    },
    /// Friction below 0 or NaN.
    #[error(
        "joint `{joint}`: <dynamics {what}=\"{value}\"> cannot be used; give a number of 0 or more, or leave \
         it out"
    )]
    Friction {
        /// Name of the joint in the description.
        joint: String,
        /// Name of the number, as in the message.
        what: &'static str,
        /// The value that the description has.
        value: f64,
    },
    /// The limit element is missing, empty or NaN.
    #[error(
        "joint `{joint}`: {what} {value} {unit} cannot be used; give <limit lower upper velocity effort>, \
         finite and lower < upper"
    )]
    Limit {
        /// Name of the joint in the description.
        joint: String,
        /// Name of the number, as in the message.
        what: &'static str,
        /// As read (0 when absent).
        value: f64,
        /// Unit of the value, as in the message.
        unit: &'static str,
    },
}

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
    pub(super) bodies: Bodies,
    /// What moves with each joint; a description with wrong inertials can still be followed.
    pub(super) inertias: Result<Vec<Inertia>, DynamicsError>,
}

/// Reads the chain from `base` (default: the only root) to `tip` (default: the only leaf).
pub(super) fn segments(text: &str, base: Option<&str>, tip: Option<&str>) -> Result<Segments, ChainError> {
    let robot = description(text)?;
    let base = match base {
        Some(name) => known_link(&robot, name)?,
        None => only_root(&robot)?,
    };
    let path = match tip {
        Some(name) => path_up(&robot, &base, &known_link(&robot, name)?)?,
        None => path_down(&robot, &base)?,
    };
    let tip = path.last().map_or_else(|| base.clone(), |j| j.child.link.clone());

    let poses = poses(&robot, &base, &path)?;
    let bodies = bodies(&robot, &poses)?;
    let moving_joints = path.iter().filter(|joint| joint.joint_type != JointType::Fixed).count();
    let inertias = inertias(&robot, &poses, moving_joints);
    let mut segments = Vec::new();
    let (mut rotation, mut translation) = (Matrix3::identity(), Vector3::zeros());
    for joint in path {
        let (r, t) = origin(joint)?;
        translation += rotation * t;
        rotation *= r;
        if let Some(position) = moving(joint)? {
            segments.push(segment(joint, position, rotation, translation)?);
            (rotation, translation) = (Matrix3::identity(), Vector3::zeros());
        }
    }
    Ok(Segments {
        segments,
        tip_rotation: rotation,
        tip_translation: translation,
        base,
        tip,
        bodies,
        inertias,
    })
}

/// Reads a robot description.
///
/// # Errors
/// Too large or too deep, a xacro file, not XML, not URDF, or no links.
pub fn description(text: &str) -> Result<Robot, ChainError> {
    bounded(text)?;
    // Macros are not URDF: without expansion only part of the arm would be read, or nothing.
    if xacro(text) {
        return Err(ChainError::Xacro);
    }
    let robot = urdf_rs::read_from_string(text).map_err(|error| {
        let reason = error.to_string().chars().take(LONGEST_REASON).collect();
        ChainError::Malformed { reason }
    })?;
    if robot.links.is_empty() {
        return Err(ChainError::Empty);
    }
    Ok(robot)
}

/// Whether the text has elements or substitutions of xacro; expansion leaves the namespace declaration alone.
fn xacro(text: &str) -> bool {
    text.contains("<xacro:") || text.contains("=\"${") || text.contains("=\"$(")
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

/// Joints from `base` to `tip`, found by walking up: side branches (a gripper) do not matter.
fn path_up<'a>(robot: &'a Robot, base: &str, tip: &str) -> Result<Vec<&'a Joint>, ChainError> {
    let mut path = Vec::new();
    let mut link = tip;
    while link != base {
        let mut parents = robot.joints.iter().filter(|j| j.child.link == link);
        let Some(joint) = parents.next() else {
            return Err(ChainError::Disconnected { base: base.to_owned(), tip: tip.to_owned() });
        };
        if parents.next().is_some() || path.len() >= robot.joints.len() {
            return Err(ChainError::Loop { link: link.to_owned() });
        }
        path.push(joint);
        link = &joint.parent.link;
    }
    path.reverse();
    Ok(path)
}

/// Joints from `base` to the only leaf.
fn path_down<'a>(robot: &'a Robot, base: &str) -> Result<Vec<&'a Joint>, ChainError> {
    let mut path: Vec<&Joint> = Vec::new();
    let mut link = base;
    loop {
        let children: Vec<&Joint> = robot.joints.iter().filter(|j| j.parent.link == link).collect();
        match children.as_slice() {
            [] => return Ok(path),
            [joint] if path.len() < robot.joints.len() => {
                path.push(joint);
                link = &joint.child.link;
            }
            [_] => return Err(ChainError::Loop { link: link.to_owned() }),
            _ => {
                let joints = names(children.iter().map(|j| &j.name));
                return Err(ChainError::Branch { link: link.to_owned(), joints });
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

pub(super) fn origin(joint: &Joint) -> Result<(Matrix3<f64>, Vector3<f64>), ChainError> {
    let [x, y, z] = joint.origin.xyz.0;
    let [roll, pitch, yaw] = joint.origin.rpy.0;
    if ![x, y, z, roll, pitch, yaw].iter().all(|v| v.is_finite()) {
        return Err(ChainError::Origin { joint: joint.name.clone() });
    }
    Ok((Rotation3::from_euler_angles(roll, pitch, yaw).into_inner(), Vector3::new(x, y, z)))
}

/// Position limits of a moving joint, `None` for a fixed one.
fn moving(joint: &Joint) -> Result<Option<[f64; 2]>, ChainError> {
    let kind = match joint.joint_type {
        JointType::Fixed => return Ok(None),
        JointType::Revolute => {
            let (lower, upper) = (joint.limit.lower, joint.limit.upper);
            let bad = |what, value| limit_error(joint, what, value, "rad");
            if !lower.is_finite() {
                return Err(bad("lower position limit", lower));
            }
            if !(upper.is_finite() && lower < upper) {
                return Err(bad("upper position limit", upper));
            }
            return independent(joint, [lower, upper]);
        }
        JointType::Continuous => return independent(joint, [-f64::INFINITY, f64::INFINITY]),
        JointType::Prismatic => "prismatic",
        JointType::Floating => "floating",
        JointType::Planar => "planar",
        JointType::Spherical => "spherical",
    };
    Err(ChainError::Kind { joint: joint.name.clone(), kind })
}

fn independent(joint: &Joint, position: [f64; 2]) -> Result<Option<[f64; 2]>, ChainError> {
    match &joint.mimic {
        Some(m) => Err(ChainError::Mimic { joint: joint.name.clone(), other: m.joint.clone() }),
        None => Ok(Some(position)),
    }
}

fn segment(
    joint: &Joint,
    position: [f64; 2],
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
) -> Result<UrdfJoint, ChainError> {
    let [x, y, z] = joint.axis.xyz.0;
    let length = Vector3::new(x, y, z).norm();
    if !(length.is_finite() && length > 1e-6) {
        return Err(ChainError::Axis { joint: joint.name.clone(), x, y, z });
    }
    let (velocity, effort) = (joint.limit.velocity, joint.limit.effort);
    if !(velocity.is_finite() && velocity > 0.0) {
        return Err(limit_error(joint, "velocity limit", velocity, "rad/s"));
    }
    if !(effort.is_finite() && effort >= 0.0) {
        return Err(limit_error(joint, "effort limit", effort, "Nm"));
    }
    let dynamics = joint.dynamics.as_ref();
    let friction = dynamics.map_or([0.0; 2], |dynamics| [dynamics.friction, dynamics.damping]);
    for (what, value) in ["friction", "damping"].into_iter().zip(friction) {
        if !(value.is_finite() && value >= 0.0) {
            return Err(ChainError::Friction { joint: joint.name.clone(), what, value });
        }
    }
    let axis = Vector3::new(x, y, z) / length;
    let name = joint.name.clone();
    Ok(UrdfJoint { name, rotation, translation, axis, position, velocity, effort, friction })
}

fn limit_error(joint: &Joint, what: &'static str, value: f64, unit: &'static str) -> ChainError {
    ChainError::Limit { joint: joint.name.clone(), what, value, unit }
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
