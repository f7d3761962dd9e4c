//! The lab from outside, one file a subject. One binary: what they share is compiled once.

mod closed_loop;
mod desk;
mod figures;
mod lag_online;
mod legal_settings;
mod not_following;
mod paper_law;
mod prediction_tables;
mod preset_edges;
#[path = "../../../sim/tests/sim/shared.rs"]
mod shared;
mod soak;
mod stop_duration;
mod train_fit;
mod train_gradients;
