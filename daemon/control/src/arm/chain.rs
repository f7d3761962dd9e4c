//! A serial arm of J revolute joints: pose, Jacobian and its rate from joint positions.
//!
//! Contract: built once from a URDF; afterwards pure, no allocation. All vectors are in the base link's
//! frame, in metres and radians. Every joint frame is rotated at construction so that its axis is z: a joint
//! then costs one plane rotation.

#![expect(clippy::indexing_slicing, reason = "indices run over the joints, the length of every array")]

use crate::state::state;
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Unit, Vector3, Vector6};

use crate::arm::Capsule;
use crate::arm::bodies::Bodies;
use crate::arm::chain_error::ChainError;
use crate::arm::dynamics::{Dynamics, DynamicsError, Inertia, Payload};
use crate::arm::sincos::sin_cos;
use crate::arm::urdf::{self, StillLink};
use crate::geometry::Segment;

/// The fixed geometry of an arm with J revolute or continuous joints, base to tip.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain<const J: usize> {
    links: [JointFrame; J],
    tip_rotation: Matrix3<f64>,
    tip_translation: Vector3<f64>,
    /// Origin of the tip link in the last joint's frame, without a tool \[m\].
    flange: Vector3<f64>,
    limits: ChainLimits<J>,
    bodies: Bodies,
    inertias: Result<[Inertia; J], DynamicsError>,
    still: Vec<StillLink>,
    /// In the last joint's frame.
    wrist: Vec<StillLink>,
    base: String,
    tip: String,
}

/// Fixed transform from the previous joint's frame to this one's at q = 0, whose z is the joint axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct JointFrame {
    pub(super) rotation: Matrix3<f64>,
    pub(super) translation: Vector3<f64>,
}

/// What the URDF says about the joints. Acceleration limits are not part of it.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainLimits<const J: usize> {
    /// Joint names, base to tip.
    pub names: [String; J],
    /// \[lower, upper\] \[rad\], infinite for a continuous joint.
    pub position: [[f64; 2]; J],
    /// \[rad/s\]
    pub velocity: [f64; J],
    /// \[Nm\]
    pub effort: [f64; J],
    /// Coulomb friction \[Nm\] and viscous friction \[Nm s/rad\]; 0 where the URDF states none.
    pub friction: [[f64; 2]; J],
}

/// The pose of the arm at given joint positions, and the tool's response to joint velocities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kinematics<const J: usize> {
    /// Tool frame → base frame (3 x 3, orthonormal).
    pub rotation: Matrix3<f64>,
    /// Tool origin in the base frame \[m\].
    pub position: Vector3<f64>,
    /// Geometric Jacobian in the base frame, 6 x J: rows 0-2 tool origin \[m/rad\], rows 3-5 rotation
    /// \[rad/rad\].
    pub jacobian: SMatrix<f64, 6, J>,
    /// Each joint's frame → base frame, its z the joint's axis.
    pub frames: [Matrix3<f64>; J],
    /// The frames' origins in the base frame \[m\], 3 x J: a point on each joint's axis.
    pub origins: SMatrix<f64, 3, J>,
}

state! { whole [const J: usize] Kinematics<J> { rotation, position, jacobian, frames, origins } }

/// Motion of the tool's origin in the base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToolMotion {
    /// \[m\]
    pub position: Vector3<f64>,
    /// \[m/s\]
    pub velocity: Vector3<f64>,
    /// \[m/s²\]
    pub acceleration: Vector3<f64>,
}

