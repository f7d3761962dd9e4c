//! Settings and models as files, good ones and broken ones.

mod models;
mod prior;
mod models_fuzz;
mod settings_fuzz;

mod forged;
#[path = "../../../tests/src/forged.rs"]
mod forging;
