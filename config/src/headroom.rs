//! What the joints' effort leaves for acceleration over the writing plane, against the settings' limits.
//!
//! Contract: computed once, at start or on request; some 400 poses, well below a second. Of each pose
//!
//!   a_j = min_k (effort_k − |gravity_k| − friction_k) / |M_kj|      one joint alone, the others hold still,
//!   a   = min_k (effort_k − |gravity_k| − friction_k) / Σ_j |M_kj|  all joints at once, any signs,
//!
//! with the rotors' inertia on the diagonal of M. k = j is the joint's own effort, which decides but where a
//! joint nearer to the base cannot hold against it (an elbow's motion, at the shoulder). At rest: what
//! velocities add (Coriolis) is left out. Friction is that of the URDF's `<dynamics>`, its
//! viscous part at half of the velocity limit; where a joint states none, [`FRICTION_SHARE`] of its effort is
//! assumed. URDF knows no rotors: [`ROTOR_KGM2`] is assumed for every joint. The base stands upright.

use foretrace_control::arm::{DynamicsError, Payload};
use foretrace_control::ik::{ToolTarget, solve_pose};
use nalgebra::{SMatrix, Vector3};

use crate::robot::{JOINTS, Robot};
use crate::settings::{PayloadSection, PlaneSection, Settings};

/// Assumed friction of a joint whose description states none, as a share of its effort limit.
pub const FRICTION_SHARE: f64 = 0.06;
/// Assumed inertia of every joint's rotor behind its gear \[kg m²\], as MuJoCo Menagerie's UR5e has it.
pub const ROTOR_KGM2: f64 = 0.1;
/// Points along the plane's x and y; at two heights.
const ALONG: usize = 14;

/// What the effort of each joint leaves over the poses of the writing plane; lists base to tip.
#[derive(Debug, Clone, PartialEq)]
pub struct Headroom {
    /// What was assumed to be carried.
    pub payload: Payload,
    /// Poses that were reached and judged.
    pub poses: usize,
    pub joints: [JointHeadroom; JOINTS],
    /// All joints at once: least and median over the poses [rad/s²].
    pub together: [f64; 2],
}

/// One joint's part of it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointHeadroom {
    /// The URDF's name of the joint.
    pub name: String,
    /// Its limit \[Nm\].
    pub effort: f64,
    /// Largest over the poses \[Nm\].
    pub gravity: f64,
    /// \[Nm\]
    pub friction: f64,
    /// No `<dynamics>` stated it.
    pub friction_assumed: bool,
    /// Largest inertia about the joint, rotor included \[kg m²\].
    pub inertia: f64,
    /// Least and median acceleration of this joint alone [rad/s²]; 0 where the arm cannot hold itself.
    pub alone: [f64; 2],
    /// Where the least is, in the plane's frame \[m\].
    pub worst: [f64; 3],
    /// `robot.acceleration_radps2`, and the share of poses that leave it.
    pub acceleration: [f64; 2],
    /// `robot.stale_deceleration_radps2`, and the share of poses that leave it.
    pub deceleration: [f64; 2],
}

/// The settings' payload, where the tool is `tool_m`.
pub(crate) fn payload(section: &PayloadSection, ur_kg: Option<f64>, tool_m: &[f64; 3]) -> Payload {
    Payload {
        mass: section.mass_kg.or(ur_kg).unwrap_or(0.0),
        centre: section.centre_m.unwrap_or(tool_m.map(|along| 0.5 * along)),
    }
}

