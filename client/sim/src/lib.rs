//! Simulated hand and arm: recorded handwriting, the built-in writer, stamped pen paths, the simulated arm;
//! and how well a tool followed a pen, as numbers and pictures.
//!
//! Contract: nothing here runs in the real-time loop, and nothing is compared here (the lab does that). Every
//! input is untrusted text: a bad file gives an error with file, line and reason, never a panic. The same
//! seed and inputs give the same path, sample for sample. Modules stand in the order in which data flows:
//! files or glyphs, a stamped path, the arm, numbers about it, pictures of it.

#![forbid(unsafe_code)]

pub mod data;
#[cfg(feature = "formats")]
mod formats;
pub mod writer;
pub mod path;
pub mod arm;
pub mod lag;
pub mod metrics;
pub mod spread;
pub mod plot;
pub mod source;
