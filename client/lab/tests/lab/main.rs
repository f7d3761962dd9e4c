//! The lab from outside, one file a subject. One binary: what they share is compiled once.

mod closed_loop;
mod data_sets;
mod desk;
mod figures;
mod fuzz_loaders;
mod inkml_files;
mod lag_online;
mod legal_settings;
mod made;
mod mat_files;
mod not_following;
mod prediction_tables;
mod preset_edges;
mod reference_sets;
mod soak;
mod stop_duration;
mod train_fit;
mod train_gradients;
mod unipen_files;