impl<const J: usize> Chain<J> {
    /// Reads the chain from link `base` (default: the only root) to link `tip` (default: the only leaf) of a
    /// URDF text.
    ///
    /// # Errors
    ///
    /// See [`ChainError`]; each names the joint or link at fault.
    pub fn from_urdf(text: &str, base: Option<&str>, tip: Option<&str>) -> Result<Self, ChainError> {
        let found = urdf::segments(text, base, tip)?;
        let count = found.segments.len();
        let mut links = [JointFrame { rotation: Matrix3::identity(), translation: Vector3::zeros() }; J];
        let mut limits = ChainLimits {
            names: std::array::from_fn(|_| String::new()),
            position: [[0.0; 2]; J],
            velocity: [0.0; J],
            effort: [0.0; J],
            friction: [[0.0; 2]; J],
        };
        let mut bodies = found.bodies;
        let mut masses = [Inertia::none(); J];
        let unweighed = found.inertias.as_ref().err().cloned();
        let weighed = found.inertias.unwrap_or_default();
        for (mass, found) in masses.iter_mut().zip(weighed) {
            *mass = found;
        }
        // Carries the rotation that made the previous joint's axis z, undone before the next link.
        let mut turned = Matrix3::identity();
        for (j, s) in found.segments.into_iter().enumerate().take(J) {
            let turn = rotation_from_z_to(&s.axis);
            links[j] = JointFrame {
                rotation: turned.transpose() * s.rotation * turn,
                translation: turned.transpose() * s.translation,
            };
            turned = turn;
            for body in bodies.capsules.iter_mut().filter(|body| body.link == j + 1) {
                let Segment { from, to } = body.segment;
                body.segment = Segment { from: turn.tr_mul(&from), to: turn.tr_mul(&to) };
            }
            masses[j] = masses[j].turned(&turn.transpose());
            (limits.names[j], limits.position[j], limits.velocity[j]) = (s.name, s.position, s.velocity);
            (limits.effort[j], limits.friction[j]) = (s.effort, s.friction);
        }
        if count != J {
            let (base, tip) = (found.base, found.tip);
            return Err(ChainError::Count { found: count, expected: J, base, tip });
        }
        let flange = turned.transpose() * found.tip_translation;
        let mut wrist = found.wrist;
        for link in &mut wrist {
            link.rotation = turned.transpose() * link.rotation;
            link.translation = turned.transpose() * link.translation;
        }
        Ok(Self {
            links,
            tip_rotation: turned.transpose() * found.tip_rotation,
            tip_translation: flange,
            flange,
            limits,
            bodies,
            inertias: unweighed.map_or(Ok(masses), Err),
            still: found.still,
            wrist,
            base: found.base,
            tip: found.tip,
        })
    }

    /// The same arm with its tip moved by `offset` \[m\], in the tip link's frame: a pen below the flange.
    /// The tip's axes stay.
    #[must_use]
    pub fn with_tool(mut self, offset: Vector3<f64>) -> Self {
        self.tip_translation += self.tip_rotation * offset;
        self
    }

    /// Names and limits of the joints as the URDF states them.
    #[must_use]
    pub const fn limits(&self) -> &ChainLimits<J> {
        &self.limits
    }

    /// Names of the base and the tip link.
    #[must_use]
    pub fn ends(&self) -> (&str, &str) {
        (&self.base, &self.tip)
    }

    /// The base link, and all links that do not move against it: any of them can be the base.
    #[must_use]
    pub fn still_links(&self) -> &[StillLink] {
        &self.still
    }

    /// Where the tip of the tool is, seen from each link that does not move against it \[m\]: any of them can
    /// be the tip link.
    pub fn tool_from_links(&self) -> impl Iterator<Item = (&str, Vector3<f64>)> {
        let tip = self.tip_translation;
        let seen = move |link: &StillLink| link.rotation.tr_mul(&(tip - link.translation));
        self.wrist.iter().map(move |link| (link.name.as_str(), seen(link)))
    }

    /// Shapes of the links, base first, each in the frame of its joint, whose z is the joint's axis (see
    /// [`Kinematics::frames`]).
    #[must_use]
    pub fn capsules(&self) -> &[Capsule] {
        &self.bodies.capsules
    }

