//! Pictures for a page: SVG that stands inside HTML or alone in a file, in light and dark, on screen and on
//! paper.
//!
//! Contract: pure functions from data in SI units to a [`Picture`]; what is not finite is left out, and a
//! picture without data is `None`. Colours are named by what they show (pen, arm, ghost, bound) and set in
//! one place, [`STYLE`]. Titles and figures are part of the SVG (`<title>`, `<desc>`), so that text about a
//! picture can be checked against it.

mod sheet;
mod paths;
mod curves;
mod durations;
mod shares;

pub use curves::{Bound, Curve, CurvePanel, curves};
pub use durations::durations;
pub use paths::{Traced, paths};
pub use shares::{Shares, shares};
pub use sheet::{Picture, STYLE, Shown, escaped};

#[cfg(test)]
mod tests;
