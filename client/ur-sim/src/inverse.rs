//! Inverse kinematics of the simulated arm, and the straight line of `movel`.
//!
//! Contract: bounded steps; `None` where the pose is out of reach or too near to a singularity to be found
//! from the posture given. The solution is the one nearest to that posture, as steps of least squares lead to
//! it.

use super::kinematics::{Dh, chain, frame, pose};

/// Steps of the search.
const MOST_STEPS: usize = 60;
/// Farthest step of a joint \[rad\].
const LONGEST_STEP: f64 = 0.3;
/// Damping of the least squares, of metres and radians alike.
const DAMPING: f64 = 1e-4;
/// A pose counts as reached within this \[m\], \[rad\].
const REACHED: f64 = 1e-8;

type Matrix6 = [[f64; 6]; 6];

/// Joints \[rad\] near `near` for which the tool, `tcp` from the flange, is at `wanted`.
#[must_use]
pub fn joints_for(dh: &Dh, tcp: &[f64; 6], wanted: &[f64; 6], near: &[f64; 6]) -> Option<[f64; 6]> {
    search(dh, tcp, wanted, near, &mut 0)
}

/// The same; counts the steps that it takes.
#[must_use]
pub fn search(
    dh: &Dh,
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
        let mut columns: Matrix6 = [[0.0; 6]; 6];
        for (joint, column) in columns.iter_mut().enumerate() {
            let mut moved = q;
            if let Some(q) = moved.get_mut(joint) {
                *q += 1e-6;
            }
            let after = off(dh, tcp, wanted, &moved);
            for (entry, (before, after)) in column.iter_mut().zip(error.iter().zip(after)) {
                *entry = (before - after) / 1e-6;
            }
        }
        let step = least_squares(&columns, &error)?;
        let longest = step.iter().fold(0.0, |most, step| f64::max(most, step.abs()));
        let share = if longest > LONGEST_STEP { LONGEST_STEP / longest } else { 1.0 };
        q.iter_mut().zip(step).for_each(|(q, step)| *q += share * step);
    }
    None
}

/// From the tool at `q` to `wanted`: place \[m\] and rotation vector \[rad\], in the base frame.
fn off(dh: &Dh, tcp: &[f64; 6], wanted: &[f64; 6], q: &[f64; 6]) -> [f64; 6] {
    let at = chain(&dh.flange(q), &frame(tcp));
    let to = frame(wanted);
    let [[a, b, c], [d, e, f], [g, h, i]] = at.0;
    let back = ([[a, d, g], [b, e, h], [c, f, i]], [0.0; 3]);
    let [.., rx, ry, rz] = pose(&chain(&(to.0, [0.0; 3]), &back));
    let ([x, y, z], [ax, ay, az]) = (to.1, at.1);
    [x - ax, y - ay, z - az, rx, ry, rz]
}

/// The step s with least |J s − e|² + damping² |s|², by its normal equations.
fn least_squares(columns: &Matrix6, error: &[f64; 6]) -> Option<[f64; 6]> {
    let dot = |a: &[f64; 6], b: &[f64; 6]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut rows: [([f64; 6], f64); 6] = [([0.0; 6], 0.0); 6];
    for (i, (row, column)) in rows.iter_mut().zip(columns).enumerate() {
        for (j, (entry, other)) in row.0.iter_mut().zip(columns).enumerate() {
            *entry = dot(column, other) + if i == j { DAMPING * DAMPING } else { 0.0 };
        }
        row.1 = dot(column, error);
    }
    // Symmetric and positive definite: no pivoting is needed.
    for i in 0..6 {
        let (pivot, right) = *rows.get(i)?;
        let diagonal = *pivot.get(i)?;
        if !(diagonal > 0.0) {
            return None;
        }
        for row in rows.iter_mut().skip(i + 1) {
            let share = row.0.get(i)? / diagonal;
            row.0.iter_mut().zip(pivot).for_each(|(entry, pivot)| *entry -= share * pivot);
            row.1 -= share * right;
        }
    }
    let mut step = [0.0; 6];
    for i in (0..6).rev() {
        let (row, right) = rows.get(i)?;
        let known: f64 = row.iter().zip(step).skip(i + 1).map(|(entry, step)| entry * step).sum();
        *step.get_mut(i)? = (right - known) / row.get(i)?;
    }
    step.iter().all(|step| step.is_finite()).then_some(step)
}

