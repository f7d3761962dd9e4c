//! What a page shows of a run, wherever it comes from: a demo's own records, or a recording.
//!
//! Contract: times are those of the host's clock \[s\], in order; positions are in the writing plane's frame.

use foretrace_control::plane::Plane;
use foretrace_shm::{GhostState, JOINTS, Stage, TickRecord};
use foretrace_sim::metrics::{ErrorSample, ToolSample};
use foretrace_sim::path::PathSample;

#[derive(Debug, Clone, Default, PartialEq)]
pub struct RunTraces {
    pub pen: Vec<PathSample>,
    /// When \[s\], and the measured joints \[rad\].
    pub joints: Vec<(f64, [f64; JOINTS])>,
    /// The tool of these joints.
    pub tool: Vec<ToolSample>,
    /// Its height over the paper: when \[s\], how high \[m\].
    pub heights: Vec<(f64, f64)>,
    /// The tool of the same loop without prediction; empty without a ghost.
    pub ghost: Vec<GhostSample>,
    /// How far both were from the pen; empty without a ghost.
    pub compared: Vec<GhostComparison>,
    /// When \[s\], and the trust.
    pub trust: Vec<(f64, f64)>,
    /// How far the tool was from the pen since it first came near it: what came before is the approach.
    pub errors: Vec<ErrorSample>,
}

/// Where the ghost's tool was behind an arm as late as the real one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GhostSample {
    /// \[s\]
    pub t_s: f64,
    /// \[m\]
    pub at_m: [f64; 3],
}

impl GhostSample {
    /// As long as it can be compared with the arm.
    #[must_use]
    pub fn of(record: &TickRecord) -> Option<Self> {
        let comparable = record.ghost_state == u32::from(GhostState::Comparable);
        let lag = &record.arm_lag;
        let late_s = if lag.is_known() { lag.shift_s } else { lag.dead_time_ns as f64 * 1e-9 };
        let t_s = record.command_stamp_ns as f64 * 1e-9 + late_s;
        let known = t_s.is_finite() && record.ghost_tool_m.iter().all(|m| m.is_finite());
        (comparable && known).then_some(Self { t_s, at_m: record.ghost_tool_m })
    }

    #[must_use]
    pub const fn tool(&self) -> ToolSample {
        let [x_m, y_m, _] = self.at_m;
        ToolSample { t_s: self.t_s, x_m, y_m }
    }
}

/// How far the tool and its ghost were from the pen at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GhostComparison {
    /// \[s\]
    pub t_s: f64,
    /// \[m\]
    pub error_m: f64,
    /// \[m\]
    pub ghost_error_m: f64,
    pub contact: bool,
}

impl GhostComparison {
    /// What `record` says of the instant a tenth of a second before it.
    #[must_use]
    pub fn of(record: &TickRecord) -> Option<Self> {
        let judged = record.compared_ns > 0 && record.error_m >= 0.0 && record.ghost_error_m >= 0.0;
        judged.then_some(Self {
            t_s: record.compared_ns as f64 * 1e-9,
            error_m: record.error_m,
            ghost_error_m: record.ghost_error_m,
            contact: record.compared_contact == 1,
        })
    }
}

/// Where the tool is: in the plane, and how high over it \[m\].
#[must_use]
pub fn tool_at(t_s: f64, position: &nalgebra::Vector3<f64>, plane: &Plane) -> (ToolSample, (f64, f64)) {
    let at = plane.point_from_base(position);
    (ToolSample { t_s, x_m: at.x, y_m: at.y }, (t_s, at.z))
}

/// `errors` from the first instant at or after `from_s` at which the tool was no farther from the pen than
/// `near_m`; `None`: it never was.
#[must_use]
pub fn approached(errors: &[ErrorSample], from_s: f64, near_m: f64) -> Option<&[ErrorSample]> {
    let begin = errors.iter().position(|error| error.t_s >= from_s && error.error_m <= near_m)?;
    errors.get(begin..)
}

/// Why a tick that ended too late did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Late {
    /// The kernel woke it late: that took longer than its work.
    Woken,
    /// Its own work took the longer part.
    Worked,
}

impl Late {
    /// By the stages' costs \[ns\].
    #[must_use]
    pub fn of(wakeup_ns: u32, step_ns: u32) -> Self {
        if wakeup_ns > step_ns { Self::Woken } else { Self::Worked }
    }

    /// Of `record`.
    #[must_use]
    pub fn of_tick(record: &TickRecord) -> Self {
        Self::of(record.stage(Stage::Wakeup), record.stage(Stage::Step))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_shm::ArmLag;

    #[test]
    fn a_ghost_that_cannot_be_compared_or_is_nowhere_is_none() {
        let mut record = TickRecord {
            ghost_state: GhostState::Comparable.into(),
            command_stamp_ns: 2_000_000_000,
            ghost_tool_m: [0.1, 0.2, 0.003],
            ..TickRecord::default()
        };
        record.arm_lag = ArmLag::unknown(50_000_000);
        let ghost = GhostSample::of(&record).unwrap();
        assert!((ghost.t_s - 2.05).abs() < 1e-12 && ghost.at_m == [0.1, 0.2, 0.003], "{ghost:?}");
        record.ghost_tool_m[2] = f64::NAN;
        assert_eq!(GhostSample::of(&record), None);
        record.ghost_tool_m[2] = 0.0;
        record.ghost_state = GhostState::Settling.into();
        assert_eq!(GhostSample::of(&record), None);
    }

    #[test]
    fn a_late_tick_is_put_down_to_what_took_longer() {
        assert_eq!(Late::of(1_900_000, 200_000), Late::Woken);
        assert_eq!(Late::of(50_000, 2_100_000), Late::Worked);
    }

    #[test]
    fn the_approach_ends_where_the_tool_is_near_and_not_before_the_arm_follows() {
        let error = |t_s: f64, error_m: f64| ErrorSample { t_s, error_m, contact: true };
        let errors = [error(0.0, 0.001), error(1.0, 0.1), error(2.0, 0.01), error(3.0, 0.5)];
        assert_eq!(approached(&errors, 0.5, 0.01), Some(&errors[2..]));
        assert_eq!(approached(&errors, 2.5, 0.01), None);
    }
}
