//! Poses: position \[m\] and rotation vector \[rad\].

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use super::super::value::Value;
use super::{number, value};
use crate::pose;

/// The pose at `at`; a list of six numbers counts as one.
fn frame(arguments: &[Value], at: usize) -> Result<Isometry3<f64>, String> {
    let value = value(arguments, at);
    value
        .as_numbers()
        .map(|numbers| pose::frame(&numbers))
        .ok_or_else(|| format!("wants a pose, not {}", value.kind()))
}

fn both(arguments: &[Value]) -> Result<(Isometry3<f64>, Isometry3<f64>), String> {
    Ok((frame(arguments, 0)?, frame(arguments, 1)?))
}

fn joined(position: Vector3<f64>, turn: UnitQuaternion<f64>) -> Value {
    Value::Pose(pose::pose(&Isometry3::from_parts(position.into(), turn)))
}

/// `p_1` and then, in its frame, `p_from_to`.
pub(super) fn pose_trans(arguments: &[Value]) -> Result<Value, String> {
    both(arguments).map(|(from, to)| Value::Pose(pose::pose(&(from * to))))
}

pub(super) fn pose_inv(arguments: &[Value]) -> Result<Value, String> {
    frame(arguments, 0).map(|from| Value::Pose(pose::pose(&from.inverse())))
}

/// Positions added in the base's frame, rotations one after the other.
pub(super) fn pose_add(arguments: &[Value]) -> Result<Value, String> {
    let (from, by) = both(arguments)?;
    Ok(joined(from.translation.vector + by.translation.vector, from.rotation * by.rotation))
}

/// What `p_from` must be added to (`pose_add`) to have `p_to`.
/// *Source*: Universal Robots in forum.universal-robots.com/t/doubts-on-pose-sub-usage-and-meaning/8431.
pub(super) fn pose_sub(arguments: &[Value]) -> Result<Value, String> {
    let (to, from) = both(arguments)?;
    Ok(joined(to.translation.vector - from.translation.vector, to.rotation * from.rotation.inverse()))
}

/// Length of what `pose_sub` gives, metres and radians alike.
pub(super) fn pose_dist(arguments: &[Value]) -> Result<Value, String> {
    let (from, to) = both(arguments)?;
    let way = to.translation.vector - from.translation.vector;
    let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
    Ok(Value::Float((way.norm_squared() + turn.norm_squared()).sqrt()))
}

/// A wrench (force, torque) of one frame as it is in another, which stands at `T_from_to` in the first.
pub(super) fn wrench_trans(arguments: &[Value]) -> Result<Value, String> {
    let to = frame(arguments, 0)?;
    let wrench = value(arguments, 1).as_numbers::<6>().ok_or("wants six numbers for w_from")?;
    let [fx, fy, fz, tx, ty, tz] = wrench;
    let (force, torque) = (Vector3::new(fx, fy, fz), Vector3::new(tx, ty, tz));
    let back = to.rotation.inverse();
    let (force, torque) = (back * force, back * (torque - to.translation.vector.cross(&force)));
    Ok(Value::floats(&[force.x, force.y, force.z, torque.x, torque.y, torque.z]))
}

pub(super) fn point_dist(arguments: &[Value]) -> Result<Value, String> {
    both(arguments).map(|(from, to)| Value::Float((to.translation.vector - from.translation.vector).norm()))
}

/// On the straight line and the shortest rotation from `p_from` (`alpha` 0) to `p_to` (1).
pub(super) fn interpolate_pose(arguments: &[Value]) -> Result<Value, String> {
    let ((from, to), alpha) = (both(arguments)?, number(arguments, 2)?);
    let way = alpha * (to.translation.vector - from.translation.vector);
    let turn = alpha * (from.rotation.inverse() * to.rotation).scaled_axis();
    Ok(joined(from.translation.vector + way, from.rotation * UnitQuaternion::new(turn)))
}

fn three(arguments: &[Value]) -> Result<[f64; 3], String> {
    let value = value(arguments, 0);
    value.as_numbers().ok_or_else(|| format!("wants a list of three numbers, not {}", value.kind()))
}

/// Roll, pitch and yaw turn about the fixed axes x, y and z, in this order.
pub(super) fn rpy2rotvec(arguments: &[Value]) -> Result<Value, String> {
    let [roll, pitch, yaw] = three(arguments)?;
    let turn = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    Ok(Value::floats(turn.scaled_axis().as_slice()))
}

pub(super) fn rotvec2rpy(arguments: &[Value]) -> Result<Value, String> {
    let (roll, pitch, yaw) = UnitQuaternion::new(three(arguments)?.into()).euler_angles();
    Ok(Value::floats(&[roll, pitch, yaw]))
}
