//! The closed-loop benchmark: every sequence of a data set, in real time, through the daemon's own control
//! law, and through the baselines.
//!
//! Contract: one constant scale per set and arm (its median *train* glyph becomes
//! [`BenchArm::glyph_height_m`]), no scaling per letter. Hover paths are kept where they were recorded; a
//! lift without recorded hover stays the jump of one sample that it is in the recording, and the [`LEAP_S`]
//! behind it are scored apart, because it cannot be predicted. Learners start cold with every writer of a
//! file (a new hand) and carry over from letter to letter; where writers alternate in a file, each keeps its
//! own state. The same data and settings give the same numbers on any number of cores.

mod arm;
mod rival;
mod job;
mod legal;
mod pareto;
mod score;
mod sensitivity;
mod sequences;
mod baseline;
mod trial;
mod tick_table;
mod table;
mod written;
pub mod pictures;
#[cfg(test)]
mod hostile_tests;

pub use arm::{BenchArm, Flaws};
pub use job::{BenchError, Benchmark, HandNames, MethodOutcome};
pub use pareto::{ParetoPoint, ParetoSweep};
pub use rival::{Rival, UnknownRival};
pub use score::{BenchRow, Each, SequenceScore, rows};
pub use sensitivity::{NumberEffect, half_and_double};
pub use sequences::{Hand, LEAP_S, Sequence, hand_of_text, hands};
pub use table::table_lines;
pub use tick_table::TickTable;
pub use trial::{SeenStop, Trial, TrialError, Tried};
pub use written::{HandOptions, HandsOfArms, hands_of_set, hands_of_texts};
