//! Tests of recordings and data sets, one file per subject. One binary, so that shared code is compiled once.

mod data_sets;
mod fuzz_loaders;
mod inkml_files;
mod made;
mod mat_files;
mod reference_sets;
mod shared;
mod unipen_files;
