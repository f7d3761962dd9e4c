//! Recordings and data sets from outside, one file a subject. One binary: what they share is compiled once.

mod data_sets;
mod fuzz_loaders;
mod inkml_files;
mod made;
mod mat_files;
mod reference_sets;
mod shared;
mod unipen_files;