    /// Links whose collision geometry consists of meshes only, which have no capsules.
    #[must_use]
    pub fn mesh_links(&self) -> &[String] {
        &self.bodies.meshes
    }

    /// The torques of this arm with `payload`; the tool's offset does not count.
    ///
    /// # Errors
    ///
    /// A moving link without mass, inertials that no body has, or such a payload; a joint whose effort limit
    /// is 0, which descriptions write where it is not known.
    pub fn dynamics(&self, payload: &Payload) -> Result<Dynamics<J>, DynamicsError> {
        let mut efforts = self.limits.names.iter().zip(&self.limits.effort);
        if let Some((joint, _)) = efforts.find(|(_, effort)| !(**effort > 0.0)) {
            return Err(DynamicsError::Effort { joint: joint.clone() });
        }
        let bodies = self.inertias.clone()?;
        let tip = (&self.tip_rotation, &self.flange);
        Dynamics::new(self.links, bodies, &self.limits.names, tip, payload)
    }

    /// What a payload alone asks of the joints, as if the links weighed nothing.
    #[must_use]
    pub fn payload_dynamics(&self, payload: &Payload) -> Dynamics<J> {
        Dynamics::alone(self.links, (&self.tip_rotation, &self.flange), payload)
    }

    /// Largest distance of a point of the capsule's axis from the axis of each joint that moves it \[m\]; 0
    /// for the other joints.
    pub(crate) fn levers(&self, capsule: &Capsule) -> [f64; J] {
        let mut levers = [0.0; J];
        let Segment { from, to } = capsule.segment;
        // Measured from the origin of the current joint; perpendicular to its axis only for the capsule's own
        // joint.
        let mut beyond = from.norm().max(to.norm());
        let own = from.xy().norm().max(to.xy().norm());
        let inner = levers.iter_mut().zip(&self.links).enumerate().take(capsule.link).rev();
        for (index, (lever, link)) in inner {
            *lever = if index + 1 == capsule.link { own } else { beyond };
            beyond += link.translation.norm();
        }
        levers
    }

    /// Origin of the joint after `link`, in the frame of `link` \[m\].
    pub(crate) fn next_origin(&self, link: usize) -> Vector3<f64> {
        self.links.get(link).map_or_else(Vector3::zeros, |next| next.translation)
    }

    /// Pose and Jacobian at joint positions `q` \[rad\] in one pass.
    #[must_use]
    pub fn forward(&self, q: &[f64; J]) -> Kinematics<J> {
        let (sines, cosines) = sin_cos(q);
        let mut rotation = Matrix3::identity();
        let mut position = Vector3::zeros();
        let mut origins = SMatrix::<f64, 3, J>::zeros();
        let mut jacobian = SMatrix::<f64, 6, J>::zeros();
        let mut frames = [Matrix3::identity(); J];
        for j in 0..J {
            let (link, s, c) = (&self.links[j], sines[j], cosines[j]);
            position += rotation * link.translation;
            let fixed = rotation * link.rotation;
            let (x, y) = (fixed.column(0), fixed.column(1));
            let (turned_x, turned_y) = (x * c + y * s, y * c - x * s);
            rotation = Matrix3::from_columns(&[turned_x, turned_y, fixed.column(2).into_owned()]);
            frames[j] = rotation;
            origins.set_column(j, &position);
            jacobian.fixed_view_mut::<3, 1>(3, j).copy_from(&fixed.column(2));
        }
        position += rotation * self.tip_translation;
        rotation *= self.tip_rotation;
        for i in 0..J {
            let axis = jacobian.fixed_view::<3, 1>(3, i).into_owned();
            let lever = position - origins.column(i);
            jacobian.fixed_view_mut::<3, 1>(0, i).copy_from(&axis.cross(&lever));
        }
        Kinematics { rotation, position, jacobian, frames, origins }
    }
}

