//! RTDE, the real-time data exchange of Universal Robots (port 30004): packages, fields, recipes, a client.
//!
//! Rooms, in order: `value` (types and values of fields), `fields` (which there are), `frames` (packages in a
//! stream), `wire` (what packages say), `recipe` (an agreed list of fields), `client` (blocking).
//! Everything is big-endian; a package is at most 65535 bytes long.
//!
//! *Source*: RTDE guide of Universal Robots; protocol versions 1 and 2.

pub mod value;
pub mod fields;
pub mod frames;
pub mod wire;
pub mod recipe;
pub mod client;

pub use client::{InputRecipe, OutputPackage, RtdeClient, RtdeError};
pub use value::{FieldType, RtdeValue};
pub use wire::{ControllerVersion, ProtocolVersion, RtdeMessage};

pub const PORT: u16 = 30004;
