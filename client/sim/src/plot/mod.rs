//! Pictures as SVG: of a page, inline or alone in a file, in light and dark; and charts of a report.
//!
//! Contract: pure functions from data in SI units to a [`Picture`] or to one file, written whole or not at
//! all; what is not finite is left out, and a picture without data is `None` or [`PlotError::Empty`]. Colours
//! are named by what they show (pen, arm, ghost, bound) and set in one file, `sheet`. Titles and figures are
//! part of the SVG (`<title>`, `<desc>`), so that text about a picture can be checked against it. The
//! pictures choose mm, ms or µs for reading.

mod sheet;
mod paths;
mod curves;
mod histogram;
mod durations;
mod shares;
mod bars;
mod scatter;
mod log_panels;

pub use bars::{Bars, Best, bar_table};
pub use curves::{
    Bound, ChartPanel, CurvePanel, Line, Mark, PageCurve, curves, panels, panels_and_cells, panels_and_curve,
};
pub use durations::durations;
pub use histogram::Distribution;
pub use log_panels::{LogLine, LogPanel, log_panels};
pub use paths::{Cell, Traced, letter_grid, paths};
pub use scatter::{Named, scatter};
pub use shares::{Shares, shares};
pub use sheet::{Picture, STYLE, Shown, escaped};

use std::path::{Path, PathBuf};

/// A picture that was not written.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlotError {
    #[error("{}: nothing to draw: {what}", file.display())]
    Empty {
        file: PathBuf,
        /// Which data is missing.
        what: &'static str,
    },
    #[error("{}: cannot write: {why}", file.display())]
    Writing { file: PathBuf, why: String },
}

fn empty(file: &Path, what: &'static str) -> PlotError {
    PlotError::Empty { file: file.to_path_buf(), what }
}

#[cfg(test)]
mod page_tests;
#[cfg(test)]
mod tests;
