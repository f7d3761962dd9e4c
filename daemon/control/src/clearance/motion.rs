//! Velocity and acceleration of points on the links.

use nalgebra::Vector3;

use crate::arm::chain::Kinematics;
use crate::clearance::pairs::Pair;
use crate::geometry::Separation;

/// Motion of the links at zero joint acceleration.
pub(super) struct LinkMotion<'a, const J: usize> {
    kinematics: &'a Kinematics<J>,
    /// Angular velocity \[rad/s\] and acceleration \[rad/s²\] of each moving link, and its origin's
    /// acceleration \[m/s²\].
    links: [[Vector3<f64>; 3]; J],
}

impl<'a, const J: usize> LinkMotion<'a, J> {
    pub(super) fn new(kinematics: &'a Kinematics<J>, qd: &[f64; J]) -> Self {
        let mut links = [[Vector3::zeros(); 3]; J];
        let [mut omega, mut alpha, mut acceleration] = [Vector3::<f64>::zeros(); 3];
        let mut previous = Vector3::zeros();
        for (i, (link, rate)) in links.iter_mut().zip(qd).enumerate() {
            let origin: Vector3<f64> = kinematics.origins.column(i).into_owned();
            let axis: Vector3<f64> = kinematics.jacobian.fixed_view::<3, 1>(3, i).into_owned();
            let arm = origin - previous;
            acceleration += alpha.cross(&arm) + omega.cross(&omega.cross(&arm));
            alpha += omega.cross(&axis) * *rate;
            omega += axis * *rate;
            previous = origin;
            *link = [omega, alpha, acceleration];
        }
        Self { kinematics, links }
    }

    /// nᵀJ \[m/rad\] and nᵀJ̇q̇ \[m/s²\] of the two sides of a pair relative to each other.
    pub(super) fn apart(&self, pair: &Pair<J>, separation: &Separation) -> ([f64; J], f64) {
        let (mut row, mut bending) = self.toward(pair.first.link, &separation.point, &separation.normal);
        if let Some(link) = pair.other_link() {
            let (other, bent) = self.toward(link, &separation.other, &separation.normal);
            row.iter_mut().zip(&other).for_each(|(row, other)| *row -= other);
            bending -= bent;
        }
        (row, bending)
    }

    /// nᵀJ of a `point` on `link` \[m/rad\], and nᵀJ̇q̇ \[m/s²\].
    pub(super) fn toward(&self, link: usize, point: &Vector3<f64>, normal: &Vector3<f64>) -> ([f64; J], f64) {
        let mut row = [0.0; J];
        for (i, entry) in row.iter_mut().enumerate().take(link) {
            let origin: Vector3<f64> = self.kinematics.origins.column(i).into_owned();
            let axis: Vector3<f64> = self.kinematics.jacobian.fixed_view::<3, 1>(3, i).into_owned();
            *entry = axis.cross(&(point - origin)).dot(normal);
        }
        let bending = link.checked_sub(1).and_then(|last| self.links.get(last).map(|link| (last, link)));
        let bending = bending.map_or(0.0, |(last, [omega, alpha, acceleration])| {
            let arm: Vector3<f64> = point - self.kinematics.origins.column(last);
            (acceleration + alpha.cross(&arm) + omega.cross(&omega.cross(&arm))).dot(normal)
        });
        (row, bending)
    }
}
