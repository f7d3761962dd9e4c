//! What a page shows of a run, wherever it comes from: a demo's own records, or a recording.
//!
//! Contract: times are those of the host's clock \[s\], in order; positions are in the writing plane's frame.

use foretrace_control::plane::Plane;
use foretrace_shm::{GhostState, JOINTS, Stage, TickRecord, health};
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

/// Which ticks are among the daemon's late ones, and why: those that ended after their deadline, and those
/// before which whole periods were lost.
#[derive(Debug, Clone, Copy, Default)]
pub struct LateTicks {
    /// The last late tick, and why it was.
    last: Option<(u64, Late)>,
}

impl LateTicks {
    /// Why `record` is late, if it is; records come in the order of their ticks.
    pub fn see(&mut self, record: &TickRecord) -> Option<Late> {
        let by_cost = match record.stage(Stage::Wakeup) > record.stage(Stage::Step) {
            true => Late::Woken,
            false => Late::Worked,
        };
        let late = if record.health & health::OVERRUN != 0 {
            by_cost
        } else if record.skipped_ticks > 0 {
            // The periods that the tick before it took are not the kernel's.
            let before = self.last.filter(|(tick, _)| tick.checked_add(1) == Some(record.tick));
            before.map_or(Late::Woken, |(_, late)| late)
        } else {
            return None;
        };
        self.last = Some((record.tick, late));
        Some(late)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_shm::ArmLag;

    #[test]
    fn every_late_tick_has_its_cause_also_where_only_periods_were_lost() {
        let tick = |tick, health, skipped_ticks, [wakeup_us, step_us]: [u32; 2]| {
            let mut record = TickRecord { tick, health, skipped_ticks, ..TickRecord::default() };
            record.stage_ns[Stage::Wakeup as usize] = 1000 * wakeup_us;
            record.stage_ns[Stage::Step as usize] = 1000 * step_us;
            record
        };
        let mut late = LateTicks::default();
        let mut why = |record: TickRecord| late.see(&record);
        assert_eq!(why(tick(1, 0, 0, [100, 100])), None);
        assert_eq!(why(tick(2, 0, 1, [2500, 100])), Some(Late::Woken), "woken in the next period");
        assert_eq!(why(tick(3, health::OVERRUN, 0, [1900, 200])), Some(Late::Woken));
        assert_eq!(why(tick(4, health::OVERRUN, 0, [50, 2100])), Some(Late::Worked));
        assert_eq!(why(tick(5, 0, 2, [4110, 100])), Some(Late::Worked), "of the tick before it");
        assert_eq!(why(tick(7, 0, 1, [2100, 100])), Some(Late::Woken), "another tick lies between");
    }

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
    fn the_approach_ends_where_the_tool_is_near_and_not_before_the_arm_follows() {
        let error = |t_s: f64, error_m: f64| ErrorSample { t_s, error_m, contact: true };
        let errors = [error(0.0, 0.001), error(1.0, 0.1), error(2.0, 0.01), error(3.0, 0.5)];
        assert_eq!(approached(&errors, 0.5, 0.01), Some(&errors[2..]));
        assert_eq!(approached(&errors, 2.5, 0.01), None);
    }
}
