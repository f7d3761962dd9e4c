//! Training of `foresight`, the network that sees contact, direction and time, in code of our own.
//!
//! Contract: the same seed, data and options give the same weights bit for bit, on any number of threads.
//! Examples come from the loop's own pen grid, scale and features. Absent: what learns online.

mod balance;
mod product;
mod network;
mod study;
mod corpus;
mod examples;
mod score;
mod fit;
mod model;
mod trial;
mod input_table;
mod run;

pub use super::corpus::hold_out;
pub use corpus::{Distortion, Writing, WritingError, WrittenCharacter, writings};
pub use examples::{Examples, examples};
pub use fit::{ForesightFit, ForesightPlan, GradientEngine, of_writing};
pub use input_table::{InputRow, input_csv, input_json, input_lines};
pub use model::weights_of;
pub use network::ForesightShape;
pub use run::{EPOCHS, ForesightTraining, RATE, STEP_MS, WARM_UP, usual_plan};
pub use score::{ErrorSums, LEADS_S};
pub use study::{Context, Study, Without};
pub use trial::{ForesightTrial, Judgement, judge, train};
