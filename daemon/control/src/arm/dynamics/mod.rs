//! Torques of the arm: recursive Newton-Euler, gravity and the mass matrix, from the URDF's inertials.
//!
//! Contract: built once from a [`Chain`](crate::arm::Chain); afterwards pure, no allocation. Rigid links,
//! joints without friction and without rotors. The base stands upright: gravity is −z of the base frame.
//!
//! *Source*: Featherstone 2008, *Rigid Body Dynamics Algorithms*: recursive Newton-Euler in link coordinates
//! (table 5.1, here in 3-vectors), composite rigid bodies (table 6.2).

mod inertia;

use nalgebra::{Matrix3, SMatrix, Vector3};

pub use inertia::{DynamicsError, Payload};
pub(in crate::arm) use inertia::{Inertia, inertias};

use crate::arm::chain::JointFrame;
use crate::arm::sincos::sin_cos;

/// Standard gravity \[m/s²\] (CGPM 1901).
pub const GRAVITY_MPS2: f64 = 9.806_65;

/// The masses of an arm with J joints, and where they are.
#[derive(Debug, Clone, PartialEq)]
pub struct Dynamics<const J: usize> {
    links: [JointFrame; J],
    /// What moves with each joint, in the joint's frame, whose z is its axis.
    bodies: [Inertia; J],
}

/// Previous joint's frame ← a joint's frame at given positions.
#[derive(Debug, Clone, Copy)]
struct Step {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

/// A force \[N\] and its moment about the frame's origin \[Nm\].
#[derive(Debug, Clone, Copy)]
struct Wrench {
    force: Vector3<f64>,
    moment: Vector3<f64>,
}

impl Wrench {
    /// The same wrench in the previous joint's frame.
    fn before(&self, step: &Step) -> Self {
        let force = step.rotation * self.force;
        Self { force, moment: step.rotation * self.moment + step.translation.cross(&force) }
    }
}

impl<const J: usize> Dynamics<J> {
    /// `links` and `bodies` base to tip, in frames whose z is the joint's axis; what is carried in `tip`
    /// (tip link → last joint's frame).
    ///
    /// # Errors
    ///
    /// A payload that no body has, or a joint (by `names`) that moves no mass.
    pub(in crate::arm) fn new(
        links: [JointFrame; J],
        bodies: [Inertia; J],
        names: &[String; J],
        tip: (&Matrix3<f64>, &Vector3<f64>),
        payload: &Payload,
    ) -> Result<Self, DynamicsError> {
        let Payload { mass, centre } = *payload;
        if !(mass.is_finite() && mass >= 0.0 && centre.iter().all(|x| x.is_finite())) {
            return Err(DynamicsError::Payload { mass, centre });
        }
        if let Some((joint, _)) = names.iter().zip(&bodies).find(|(_, body)| !(body.mass > 0.0)) {
            return Err(DynamicsError::Weightless { joint: joint.clone() });
        }
        let mut own = Self { links, bodies };
        if let Some(last) = own.bodies.last_mut() {
            *last = last.plus(&Inertia::point(mass, tip.0 * Vector3::from(centre) + tip.1));
        }
        Ok(own)
    }

    /// An arm whose links weigh nothing: what `payload` alone asks.
    pub(in crate::arm) fn alone(
        links: [JointFrame; J],
        tip: (&Matrix3<f64>, &Vector3<f64>),
        payload: &Payload,
    ) -> Self {
        let mut bodies = [Inertia::none(); J];
        if let Some(last) = bodies.last_mut() {
            *last = Inertia::point(payload.mass, tip.0 * Vector3::from(payload.centre) + tip.1);
        }
        Self { links, bodies }
    }

