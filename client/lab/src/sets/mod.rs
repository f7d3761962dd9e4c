//! Sets of handwriting: where the published ones are and whether they are those that were measured, and a
//! small one that this program writes itself.
//!
//! Contract: nothing is downloaded, and no recording is changed; a set's `split.tsv` is written whole, or not
//! at all.

mod folder_sum;
mod split_rule;
mod published;
mod check;
mod generated;

pub use check::{CheckedSet, SplitFound, check};
pub use folder_sum::FolderSum;
pub use generated::{GenerateError, GeneratedSet};
pub use published::PublishedSet;
pub use split_rule::SplitRule;
