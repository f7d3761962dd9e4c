//! Mass, centre and inertia tensor of the bodies of a chain, merged from the URDF's links. Start-up only.
//!
//! Contract: a link that is attached by fixed joints (a flange, a pen holder) belongs to the moving joint
//! before it. Branches with moving joints (fingers) are not part of the chain and weigh nothing: declare them
//! as payload. Rotors are not described by URDF and not contained.

use nalgebra::{Matrix3, Rotation3, Vector3};
use thiserror::Error;
use urdf_rs::Inertial;

use crate::arm::bodies::LinkPose;
use crate::arm::chain_error::Part;
use crate::arm::description::Description;

/// Why the torques of an arm cannot be computed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DynamicsError {
    /// A moving link, with all that is fixed to it, has no mass.
    #[error("no link that joint `{joint}` moves before the next joint has an <inertial> with a mass")]
    Weightless {
        /// Name of the joint in the description.
        joint: String,
    },
    /// A joint has no torque, or the description does not say how much.
    #[error(
        "the effort limit of joint `{joint}` is 0 or missing, so nobody knows what it can hold; write <limit \
         effort> in Nm, from its data sheet"
    )]
    Effort {
        /// Name of the joint in the description.
        joint: String,
    },
    /// A mass below 0, a tensor that no body has, or a number that is not finite.
    #[error(
        "link {link}: its <inertial> is not that of a body: {what}; correct the description, or remove it"
    )]
    Inertial {
        /// Link at fault, with its line.
        link: Part,
        /// What is wrong with it, as in the message.
        what: String,
    },
    /// The payload is not that of a body.
    #[error("payload of {mass} kg at {centre:?} m: give a mass of 0 or more and a finite centre")]
    Payload {
        /// \[kg\]
        mass: f64,
        /// \[m\]
        centre: [f64; 3],
    },
}

/// What is carried beyond the links of the URDF, as a point mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Payload {
    /// \[kg\]
    pub mass: f64,
    /// Centre of mass in the frame of the tip link, as the URDF has it, without the tool's offset \[m\].
    pub centre: [f64; 3],
}

impl Payload {
    /// Nothing is carried: no mass.
    pub const NONE: Self = Self { mass: 0.0, centre: [0.0; 3] };
}

/// A rigid body's inertia about the origin of its frame: the ten numbers of the spatial inertia.
///
/// *Source*: Featherstone 2008, *Rigid Body Dynamics Algorithms*, equation 2.63.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::arm) struct Inertia {
    /// \[kg\]
    pub(super) mass: f64,
    /// Mass times centre of mass, 3 \[kg m\].
    pub(super) moment: Vector3<f64>,
    /// About the frame's origin, 3 x 3 \[kg m²\].
    pub(super) tensor: Matrix3<f64>,
}

impl Inertia {
    pub(in crate::arm) fn none() -> Self {
        Self { mass: 0.0, moment: Vector3::zeros(), tensor: Matrix3::zeros() }
    }

    pub(super) fn point(mass: f64, centre: Vector3<f64>) -> Self {
        Self { mass, moment: centre * mass, tensor: steiner(mass, &centre) }
    }

    pub(super) fn plus(&self, other: &Self) -> Self {
        Self {
            mass: self.mass + other.mass,
            moment: self.moment + other.moment,
            tensor: self.tensor + other.tensor,
        }
    }

    /// The same body seen from a frame in which its own stands at `translation` \[m\], turned by `rotation`
    /// (own frame → that frame).
    pub(super) fn seen_from(&self, rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Self {
        let turned = rotation * self.moment;
        let crossed = translation * turned.transpose();
        let tensor = rotation * self.tensor * rotation.transpose()
            + Matrix3::identity() * (2.0 * translation.dot(&turned))
            - crossed
            - crossed.transpose()
            + steiner(self.mass, translation);
        Self { mass: self.mass, moment: turned + translation * self.mass, tensor }
    }

    /// The same body in a frame turned about the origin.
    pub(in crate::arm) fn turned(&self, rotation: &Matrix3<f64>) -> Self {
        self.seen_from(rotation, &Vector3::zeros())
    }
}

/// m(|c|² 1 − c cᵀ): a point mass about the origin \[kg m²\].
fn steiner(mass: f64, centre: &Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * centre.norm_squared() - centre * centre.transpose()) * mass
}

/// The bodies of a chain with `joints` moving joints: entry i is what moves with joint i, in that joint's
/// frame as the URDF has it.
pub(in crate::arm) fn inertias(
    description: &Description,
    poses: &[LinkPose<'_>],
    joints: usize,
) -> Result<Vec<Inertia>, DynamicsError> {
    let mut bodies = vec![Inertia::none(); joints];
    for pose in poses {
        // The base does not move.
        let Some(body) = pose.link.checked_sub(1).and_then(|joint| bodies.get_mut(joint)) else { continue };
        let links = &description.robot.links;
        let Some(link) = links.iter().find(|link| link.name == pose.name) else { continue };
        let own = description
            .inertial(link)
            .and_then(|read| inertial(&read).map_err(str::to_owned))
            .map_err(|what| DynamicsError::Inertial { link: description.link_part(pose.name), what })?;
        if own == Inertia::none() {
            continue;
        }
        let (rotation, translation) = pose.place.clone().map_err(|error| DynamicsError::Inertial {
            link: description.link_part(pose.name),
            what: format!("where it stands is not known ({error})"),
        })?;
        *body = body.plus(&own.seen_from(&rotation, &translation));
    }
    Ok(bodies)
}

/// One link's inertia about its frame, or what is wrong with it.
fn inertial(inertial: &Inertial) -> Result<Inertia, &'static str> {
    let [roll, pitch, yaw] = inertial.origin.rpy.0;
    let (mass, centre) = (inertial.mass.value, Vector3::from(inertial.origin.xyz.0));
    let i = &inertial.inertia;
    #[rustfmt::skip]
    let tensor = Matrix3::new(
        i.ixx, i.ixy, i.ixz,
        i.ixy, i.iyy, i.iyz,
        i.ixz, i.iyz, i.izz,
    );
    let mut numbers = tensor.iter().chain(&centre).chain([&mass, &roll, &pitch, &yaw]);
    if !numbers.all(|number| number.is_finite()) {
        return Err("a number is not finite");
    }
    if mass < 0.0 {
        return Err("its mass is below 0");
    }
    // Tensors of published descriptions are rounded: a principal moment may miss 0 by that.
    let size = tensor.norm();
    if size > 0.0 && tensor.symmetric_eigenvalues().iter().any(|moment| *moment < -1e-6 * size) {
        return Err("its tensor has a principal moment below 0");
    }
    let turn: Matrix3<f64> = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner();
    let about_centre = Inertia { mass, moment: Vector3::zeros(), tensor };
    Ok(about_centre.seen_from(&turn, &centre))
}
