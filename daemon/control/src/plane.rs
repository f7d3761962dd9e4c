//! The writing plane: its frame in the robot's base frame.

use nalgebra::{Rotation3, Vector3};

use crate::units::AxisState;

/// The calibrated writing plane. Its frame: x, y in the plane, z along the normal, away from the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Origin of the plane frame in the base frame \[m\].
    pub origin: Vector3<f64>,
    /// Columns: the plane's x, y and normal in the base frame.
    pub rotation: Rotation3<f64>,
    /// Plane metres per metre of the pen device.
    pub pen_scale: f64,
    /// Point of the pen device \[m\] at the plane's origin.
    pub pen_origin: [f64; 2],
    /// Height of the tool above the paper while the pen is up \[m\].
    pub lift_height: f64,
    /// How far below the paper a tool that writes is commanded \[m\]: the preload of a pen with a spring.
    pub press_depth: f64,
}

impl Plane {
    /// A point of the pen device \[m\] in the plane frame \[m\].
    #[must_use]
    pub fn from_pen(&self, point: [f64; 2]) -> [f64; 2] {
        let [x, y] = point;
        let [ox, oy] = self.pen_origin;
        [(x - ox) * self.pen_scale, (y - oy) * self.pen_scale]
    }

    /// A point of the plane frame in the base frame \[m\].
    #[must_use]
    pub fn point_to_base(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.origin + self.rotation * point
    }

    /// A point of the base frame in the plane frame \[m\].
    #[must_use]
    pub fn point_from_base(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse_transform_vector(&(point - self.origin))
    }

    /// A free vector (velocity, acceleration) of the plane frame in the base frame.
    #[must_use]
    pub fn vector_to_base(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * vector
    }

    /// A free vector (velocity, acceleration) of the base frame in the plane frame.
    #[must_use]
    pub fn vector_from_base(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse_transform_vector(vector)
    }

    /// Where the tool's z axis has to point, in the base frame: into the paper.
    #[must_use]
    pub fn tool_axis(&self) -> Vector3<f64> {
        -(self.rotation * Vector3::z())
    }

    /// The three axis states of a tool that moves with `velocity` and `acceleration` through `position`, all
    /// given in the base frame \[m, m/s, m/s²\].
    #[must_use]
    pub fn axes_from_base(
        &self,
        position: &Vector3<f64>,
        velocity: &Vector3<f64>,
        acceleration: &Vector3<f64>,
    ) -> [AxisState; 3] {
        let p = self.point_from_base(position);
        let v = self.vector_from_base(velocity);
        let a = self.vector_from_base(acceleration);
        let axis = |position, velocity, acceleration| AxisState { position, velocity, acceleration };
        [axis(p.x, v.x, a.x), axis(p.y, v.y, a.y), axis(p.z, v.z, a.z)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tilted() -> Plane {
        Plane {
            origin: Vector3::new(0.4, -0.1, 0.2),
            rotation: Rotation3::from_euler_angles(0.3, -0.2, 1.1),
            pen_scale: 2.0,
            pen_origin: [0.01, 0.02],
            lift_height: 0.01,
            press_depth: 0.0,
        }
    }

    #[test]
    fn points_survive_the_way_to_the_base_and_back() {
        let plane = tilted();
        let point = Vector3::new(0.03, -0.02, 0.01);
        let back = plane.point_from_base(&plane.point_to_base(&point));
        assert!((back - point).norm() < 1e-15);
    }

    #[test]
    fn the_tool_points_into_the_paper() {
        let plane = tilted();
        let above = plane.point_to_base(&Vector3::new(0.0, 0.0, 1.0)) - plane.origin;
        assert!((above + plane.tool_axis()).norm() < 1e-15);
    }

    #[test]
    fn the_pen_is_scaled_about_its_own_origin() {
        assert_eq!(tilted().from_pen([0.01, 0.02]), [0.0, 0.0]);
        let [x, y] = tilted().from_pen([0.02, 0.0]);
        assert!((x - 0.02).abs() < 1e-15 && (y + 0.04).abs() < 1e-15);
    }
}