    /// Torques \[Nm\], positive along each joint's axis, that move the arm at positions `q` \[rad\] and
    /// velocities `qd` \[rad/s\] with accelerations `qdd` [rad/s²], against gravity.
    #[must_use]
    pub fn torque(&self, q: &[f64; J], qd: &[f64; J], qdd: &[f64; J]) -> [f64; J] {
        let steps = self.steps(q);
        let z = Vector3::z();
        let mut wrenches = [Wrench { force: Vector3::zeros(), moment: Vector3::zeros() }; J];
        let (mut omega, mut alpha) = (Vector3::zeros(), Vector3::zeros());
        // An upward acceleration of the base stands for gravity.
        let mut linear = Vector3::new(0.0, 0.0, GRAVITY_MPS2);
        let joints = steps.iter().zip(&self.bodies).zip(&mut wrenches).zip(qd.iter().zip(qdd));
        for (((step, body), wrench), (qd, qdd)) in joints {
            let p = &step.translation;
            linear = step.rotation.tr_mul(&(linear + alpha.cross(p) + omega.cross(&omega.cross(p))));
            let carried = step.rotation.tr_mul(&omega);
            alpha = step.rotation.tr_mul(&alpha) + carried.cross(&z) * *qd + z * *qdd;
            omega = carried + z * *qd;
            wrench.force =
                linear * body.mass + alpha.cross(&body.moment) + omega.cross(&omega.cross(&body.moment));
            wrench.moment =
                body.tensor * alpha + omega.cross(&(body.tensor * omega)) + body.moment.cross(&linear);
        }
        let mut torque = [0.0; J];
        let mut outer = Wrench { force: Vector3::zeros(), moment: Vector3::zeros() };
        for ((torque, own), step) in torque.iter_mut().zip(&wrenches).zip(&steps).rev() {
            let all = Wrench { force: own.force + outer.force, moment: own.moment + outer.moment };
            *torque = all.moment.z;
            outer = all.before(step);
        }
        torque
    }

    /// Torques \[Nm\] that hold the arm at rest at `q` \[rad\].
    #[must_use]
    pub fn gravity(&self, q: &[f64; J]) -> [f64; J] {
        self.torque(q, &[0.0; J], &[0.0; J])
    }

    /// The joint-space inertia at `q` \[rad\], J x J, symmetric \[kg m²\]: torque = M q̈ + what velocities
    /// and gravity ask.
    #[must_use]
    pub fn mass_matrix(&self, q: &[f64; J]) -> SMatrix<f64, J, J> {
        let steps = self.steps(q);
        let mut matrix = SMatrix::<f64, J, J>::zeros();
        let mut composite = Inertia::none();
        for (i, (body, step)) in self.bodies.iter().zip(&steps).enumerate().rev() {
            composite = composite.plus(body);
            // The wrench that a unit acceleration of joint i alone asks of what it moves.
            let z = Vector3::z();
            let mut wrench = Wrench { force: z.cross(&composite.moment), moment: composite.tensor * z };
            for (j, step) in steps.iter().enumerate().take(i + 1).rev() {
                for index in [(i, j), (j, i)] {
                    if let Some(entry) = matrix.get_mut(index) {
                        *entry = wrench.moment.z;
                    }
                }
                wrench = wrench.before(step);
            }
            composite = composite.seen_from(&step.rotation, &step.translation);
        }
        matrix
    }

    /// Each joint's frame → the previous one's at `q` \[rad\].
    fn steps(&self, q: &[f64; J]) -> [Step; J] {
        let (sines, cosines) = sin_cos(q);
        let mut steps = [Step { rotation: Matrix3::identity(), translation: Vector3::zeros() }; J];
        for ((step, link), (s, c)) in steps.iter_mut().zip(&self.links).zip(sines.iter().zip(&cosines)) {
            let (x, y) = (link.rotation.column(0), link.rotation.column(1));
            let (turned_x, turned_y) = (x * *c + y * *s, y * *c - x * *s);
            let columns = [turned_x, turned_y, link.rotation.column(2).into_owned()];
            *step = Step { rotation: Matrix3::from_columns(&columns), translation: link.translation };
        }
        steps
    }
}
