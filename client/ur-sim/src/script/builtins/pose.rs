//! Poses: position \[m\] and rotation vector \[rad\]. Rotations are calculated with unit quaternions
//! (w, x, y, z).

use super::super::value::Value;
use super::{number, value};

type Pose = [f64; 6];

/// The pose at `at`; a list of six numbers counts as one.
fn pose(arguments: &[Value], at: usize) -> Result<Pose, String> {
    let value = value(arguments, at);
    value.as_numbers().ok_or_else(|| format!("wants a pose, not {}", value.kind()))
}

/// `a` turned by the rotation of `b` first, then by that of `a`.
fn turned(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let ([aw, ax, ay, az], [bw, bx, by, bz]) = (a, b);
    [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
}

fn back([w, x, y, z]: [f64; 4]) -> [f64; 4] {
    [w, -x, -y, -z]
}

fn quaternion([x, y, z]: [f64; 3]) -> [f64; 4] {
    let angle = (x * x + y * y + z * z).sqrt();
    // sin(angle / 2) / angle; at 0 its limit.
    let scale = if angle > 1e-9 { (angle / 2.0).sin() / angle } else { 0.5 };
    [(angle / 2.0).cos(), x * scale, y * scale, z * scale]
}

/// The shorter of the two rotation vectors.
fn rotation_vector(q: [f64; 4]) -> [f64; 3] {
    let sign = if q[0] < 0.0 { -1.0 } else { 1.0 };
    let [w, x, y, z] = q.map(|part| part * sign);
    let sine = (x * x + y * y + z * z).sqrt();
    let scale = if sine > 1e-9 { 2.0 * sine.atan2(w) / sine } else { 2.0 };
    [x * scale, y * scale, z * scale]
}

fn rotated(q: [f64; 4], [x, y, z]: [f64; 3]) -> [f64; 3] {
    let [_, x, y, z] = turned(turned(q, [0.0, x, y, z]), back(q));
    [x, y, z]
}

fn parts([x, y, z, rx, ry, rz]: Pose) -> ([f64; 3], [f64; 4]) {
    ([x, y, z], quaternion([rx, ry, rz]))
}

fn joined([x, y, z]: [f64; 3], q: [f64; 4]) -> Value {
    let [rx, ry, rz] = rotation_vector(q);
    Value::Pose([x, y, z, rx, ry, rz])
}

fn sum(a: [f64; 3], b: [f64; 3], sign: f64) -> [f64; 3] {
    [a[0] + sign * b[0], a[1] + sign * b[1], a[2] + sign * b[2]]
}

/// `p_1` and then, in its frame, `p_from_to`.
pub(super) fn pose_trans(arguments: &[Value]) -> Result<Value, String> {
    let ((at, turn), (to, by)) = (parts(pose(arguments, 0)?), parts(pose(arguments, 1)?));
    Ok(joined(sum(at, rotated(turn, to), 1.0), turned(turn, by)))
}

pub(super) fn pose_inv(arguments: &[Value]) -> Result<Value, String> {
    let (at, turn) = parts(pose(arguments, 0)?);
    Ok(joined(rotated(back(turn), at).map(|x| -x), back(turn)))
}

/// Positions added in the base's frame, rotations one after the other.
pub(super) fn pose_add(arguments: &[Value]) -> Result<Value, String> {
    let ((at, turn), (to, by)) = (parts(pose(arguments, 0)?), parts(pose(arguments, 1)?));
    Ok(joined(sum(at, to, 1.0), turned(turn, by)))
}

/// What `p_from` must be added to (`pose_add`) to have `p_to`.
/// *Source*: Universal Robots in forum.universal-robots.com/t/doubts-on-pose-sub-usage-and-meaning/8431.
pub(super) fn pose_sub(arguments: &[Value]) -> Result<Value, String> {
    let ((to, by), (at, turn)) = (parts(pose(arguments, 0)?), parts(pose(arguments, 1)?));
    Ok(joined(sum(to, at, -1.0), turned(by, back(turn))))
}

pub(super) fn point_dist(arguments: &[Value]) -> Result<Value, String> {
    let ((from, _), (to, _)) = (parts(pose(arguments, 0)?), parts(pose(arguments, 1)?));
    let between = sum(to, from, -1.0);
    Ok(Value::Float(between.iter().map(|x| x * x).sum::<f64>().sqrt()))
}

/// On the straight line and the shortest rotation from `p_from` (`alpha` 0) to `p_to` (1).
pub(super) fn interpolate_pose(arguments: &[Value]) -> Result<Value, String> {
    let ((from, turn), (to, by)) = (parts(pose(arguments, 0)?), parts(pose(arguments, 1)?));
    let alpha = number(arguments, 2)?;
    let at = sum(from, sum(to, from, -1.0), alpha);
    let way = rotation_vector(turned(back(turn), by)).map(|part| part * alpha);
    Ok(joined(at, turned(turn, quaternion(way))))
}

fn three(arguments: &[Value]) -> Result<[f64; 3], String> {
    let value = value(arguments, 0);
    value.as_numbers().ok_or_else(|| format!("wants a list of three numbers, not {}", value.kind()))
}

/// Roll, pitch and yaw turn about the fixed axes x, y and z, in this order.
pub(super) fn rpy2rotvec(arguments: &[Value]) -> Result<Value, String> {
    let [roll, pitch, yaw] = three(arguments)?;
    let (x, y) = (quaternion([roll, 0.0, 0.0]), quaternion([0.0, pitch, 0.0]));
    Ok(Value::floats(&rotation_vector(turned(quaternion([0.0, 0.0, yaw]), turned(y, x)))))
}

pub(super) fn rotvec2rpy(arguments: &[Value]) -> Result<Value, String> {
    let [w, x, y, z] = quaternion(three(arguments)?);
    let roll = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    let pitch = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    Ok(Value::floats(&[roll, pitch, yaw]))
}
