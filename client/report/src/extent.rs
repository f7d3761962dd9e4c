//! Where a tool has been, as figures and words: the keys `envelope.*` of every report, and one line for
//! people.

use std::fmt;

use foretrace_client::wire::ToolExtent;
use foretrace_control::extent::Extent;
use serde::Serialize;

/// Extremes of the tool by forward kinematics of the measured joints; keys are stable.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ExtentFigures {
    pub height_min_m: f64,
    pub height_max_m: f64,
    pub outside_max_m: f64,
    pub tilt_max_rad: f64,
}

impl From<Extent> for ExtentFigures {
    fn from(extent: Extent) -> Self {
        let [height_min_m, height_max_m] = extent.height_m;
        Self { height_min_m, height_max_m, outside_max_m: extent.outside_m, tilt_max_rad: extent.tilt_rad }
    }
}

impl ExtentFigures {
    /// As the daemon reports it; `None`: nothing was measured yet.
    pub fn reported(extent: &ToolExtent) -> Option<Self> {
        let ToolExtent { height_min_m, height_max_m, outside_max_m, tilt_max_rad } = *extent;
        (!height_min_m.is_nan()).then_some(Self { height_min_m, height_max_m, outside_max_m, tilt_max_rad })
    }
}

impl fmt::Display for ExtentFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Adding 0 takes the minus from a zero.
        let mm = |m: f64| (m * 1e4).round() / 10.0 + 0.0;
        write!(
            f,
            "{:.1} to {:.1} mm over the paper, at most {:.1} mm outside the workspace, tilted by {:.3} rad",
            mm(self.height_min_m),
            mm(self.height_max_m),
            mm(self.outside_max_m),
            self.tilt_max_rad
        )
    }
}
