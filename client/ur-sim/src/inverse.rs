//! Inverse kinematics of the simulated arm, and the straight line of `movel`.
//!
//! Contract: bounded steps; `None` where the pose is out of reach or too near to a singularity to be found
//! from the posture given. The solution is the one nearest to that posture, as steps of least squares lead to
//! it.

use nalgebra::{Cholesky, Isometry3, Matrix6, UnitQuaternion, Vector6};

use super::kinematics::ArmDh;
use super::pose::{frame, pose};

/// Steps of the search.
const MOST_STEPS: usize = 60;
/// Farthest step of a joint \[rad\].
const LONGEST_STEP: f64 = 0.3;
/// Damping of the least squares, of metres and radians alike.
const DAMPING: f64 = 1e-4;
/// A pose counts as reached within this \[m\], \[rad\].
const REACHED: f64 = 1e-8;

/// Joints \[rad\] near `near` for which the tool, `tcp` from the flange, is at `wanted`.
#[must_use]
pub fn joints_for(dh: &ArmDh, tcp: &[f64; 6], wanted: &[f64; 6], near: &[f64; 6]) -> Option<[f64; 6]> {
    search(dh, tcp, wanted, near, &mut 0)
}

/// The same; counts the steps that it takes.
#[must_use]
pub fn search(
    dh: &ArmDh,
    tcp: &[f64; 6],
    wanted: &[f64; 6],
    near: &[f64; 6],
    steps: &mut u32,
) -> Option<[f64; 6]> {
    let mut q = *near;
    for _ in 0..MOST_STEPS {
        *steps += 1;
        let error = off(dh, tcp, wanted, &q);
        if error.iter().all(|error| error.abs() < REACHED) {
            return Some(q);
        }
        // Columns by finite differences: how the error shrinks with each joint.
        let mut jacobian = Matrix6::zeros();
        for (joint, mut column) in jacobian.column_iter_mut().enumerate() {
            let mut moved = q;
            if let Some(q) = moved.get_mut(joint) {
                *q += 1e-6;
            }
            column.copy_from(&((error - off(dh, tcp, wanted, &moved)) / 1e-6));
        }
        // The step s with least |J s − e|² + damping² |s|², by its normal equations.
        let normal = jacobian.tr_mul(&jacobian) + Matrix6::identity() * (DAMPING * DAMPING);
        let step = Cholesky::new(normal)?.solve(&jacobian.tr_mul(&error));
        let longest = step.amax();
        if !longest.is_finite() {
            return None;
        }
        let share = if longest > LONGEST_STEP { LONGEST_STEP / longest } else { 1.0 };
        q.iter_mut().zip(&step).for_each(|(q, step)| *q += share * step);
    }
    None
}

/// From the tool at `q` to `wanted`: position \[m\] and rotation vector \[rad\], in the base frame.
fn off(dh: &ArmDh, tcp: &[f64; 6], wanted: &[f64; 6], q: &[f64; 6]) -> Vector6<f64> {
    let (at, to) = (dh.flange(q) * frame(tcp), frame(wanted));
    let way = to.translation.vector - at.translation.vector;
    let turn = (to.rotation * at.rotation.inverse()).scaled_axis();
    Vector6::new(way.x, way.y, way.z, turn.x, turn.y, turn.z)
}

/// The path of `movel`: the tool's position along a straight line, its rotation about one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Straight {
    dh: ArmDh,
    tcp: [f64; 6],
    from: Isometry3<f64>,
    /// Position \[m\] and rotation vector \[rad\] from the beginning to the end, in the base frame.
    by: Vector6<f64>,
}

impl Straight {
    /// From where `q` has the tool to `to`.
    #[must_use]
    pub fn new(dh: ArmDh, tcp: [f64; 6], q: &[f64; 6], to: &[f64; 6]) -> Self {
        Self { dh, tcp, from: dh.flange(q) * frame(&tcp), by: off(&dh, &tcp, to, q) }
    }

    /// Length of the path \[m\]; where the tool only turns, the angle \[rad\] counts instead.
    #[must_use]
    pub fn length(&self) -> f64 {
        let (way, turn) = (self.by.fixed_rows::<3>(0).norm(), self.by.fixed_rows::<3>(3).norm());
        if way > 1e-6 { way } else { turn }
    }

    /// Joints near `near` after the `share` of the path, in \[0, 1\].
    #[must_use]
    pub fn joints(&self, share: f64, near: &[f64; 6]) -> Option<[f64; 6]> {
        let by = share * self.by;
        let position = self.from.translation.vector + by.fixed_rows::<3>(0);
        let turn = UnitQuaternion::new(by.fixed_rows::<3>(3).into_owned());
        let wanted = Isometry3::from_parts(position.into(), turn * self.from.rotation);
        joints_for(&self.dh, &self.tcp, &pose(&wanted), near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::{calibrated, nominal};
    use crate::options::{ControllerOptions, Series};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn joints_lead_to_the_pose_they_were_asked_for(
            by in prop::array::uniform6(-0.4f64..0.4),
            tcp in prop::array::uniform6(-0.1f64..0.1),
        ) {
            let dh = calibrated(Series::E, 0.003, 5, &ControllerOptions::new(Series::E).q);
            let near = ControllerOptions::new(Series::E).q;
            let mut q = near;
            q.iter_mut().zip(by).for_each(|(q, by)| *q += by);
            let wanted = pose(&(dh.flange(&q) * frame(&tcp)));
            let found = joints_for(&dh, &tcp, &wanted, &near).unwrap();
            prop_assert!(off(&dh, &tcp, &wanted, &found).iter().all(|off| off.abs() < 1e-7));
        }
    }

    #[test]
    fn what_is_out_of_reach_is_not_found() {
        let (dh, near) = (nominal(Series::Cb3), ControllerOptions::new(Series::Cb3).q);
        for wanted in [[2.0, 0.0, 0.3, 0.0, 3.1, 0.0], [f64::NAN; 6], [1e300; 6]] {
            assert_eq!(joints_for(&dh, &[0.0; 6], &wanted, &near), None);
        }
    }

    #[test]
    fn a_straight_way_is_straight() {
        let (dh, q) = (nominal(Series::E), ControllerOptions::new(Series::E).q);
        let mut to = pose(&dh.flange(&q));
        to[0] -= 0.05;
        to[2] += 0.1;
        let way = Straight::new(dh, [0.0; 6], &q, &to);
        assert!((way.length() - 0.125f64.sqrt() * 0.1f64.sqrt()).abs() < 1e-9, "{}", way.length());
        let half = way.joints(0.5, &q).unwrap();
        let moved = dh.flange(&half).translation.vector - dh.flange(&q).translation.vector;
        assert!((moved - nalgebra::Vector3::new(-0.025, 0.0, 0.05)).norm() < 1e-7, "{moved}");
    }
}
