//! Error against look-ahead time, on one time axis for devices of any rate: ranks predictors of the pen.
//!
//! A character is its points p\[0\], p\[1\] … (p\[0\] = 0, the appended rest left out). At every *instant*
//! (each 20 ms of writing) a model has seen p[0..=t] and predicts where the pen is 10, 20 … 200 ms later;
//! between samples both the true and the predicted path are straight. Scored are targets inside the character
//! whose window p[t-1] … target holds no jump between strokes, which cannot be predicted. Every model that
//! runs here gets error bands by the daemon's calibration; predictions from elsewhere bring their own. Beside
//! the error stand the side effects of [`JudgedTarget`], and what other writers would change
//! ([`WriterBootstrap`]).

mod targets;
mod judged;
mod tally;
mod writers;
mod bands;
mod file;
mod predicted;
mod board;
mod each;
mod shown;

pub use board::{Board, BoardError, Entrant, Lane, Standing, compare, predict_all, ranked};
pub use each::{CharacterName, EachCharacter};
pub use file::{BandedPosition, PredictionError, Predictions};
pub use judged::JudgedTarget;
pub use predicted::{LeadAnswers, Predicted};
pub use shown::{draw, standing_lines};
pub use tally::{LaneTally, LeadRow, LeadSums, LeadTally, SequenceSums, TargetSpread};
pub use targets::{Instant, Targets, Truth, export};
pub use writers::{REPLICATES, WriterBootstrap};

/// Look-ahead times \[ms\].
pub const LEADS_MS: [u32; 20] =
    [10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130, 140, 150, 160, 170, 180, 190, 200];

/// Time between instants \[s\].
pub const STRIDE_S: f64 = 0.02;

/// Shares that error bands are judged at.
pub const SHARES: [f64; 2] = [0.5, 0.9];

#[cfg(test)]
mod tests;
