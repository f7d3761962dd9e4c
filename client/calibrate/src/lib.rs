//! Calibration: the arm's lag by a small test motion, and the plane that fits touches of pen and tool.
//!
//! Contract: the test motion enters the loop as a hovering pen, so all limits and stops of the loop hold.
//! What would fit badly or by chance is refused. How an arm lags is found by `foretrace_sim::lag`.
//!
//! In order: `motion`, `same_tool` (daemon and command mean the same arm), `listener` (what came meanwhile),
//! `lag_report`, `picture`, `lag`; `plane` is the other question.

#![forbid(unsafe_code)]

mod motion;
mod same_tool;
mod listener;
mod lag_report;
mod picture;
pub mod lag;
pub mod plane;

pub use lag_report::CalibrationReport;
pub use listener::MessageCounts;
