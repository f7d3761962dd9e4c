//! Inverse kinematics of the simulated arm, and the straight line of `movel`.
//!
//! Contract: bounded steps; `None` where the pose is out of reach or no posture for it is inside the range of
//! the joints. Of all postures (`branches`) it is the one nearest to that given; what a calibration adds is
//! found by least squares from there.

use std::f64::consts::TAU;

use nalgebra::{Cholesky, Isometry3, Matrix6, UnitQuaternion, Vector6};

use super::branches::postures;
use super::kinematics::{ArmDh, POSITION_LIMIT_RAD};
use super::pose::{frame, pose};

/// Steps of the search from one posture.
const MOST_STEPS: usize = 60;
/// Farthest step of a joint \[rad\].
const LONGEST_STEP: f64 = 0.3;
/// Damping of the least squares, of metres and radians alike.
const DAMPING: f64 = 1e-4;
/// A pose counts as reached within this, unless more is allowed \[m\], \[rad\].
const REACHED: f64 = 1e-9;
/// Farther \[m\] and \[rad\] from the pose than this, a posture in closed form is not worth refining: no
/// calibration is that far off.
const WORTH_REFINING: f64 = 0.1;

/// How near to a pose the tool has to come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseTolerance {
    /// \[m\]
    pub position: f64,
    /// \[rad\]
    pub orientation: f64,
}

impl PoseTolerance {
    /// What is meant where nothing is said.
    pub const TIGHT: Self = Self { position: REACHED, orientation: REACHED };

    /// At least what numbers of this size can tell.
    #[must_use]
    pub fn new(position: f64, orientation: f64) -> Self {
        Self { position: position.max(REACHED), orientation: orientation.max(REACHED) }
    }

    fn allows(&self, off: &Vector6<f64>) -> bool {
        off.fixed_rows::<3>(0).norm() <= self.position && off.fixed_rows::<3>(3).norm() <= self.orientation
    }
}

/// Joints \[rad\] near `near` for which the tool, `tcp` from the flange, is at `wanted`.
#[must_use]
pub fn joints_for(dh: &ArmDh, tcp: &[f64; 6], wanted: &[f64; 6], near: &[f64; 6]) -> Option<[f64; 6]> {
    search(dh, tcp, wanted, near, PoseTolerance::TIGHT, &mut 0)
}

/// The same within a tolerance; counts the steps that it takes.
#[must_use]
pub fn search(
    dh: &ArmDh,
    tcp: &[f64; 6],
    wanted: &[f64; 6],
    near: &[f64; 6],
    tolerance: PoseTolerance,
    steps: &mut u32,
) -> Option<[f64; 6]> {
    if wanted.iter().chain(near).any(|number| !(number.abs() < 1e6)) {
        return None;
    }
    *steps += 1;
    let flange = frame(wanted) * frame(tcp).inverse();
    let mut candidates: Vec<([f64; 6], f64)> =
        postures(dh, &flange, near).into_iter().filter_map(|q| turned_near(q, near)).collect();
    candidates.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    candidates.into_iter().find_map(|(q, _)| {
        *steps += 1;
        let error = off(dh, tcp, wanted, &q);
        if tolerance.allows(&error) {
            return Some(q);
        }
        let near_enough = error.iter().all(|error| error.abs() < WORTH_REFINING);
        let refined = near_enough.then(|| refine(dh, tcp, wanted, &q, tolerance, steps)).flatten()?;
        turned_near(refined, near).map(|(q, _)| q)
    })
}

/// The same posture with each joint turned as near to `near` as its range lets it, and the sum of the squares
/// of how far they are apart \[rad²\].
fn turned_near(q: [f64; 6], near: &[f64; 6]) -> Option<([f64; 6], f64)> {
    let mut turned = q;
    let mut apart = 0.0;
    for (q, near) in turned.iter_mut().zip(near) {
        *q += TAU * ((near - *q) / TAU).round();
        if q.abs() > POSITION_LIMIT_RAD {
            *q -= TAU * (*q / TAU).round();
            // Of two turns inside the range, that on the side of `near`.
            let other = *q + TAU.copysign(near - *q);
            if other.abs() <= POSITION_LIMIT_RAD && (other - near).abs() < (*q - near).abs() {
                *q = other;
            }
        }
        apart += (*q - near) * (*q - near);
    }
    turned.iter().all(|q| q.abs() <= POSITION_LIMIT_RAD).then_some((turned, apart))
}

/// Steps of least squares from `from`.
fn refine(
    dh: &ArmDh,
    tcp: &[f64; 6],
    wanted: &[f64; 6],
    from: &[f64; 6],
    tolerance: PoseTolerance,
    steps: &mut u32,
) -> Option<[f64; 6]> {
    let mut q = *from;
    for _ in 0..MOST_STEPS {
        *steps += 1;
        let error = off(dh, tcp, wanted, &q);
        if tolerance.allows(&error) {
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
#[path = "inverse_tests.rs"]
mod tests;