/// Judges the arm of these settings.
///
/// # Errors
///
/// The URDF has no usable masses.
pub(crate) fn headroom(settings: &Settings, robot: &Robot) -> Result<Headroom, DynamicsError> {
    let section = &settings.robot;
    let payload = payload(&section.payload, section.ur.payload_kg, &section.tool_m);
    let dynamics = robot.chain.dynamics(&payload)?;
    let limits = robot.chain.limits();
    let mut joints: [JointHeadroom; JOINTS] = Default::default();
    let own = limits.names.iter().zip(&limits.effort).zip(limits.friction.iter().zip(&limits.velocity));
    for (joint, ((name, effort), ([coulomb, viscous], velocity))) in joints.iter_mut().zip(own) {
        joint.name.clone_from(name);
        joint.effort = *effort;
        joint.friction_assumed = *coulomb == 0.0 && *viscous == 0.0;
        joint.friction =
            if joint.friction_assumed { FRICTION_SHARE * effort } else { coulomb + 0.5 * viscous * velocity };
        joint.alone = [f64::INFINITY; 2];
    }
    let asked = robot.limits.acceleration().iter().zip(robot.limits.deceleration());
    for (joint, (acceleration, deceleration)) in joints.iter_mut().zip(asked) {
        (joint.acceleration, joint.deceleration) = ([*acceleration, 0.0], [*deceleration, 0.0]);
    }
    let mut alone: [Vec<f64>; JOINTS] = Default::default();
    let mut together = Vec::new();
    for (point, q) in poses(&settings.plane, robot) {
        let mass = dynamics.mass_matrix(&q) + SMatrix::from_diagonal_element(ROTOR_KGM2);
        let mut room = [0.0; JOINTS];
        for ((room, joint), gravity) in room.iter_mut().zip(&mut joints).zip(dynamics.gravity(&q)) {
            joint.gravity = joint.gravity.max(gravity.abs());
            *room = (joint.effort - gravity.abs() - joint.friction).max(0.0);
        }
        let least = |inertias: Vec<f64>| {
            room.iter().zip(inertias).map(|(room, inertia)| room / inertia).fold(f64::INFINITY, f64::min)
        };
        let all = least(mass.row_iter().map(|row| row.abs().sum()).collect());
        for (index, joint) in joints.iter_mut().enumerate() {
            let left = least(mass.column(index).iter().map(|inertia| inertia.abs()).collect());
            joint.inertia = joint.inertia.max(mass[(index, index)]);
            if left < joint.alone[0] {
                (joint.alone[0], joint.worst) = (left, point);
            }
            joint.acceleration[1] += f64::from(u8::from(left >= joint.acceleration[0]));
            joint.deceleration[1] += f64::from(u8::from(left >= joint.deceleration[0]));
            alone[index].push(left);
        }
        together.push(all);
    }
    let poses = together.len();
    for (joint, alone) in joints.iter_mut().zip(alone) {
        joint.alone[1] = median(alone);
        joint.acceleration[1] /= poses.max(1) as f64;
        joint.deceleration[1] /= poses.max(1) as f64;
    }
    let least = together.iter().copied().fold(f64::INFINITY, f64::min);
    Ok(Headroom { payload, poses, joints, together: [least, median(together)] })
}

/// The upper one of two in the middle: what some pose leaves. Infinite where there is no pose; no value is
/// NaN. The simulator's median of any numbers stands in a layer above this one.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// Poses of the pen, upright, over the plane's workspace at contact and lifted, each solved from the one
/// beside it: its point in the plane's frame \[m\] and its joints \[rad\]. Points out of reach are left out.
fn poses(plane: &PlaneSection, robot: &Robot) -> Vec<([f64; 3], [f64; JOINTS])> {
    let rotation = plane.rotation();
    let origin = Vector3::from(plane.origin_m);
    let axis = -(rotation * Vector3::z());
    let solve = |seed: &[f64; JOINTS], point: [f64; 3]| {
        let target = ToolTarget::at_rest(origin + rotation * Vector3::from(point), axis, None);
        solve_pose(&robot.chain, seed, &target)
    };
    let [x_range, y_range, _] = plane.workspace_m;
    let at = |[low, high]: [f64; 2], index: usize| low + (high - low) * index as f64 / (ALONG - 1) as f64;
    let middle = [at(x_range, ALONG / 2), at(y_range, ALONG / 2), plane.lift_height_m];
    let mut row = solve(&robot.home, middle).unwrap_or(robot.home);
    let mut found = Vec::with_capacity(2 * ALONG * ALONG);
    for height in [plane.lift_height_m, 0.0] {
        for i in 0..ALONG {
            let mut seed = row;
            for j in 0..ALONG {
                let point = [at(x_range, i), at(y_range, j), height];
                let Some(q) = solve(&seed, point) else { continue };
                seed = q;
                if j == 0 {
                    row = q;
                }
                found.push((point, q));
            }
        }
    }
    found
}

