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

pub use super::corpus::hold_out;
pub use corpus::{Change, Sequence, Writing, WritingError, writings};
pub use examples::{Examples, examples};
pub use fit::{Engine, Fit, Plan, of_writing};
pub use model::weights_of;
pub use network::Shape;
pub use score::{LEADS_S, Tally};
pub use study::{Context, Study, Without};
pub use trial::{Judgement, Trial, judge, train};
