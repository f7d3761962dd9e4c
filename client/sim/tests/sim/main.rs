//! Tests of recordings and data sets, one file per subject. One binary, so that shared code is compiled once.

mod arms_of_others;
mod csv_events;
mod csv_files;
mod data_sets;
mod forged;
#[path = "../../../../tests/src/forged.rs"]
mod forging;
mod fuzz_loaders;
mod inkml_files;
mod made;
mod mat_files;
mod mcap_files;
mod no_recordings;
mod played_files;
mod reference_sets;
#[path = "../../../../tests/src/rewritten.rs"]
mod rewriting;
mod shared;
mod unipen_files;
