//! Settings of foretrace: read from TOML, checked with file and line, and turned into typed structs.
//!
//! Contract: [`Config::load`] gives settings that are complete and fit together, or *all* that is wrong with
//! them. Units stand in the names of keys, unknown keys are errors, and what has to be tuned per installation
//! has no default but may come from a preset (`preset = "ur5"` at the top of the file, then override key by
//! key). Every key is declared once, in [`settings`]; reading, `show`, the documents and reloading follow
//! from that table.

#![forbid(unsafe_code)]

mod encoding;
pub mod files;
mod plain;
mod nearest;
mod written;
mod problem;
mod schema;
mod value;
pub mod settings;
pub mod presets;
pub mod models;
mod layers;
mod check;
mod clearance;
mod robot;
mod headroom;
mod predictor;
mod follower;
mod config;
mod remarks;
mod unarmed;
mod live;
mod render;

pub use check::LONGEST_ROOT_BYTES;
pub use config::{Config, Draft};
pub use headroom::{Exceeded, FRICTION_SHARE, Headroom, JointHeadroom, ROTOR_KGM2};
pub use live::{KeyChange, LiveChange, StartOnlyKey};
pub use plain::{plain, plain_lines, plain_log};
pub use problem::{ConfigError, Problem, ProblemKind, ValueFlaw};
pub use render::keys;
pub use robot::{JOINTS, Robot};
pub use schema::{Change, Key, Legal, Presence};
pub use settings::Settings;
pub use written::SettingOrigin;

#[cfg(test)]
mod tests;
