//! Closed-form inverse kinematics of an arm of this kind: three parallel axes behind the base's, and a wrist
//! whose axes are at right angles. Up to eight postures have the flange in one place.
//!
//! Contract: bounded, total. What a calibration adds to the angles between axes is left out: `inverse`
//! refines what is found here. Where the place is out of reach by a little, the posture that comes nearest is
//! given, and whoever asks has to look whether it is near enough.
//!
//! *Derivation*, with z the direction of the three parallel axes: the flange's centre less d6 along its own z
//! lies d4 off the plane through the base's axis, which leaves two q1. z seen from the flange is (sin q5 cos
//! q6, −sin q5 sin q6, cos q5), which leaves two q5 and one q6 for each. What remains is an arm of two links
//! in the plane: the law of cosines gives two q3, then q2 and q4 follow.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Vector3};

use super::kinematics::ArmDh;

/// Below this sine of q5 the axes of q4 and q6 are one: q6 is free.
const WRIST_SINGULAR: f64 = 1e-9;

/// Postures \[rad\] with the flange at `flange`, each angle within a turn; where the wrist leaves one joint
/// free, it is as in `near`.
#[must_use]
pub fn postures(dh: &ArmDh, flange: &Isometry3<f64>, near: &[f64; 6]) -> Vec<[f64; 6]> {
    let [_, a2, a3, ..] = dh.a;
    let [d1, d2, d3, d4, d5, d6] = dh.d;
    // All three parallel axes move the wrist sideways alike.
    let aside = d2 + d3 + d4;
    let turn = flange.rotation.to_rotation_matrix();
    let axis = |column: usize| Vector3::from(turn.matrix().column(column));
    let (x6, y6, z6) = (axis(0), axis(1), axis(2));
    let wrist = flange.translation.vector - d6 * z6;
    let reach = wrist.x.hypot(wrist.y);
    let open = if reach > 0.0 { (aside / reach).clamp(-1.0, 1.0).acos() } else { FRAC_PI_2 };
    let towards = wrist.y.atan2(wrist.x) + FRAC_PI_2;
    let mut found = Vec::with_capacity(8);
    for q1 in [towards + open, towards - open] {
        let (s1, c1) = q1.sin_cos();
        // Direction of the parallel axes, and the base's x axis turned with the arm.
        let (z, x) = (Vector3::new(s1, -c1, 0.0), Vector3::new(c1, s1, 0.0));
        let (along_x, along_y, c5) = (z.dot(&x6), z.dot(&y6), z.dot(&z6));
        let amount = along_x.hypot(along_y);
        for s5 in [amount, -amount] {
            let q5 = s5.atan2(c5);
            let q6 = if amount > WRIST_SINGULAR {
                (-along_y / s5).atan2(along_x / s5)
            } else {
                near.last().copied().unwrap_or(0.0) + dh.theta.last().copied().unwrap_or(0.0)
            };
            let (sin5, cos5) = q5.sin_cos();
            let (sin6, cos6) = q6.sin_cos();
            // x and z axes of the frame behind q4, in the base frame; its y axis is z.
            let x5 = cos6 * x6 - sin6 * y6;
            let x4 = cos5 * x5 - sin5 * z6;
            let z4 = -(sin6 * x6 + cos6 * y6);
            // Where the third link ends, in the plane of the arm.
            let end = wrist - d5 * z4 - aside * z;
            let (along, up) = (end.dot(&x), end.z - d1);
            let (cos4, sin4) = (x4.dot(&x), x4.z);
            let c3 = (along * along + up * up - a2 * a2 - a3 * a3) / (2.0 * a2 * a3);
            for q3 in [c3.clamp(-1.0, 1.0).acos(), -c3.clamp(-1.0, 1.0).acos()] {
                let (s3, c3) = q3.sin_cos();
                let q2 = up.atan2(along) - (a3 * s3).atan2(a2 + a3 * c3);
                let q4 = sin4.atan2(cos4) - q2 - q3;
                let mut q = [q1, q2, q3, q4, q5, q6];
                q.iter_mut().zip(dh.theta).for_each(|(q, offset)| *q -= offset);
                found.push(q);
            }
        }
    }
    found
}
