//! Tests of the lab's interface, one file per subject. One binary, so that shared code is compiled once.

mod closed_loop;
mod desk;
mod figures;
mod forged;
#[path = "../../../../tests/src/forged.rs"]
mod forging;
mod lag_online;
mod lockstep;
mod legal_settings;
mod not_following;
mod odd_joints;
mod paper_law;
mod prediction_tables;
mod preset_edges;
mod process;
#[path = "../../../sim/tests/sim/shared.rs"]
mod shared;
mod soak;
mod starved;
mod stop_duration;
mod stops;
mod train_fit;
mod train_foresight;
mod train_gradients;
