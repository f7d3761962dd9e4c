//! Files: recordings, replays, data sets and pen paths.
//!
//! Contract: whatever a file holds, the result is values or an exception with the words of the command
//! `foretrace`. Long work runs on a thread of its own (`work`). Arrays leave as little-endian bytes; the
//! Python side makes arrays of them.

pub mod work;
pub mod values;
pub mod settings;
mod failed;
mod recording;
mod stops;
mod replays;
mod sets;
mod paths;

use pyo3::prelude::*;

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    settings::add(module)?;
    recording::add(module)?;
    stops::add(module)?;
    replays::add(module)?;
    sets::add(module)?;
    paths::add(module)
}