impl Headroom {
    /// The largest vectors that every pose leaves, none above what the settings say: of
    /// `robot.acceleration_radps2` and `robot.stale_deceleration_radps2`.
    #[must_use]
    pub fn proposed(&self) -> [[f64; JOINTS]; 2] {
        let capped = |asked: fn(&JointHeadroom) -> f64| {
            let mut list = [0.0; JOINTS];
            for (value, joint) in list.iter_mut().zip(&self.joints) {
                *value = asked(joint).min(rounded_down(joint.alone[0]));
            }
            list
        };
        [capped(|joint| joint.acceleration[0]), capped(|joint| joint.deceleration[0])]
    }

    /// What a torque cannot give everywhere, one line each; none where the limits are possible at every pose.
    #[must_use]
    pub fn exceeded(&self) -> Vec<Exceeded> {
        let [acceleration, deceleration] = self.proposed();
        let of = |key, asked: fn(&JointHeadroom) -> [f64; 2], vector: [f64; JOINTS]| {
            let worst = self
                .joints
                .iter()
                .filter(|joint| asked(joint)[1] < 1.0)
                .max_by(|a, b| (asked(a)[0] / a.alone[0]).total_cmp(&(asked(b)[0] / b.alone[0])))?;
            let braking = key == DECELERATION;
            let mostly = self.joints.iter().any(|joint| asked(joint)[1] < MOSTLY);
            let text = self.remark(key, worst, asked(worst), &vector);
            Some(Exceeded { serious: braking || mostly, text })
        };
        let brake = of(DECELERATION, |joint| joint.deceleration, deceleration);
        of(ACCELERATION, |joint| joint.acceleration, acceleration).into_iter().chain(brake).collect()
    }

    fn remark(
        &self,
        key: &str,
        worst: &JointHeadroom,
        [asked, share]: [f64; 2],
        vector: &[f64; JOINTS],
    ) -> String {
        let [x, y, z] = worst.worst;
        let JointHeadroom { name, effort, friction, .. } = worst;
        let (kg, percent) = (self.payload.mass, 100.0 * share);
        let least = worst.alone[0];
        let what = if key == DECELERATION {
            "an arm that brakes by itself takes longer than is promised"
        } else {
            "a command that asks for all of it leaves the arm behind"
        };
        let friction = if worst.friction_assumed {
            format!("{friction:.1} Nm of assumed friction")
        } else {
            format!("{friction:.1} Nm of friction")
        };
        let remedy = if vector.iter().all(|value| *value >= 0.1) {
            format!("to stay below: {key} = {vector:?}")
        } else {
            format!("joint `{name}` can hardly hold itself: carry less, or move plane.origin_m nearer")
        };
        format!(
            "{key} = {asked} of joint `{name}` ({effort} Nm): with {kg} kg carried, gravity and {friction} \
             leave {least:.1} rad/s² where the pen is at [{x:.3}, {y:.3}, {z:.3}] m of the plane, the \
             least of {} poses; {percent:.0} % of them leave {asked}. Where they do not, {what} \
             (`foretrace config torque`); {remedy}",
            self.poses,
        )
    }
}

/// A limit of the settings that the effort does not leave at some poses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exceeded {
    /// A promise of braking, or an acceleration that most of the plane does not leave; otherwise a note.
    pub serious: bool,
    /// What, where, and the line to write; one readable line.
    pub text: String,
}

const ACCELERATION: &str = "robot.acceleration_radps2";
const DECELERATION: &str = "robot.stale_deceleration_radps2";
/// An acceleration that this share of the poses leaves is missed at edges only.
const MOSTLY: f64 = 0.5;

/// To whole numbers from 10 on, else to tenths.
fn rounded_down(value: f64) -> f64 {
    if value >= 10.0 { value.floor() } else { (10.0 * value).floor() / 10.0 }
}