impl<const J: usize> Kinematics<J> {
    /// A capsule's axis in the base frame.
    pub(crate) fn axis(&self, capsule: &Capsule) -> Segment {
        let Segment { from, to } = capsule.segment;
        let last = capsule.link.checked_sub(1);
        last.and_then(|last| Some((last, self.frames.get(last)?))).map_or(capsule.segment, |(last, frame)| {
            let origin = self.origins.column(last);
            Segment { from: frame * from + origin, to: frame * to + origin }
        })
    }

    /// The tool's position \[m\], then its rotation vector \[rad\], in the base frame: what a pendant shows.
    #[must_use]
    pub fn pose(&self) -> [f64; 6] {
        let turn = Rotation3::from_matrix_unchecked(self.rotation).scaled_axis();
        let (position, turn): ([f64; 3], [f64; 3]) = (self.position.into(), turn.into());
        let mut numbers = position.into_iter().chain(turn);
        std::array::from_fn(|_| numbers.next().unwrap_or(0.0))
    }

    /// J(q)·q̇: linear \[m/s\] (0-2) and angular \[rad/s\] (3-5) velocity of the tool.
    #[must_use]
    pub fn twist(&self, qd: &[f64; J]) -> Vector6<f64> {
        self.jacobian * SVector::<f64, J>::from_column_slice(qd)
    }

    /// J̇(q, q̇)·q̇: the tool's linear \[m/s²\] and angular \[rad/s²\] acceleration while q̈ = 0. Exact.
    ///
    /// With z_i the axes, r_i = p − p_i, ω_i the angular velocity of link i and v_i the velocity of p_i, the
    /// columns z_i × r_i and z_i have the rates (ω_i × z_i) × r_i + z_i × (v − v_i) and ω_i × z_i.
    #[must_use]
    pub fn jacobian_dot_qd(&self, qd: &[f64; J]) -> Vector6<f64> {
        let twist = self.twist(qd);
        let tip_velocity: Vector3<f64> = twist.fixed_rows::<3>(0).into_owned();
        let mut omega = Vector3::zeros();
        let mut velocity = Vector3::zeros();
        let mut previous = Vector3::zeros();
        let (mut linear, mut angular) = (Vector3::zeros(), Vector3::zeros());
        for (i, rate) in qd.iter().enumerate() {
            let axis: Vector3<f64> = self.jacobian.fixed_view::<3, 1>(3, i).into_owned();
            let origin: Vector3<f64> = self.origins.column(i).into_owned();
            velocity += Vector3::cross(&omega, &(origin - previous));
            previous = origin;
            let axis_rate = omega.cross(&axis);
            omega += axis * *rate;
            let column_rate =
                axis_rate.cross(&(self.position - origin)) + axis.cross(&(tip_velocity - velocity));
            linear += column_rate * *rate;
            angular += axis_rate * *rate;
        }
        Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
    }

    /// The tool's motion for joint velocities `qd` \[rad/s\] and accelerations `qdd` [rad/s²]: (FK, Jq̇, Jq̈
    /// + J̇q̇).
    #[must_use]
    pub fn tool_motion(&self, qd: &[f64; J], qdd: &[f64; J]) -> ToolMotion {
        let acceleration = self.twist(qdd) + self.jacobian_dot_qd(qd);
        ToolMotion {
            position: self.position,
            velocity: self.twist(qd).fixed_rows::<3>(0).into_owned(),
            acceleration: acceleration.fixed_rows::<3>(0).into_owned(),
        }
    }
}

/// A rotation that takes z to `axis` (unit); any such rotation serves the chain.
fn rotation_from_z_to(axis: &Vector3<f64>) -> Matrix3<f64> {
    let z = Vector3::z();
    if axis.z >= 1.0 - 1e-15 {
        return Matrix3::identity();
    }
    Rotation3::rotation_between(&z, axis)
        .unwrap_or_else(|| {
            Rotation3::from_axis_angle(&Unit::new_unchecked(Vector3::x()), std::f64::consts::PI)
        })
        .into_inner()
}
