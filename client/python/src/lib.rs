//! `foretrace._native`: what the Python package `foretrace` is built on.
//!
//! Contract: no panic crosses the border; waits release the interpreter lock; errors are the exceptions of
//! `problem`, which say what to do.
//!
//! Rooms, each of which uses only those before it: `problem`, `live` (a running daemon), `files` (recordings
//! and data sets), `law` (the law without a daemon).

mod problem;
mod live;
mod files;
mod law;

use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    problem::add(module)?;
    live::add(module)?;
    files::add(module)?;
    law::add(module)
}
