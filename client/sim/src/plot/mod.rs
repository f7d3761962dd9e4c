//! Report pictures as SVG: pen and robot path, error with trust, histograms, lines, bars, points.
//!
//! Pure functions from data to one file, written whole or not at all (temporary file, then rename). Values
//! that are not finite are left out. Units of the arguments are SI; the pictures choose mm, ms or µs for
//! reading.

mod canvas;
mod overlay;
mod panels;
mod histogram;
mod bars;
mod panels_and_cells;
mod scatter;
mod log_panels;
pub mod page;

pub use bars::{Bars, Best, bar_table};
pub use histogram::Distribution;
pub use log_panels::{LogLine, LogPanel, log_panels};
pub use overlay::{Cell, letter_grid};
pub use panels::{Line, Mark, Panel, lines, panels, panels_and_curve};
pub use panels_and_cells::panels_and_cells;
pub use scatter::{Named, scatter};

use std::io::Write;
use std::path::{Path, PathBuf};

/// A picture that was not written.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    /// Nothing finite to draw.
    #[error("{}: nothing to draw: {what}", file.display())]
    Empty {
        /// The picture.
        file: PathBuf,
        /// Which data is missing.
        what: &'static str,
    },
    /// The drawing library refused.
    #[error("{}: cannot draw: {why}", file.display())]
    Drawing {
        /// The picture.
        file: PathBuf,
        /// Its reason.
        why: String,
    },
    /// The file system refused.
    #[error("{}: cannot write: {why}", file.display())]
    Writing {
        /// The picture.
        file: PathBuf,
        /// The system's reason.
        why: String,
    },
}

/// Writes a picture whole or not at all.
fn write_whole(file: &Path, text: &str) -> Result<(), PlotError> {
    let written = crate::whole::write(file, |out| out.write_all(text.as_bytes()));
    written.map_err(|e| PlotError::Writing { file: file.to_path_buf(), why: e.to_string() })
}

#[cfg(test)]
mod tests;