/// The way of `movel`: the tool's place along a straight line, its rotation about one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Straight {
    dh: Dh,
    tcp: [f64; 6],
    from: [f64; 6],
    /// Place \[m\] and rotation vector \[rad\] from the beginning to the end, in the base frame.
    by: [f64; 6],
}

impl Straight {
    /// From where `q` has the tool to `to`.
    #[must_use]
    pub fn new(dh: Dh, tcp: [f64; 6], q: &[f64; 6], to: &[f64; 6]) -> Self {
        let from = pose(&chain(&dh.flange(q), &frame(&tcp)));
        Self { dh, tcp, from, by: off(&dh, &tcp, to, q) }
    }

    /// Length of the way \[m\]; where the tool only turns, the angle \[rad\] counts instead.
    #[must_use]
    pub fn length(&self) -> f64 {
        let [x, y, z, rx, ry, rz] = self.by;
        let (way, turn) = ((x * x + y * y + z * z).sqrt(), (rx * rx + ry * ry + rz * rz).sqrt());
        if way > 1e-6 { way } else { turn }
    }

    /// Joints near `near` after the `share` of the way, in \[0, 1\].
    #[must_use]
    pub fn joints(&self, share: f64, near: &[f64; 6]) -> Option<[f64; 6]> {
        let by = self.by.map(|by| share * by);
        let [x, y, z, rx, ry, rz] = by;
        let [fx, fy, fz, ..] = self.from;
        let turned = chain(&frame(&[0.0, 0.0, 0.0, rx, ry, rz]), &(frame(&self.from).0, [0.0; 3]));
        let wanted = pose(&(turned.0, [fx + x, fy + y, fz + z]));
        joints_for(&self.dh, &self.tcp, &wanted, near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{Options, Series};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn joints_lead_to_the_pose_they_were_asked_for(
            by in prop::array::uniform6(-0.4f64..0.4),
            tcp in prop::array::uniform6(-0.1f64..0.1),
        ) {
            let dh = Dh::calibrated(Series::E, 0.003, 5, &Options::new(Series::E).q);
            let near = Options::new(Series::E).q;
            let mut q = near;
            q.iter_mut().zip(by).for_each(|(q, by)| *q += by);
            let wanted = pose(&chain(&dh.flange(&q), &frame(&tcp)));
            let found = joints_for(&dh, &tcp, &wanted, &near).unwrap();
            prop_assert!(off(&dh, &tcp, &wanted, &found).iter().all(|off| off.abs() < 1e-7));
        }
    }

    #[test]
    fn what_is_out_of_reach_is_not_found() {
        let (dh, near) = (Dh::nominal(Series::Cb3), Options::new(Series::Cb3).q);
        for wanted in [[2.0, 0.0, 0.3, 0.0, 3.1, 0.0], [f64::NAN; 6], [1e300; 6]] {
            assert_eq!(joints_for(&dh, &[0.0; 6], &wanted, &near), None);
        }
    }

    #[test]
    fn a_straight_way_is_straight() {
        let (dh, q) = (Dh::nominal(Series::E), Options::new(Series::E).q);
        let mut to = pose(&dh.flange(&q));
        to[0] -= 0.05;
        to[2] += 0.1;
        let way = Straight::new(dh, [0.0; 6], &q, &to);
        assert!((way.length() - 0.125f64.sqrt() * 0.1f64.sqrt()).abs() < 1e-9, "{}", way.length());
        let half = way.joints(0.5, &q).unwrap();
        let (_, [x, y, z]) = dh.flange(&half);
        let (_, [fx, fy, fz]) = dh.flange(&q);
        assert!((x - fx + 0.025).abs() < 1e-7 && (y - fy).abs() < 1e-7 && (z - fz - 0.05).abs() < 1e-7);
    }
}
