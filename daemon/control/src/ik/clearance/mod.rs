//! Keeping the arm away from planes, boxes and itself.

pub mod distance;
pub mod shape;

pub use shape::{Capsule, MAX_OBSTACLES, Obstacle, ObstacleError};
