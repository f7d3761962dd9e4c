//! What the arm is: its kinematic chain, what its joints may do, and how late it follows.
//!
//! Contract: no memory but that of [`lag`], no policy. Everything that plans for the arm, solves for it or
//! judges it starts from here.

pub(crate) mod bodies;
pub mod chain;
pub mod lag;
pub mod limits;
pub(crate) mod servo;
mod sincos;
pub(crate) mod urdf;

pub use bodies::Capsule;
pub use chain::{Chain, ChainLimits, Kinematics, ToolMotion};
pub use limits::{JointLimits, JointMotion, LimitError, VelocityBox, velocity_box};
pub use urdf::{ChainError, description};
