//! What the arm must keep away from.

use nalgebra::{Matrix3, Rotation3, Vector3};
use thiserror::Error;

use crate::geometry::{Cuboid, HalfSpace};

/// Largest number of planes and boxes together.
pub const MAX_OBSTACLES: usize = 16;

/// Something the arm must not touch, in the base frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Obstacle {
    /// Everything behind a plane.
    HalfSpace(HalfSpace),
    /// A box, in any orientation.
    Cuboid(Cuboid),
}

/// Why an obstacle was refused.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ObstacleError {
    /// The normal is not a unit vector.
    #[error("the normal [{x}, {y}, {z}] has length {length:.4} instead of 1")]
    Normal {
        /// Component of the normal, as given.
        x: f64,
        /// Component of the normal, as given.
        y: f64,
        /// Component of the normal, as given.
        z: f64,
        /// Length of the normal, as given.
        length: f64,
    },
    /// The box has no volume.
    #[error("the size [{x}, {y}, {z}] m is not positive along every axis")]
    Size {
        /// \[m\]
        x: f64,
        /// \[m\]
        y: f64,
        /// \[m\]
        z: f64,
    },
    /// A number is NaN or infinite.
    #[error("a number is not finite")]
    NotFinite,
}

/// Normals written with few digits count as unit vectors.
const LENGTH_TOLERANCE: f64 = 1e-2;

impl Obstacle {
    /// Everything behind the plane through `point` \[m\] with `normal` (length 1 up to 1 %) is forbidden.
    ///
    /// # Errors
    ///
    /// A non-finite number, or a normal of another length.
    pub fn plane(point: [f64; 3], normal: [f64; 3]) -> Result<Self, ObstacleError> {
        if !point.iter().chain(&normal).all(|x| x.is_finite()) {
            return Err(ObstacleError::NotFinite);
        }
        let vector = Vector3::from(normal);
        let length = vector.norm();
        if !((length - 1.0).abs() <= LENGTH_TOLERANCE) {
            let [x, y, z] = normal;
            return Err(ObstacleError::Normal { x, y, z, length });
        }
        Ok(Self::HalfSpace(HalfSpace { point: point.into(), normal: vector / length }))
    }

    /// A box around `centre` \[m\] of `size` \[m\] along its own axes, turned by roll, pitch and yaw \[rad\]
    /// (fixed axes, as in URDF).
    ///
    /// # Errors
    ///
    /// A non-finite number, or a size that is not positive.
    pub fn cuboid(centre: [f64; 3], size: [f64; 3], rpy: [f64; 3]) -> Result<Self, ObstacleError> {
        if !centre.iter().chain(&size).chain(&rpy).all(|x| x.is_finite()) {
            return Err(ObstacleError::NotFinite);
        }
        let [x, y, z] = size;
        if !size.iter().all(|x| *x > 0.0) {
            return Err(ObstacleError::Size { x, y, z });
        }
        let [roll, pitch, yaw] = rpy;
        let axes: Matrix3<f64> = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner();
        Ok(Self::Cuboid(Cuboid { centre: centre.into(), half: Vector3::from(size) * 0.5, axes }))
    }
}
