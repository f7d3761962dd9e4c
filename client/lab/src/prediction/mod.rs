//! Prediction tables: recorded characters as displacement sequences, the contestants, and their scores.
//!
//! Contract: everything is in the set's raw units per sample, exactly as the reference tables were made. Models reset
//! their state before each sequence and carry parameters over. Absent: training of networks and the closed loop.

mod sequence;

pub use sequence::{PADDING_STEPS, Sequence, sequences};
