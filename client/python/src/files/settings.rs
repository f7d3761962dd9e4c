//! Settings as a caller names them: a preset or a file, and changes of single keys.

use std::path::Path;

use foretrace_config::{Config, Draft, presets};
use pyo3::prelude::*;

use crate::problem::invalid;

/// What is under the changes.
#[derive(Debug, Clone, FromPyObject)]
pub struct NamedSettings {
    /// The name of a preset.
    #[pyo3(item)]
    preset: Option<String>,
    #[pyo3(item)]
    file: Option<std::path::PathBuf>,
    /// Keys, and values as TOML.
    #[pyo3(item)]
    changes: Vec<(String, String)>,
}

impl NamedSettings {
    /// Reads and judges them.
    ///
    /// # Errors
    ///
    /// All that is wrong, in the words of `foretrace config check`.
    pub fn load(&self) -> Result<Config, PyErr> {
        let mut draft = match (&self.preset, &self.file) {
            (Some(name), _) if presets::text(name).is_some() => Draft::preset(name),
            (Some(name), _) => {
                let known = presets::names();
                let what = format_args!("no preset is called {name:?}; there are {known}, or give a path");
                return Err(invalid(what));
            }
            (None, Some(file)) => Draft::file(file),
            (None, None) => Draft::text("", "the settings", Path::new(".")),
        };
        for (key, value) in &self.changes {
            draft = draft.set(key, value);
        }
        draft.finish().map_err(invalid)
    }
}

/// Whether a preset has this name.
#[pyfunction]
fn is_preset(name: &str) -> bool {
    presets::text(name).is_some()
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(is_preset, module)?)
}
