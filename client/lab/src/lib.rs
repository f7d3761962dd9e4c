//! The lab: real handwriting, the built-in writer, stamped pen paths, tracking metrics and report pictures.
//!
//! Contract: nothing here runs in the real-time loop. Every input is untrusted text: a bad file gives an error
//! with file, line and reason, never a panic. The same seed and inputs give the same path, sample for sample.
//! Modules stand in the order in which data flows: files or glyphs, a stamped path, numbers about it, pictures of it.

#![forbid(unsafe_code)]
#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets")]

pub mod data;
pub mod writer;
pub mod path;
pub mod arm;
pub mod today;
pub mod lag;
pub mod metrics;
pub mod experiments;
pub mod closed_loop;
pub mod prediction;
pub mod train;
pub mod plot;
pub mod whole;
mod parallel;
