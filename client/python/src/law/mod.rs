//! `law`.

use pyo3::prelude::*;

pub fn add(_module: &Bound<'_, PyModule>) -> PyResult<()> {
    Ok(())
}
