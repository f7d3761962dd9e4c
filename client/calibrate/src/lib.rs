//! Calibration without a robot: the pen's test motion, and the plane that fits touches of pen and tool.
//!
//! Contract: nothing here talks to a daemon; `foretrace calibrate` listens and moves, and calls this. What
//! would fit badly or by chance is refused. How an arm lags is found by `foretrace_sim::lag`.

#![forbid(unsafe_code)]

pub mod motion;
pub mod picture;
pub mod plane;

/// Why there is no calibration.
#[derive(thiserror::Error)]
#[error("{what}; {remedy}")]
pub struct CalibrateError {
    /// What is wrong, and where.
    pub what: String,
    /// What to do.
    pub remedy: String,
}

impl CalibrateError {
    pub(crate) fn new(what: impl std::fmt::Display, remedy: impl std::fmt::Display) -> Self {
        Self { what: what.to_string(), remedy: remedy.to_string() }
    }
}

impl std::fmt::Debug for CalibrateError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}
