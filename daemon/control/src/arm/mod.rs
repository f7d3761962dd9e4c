//! The arm: its kinematic chain, its torques, the limits of its joints, and its lag.
//!
//! Contract: no memory but that of [`lag`], no policy. Planner, solvers and monitors use this description.

mod band;
pub(crate) mod bodies;
pub mod chain;
pub(crate) mod chain_error;
mod description;
pub(crate) mod document;
pub mod dynamics;
pub mod lag;
pub mod limits;
pub mod response;
pub(crate) mod servo;
pub(crate) mod silence;
mod sincos;
mod track;
pub(crate) mod urdf;

pub use bodies::Capsule;
pub use chain::{Chain, ChainLimits, Kinematics, ToolMotion};
pub use chain_error::{ChainError, Part};
pub use document::LONGEST_BYTES;
pub use dynamics::{Dynamics, DynamicsError, Payload};
pub use limits::{JointLimits, JointMotion, LimitError, VelocityBox, velocity_box};
pub use urdf::{StillLink, description};
