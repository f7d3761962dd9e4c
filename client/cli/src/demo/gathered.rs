//! The records of a demo run: ticks, the last status, and those of arm and player.

use std::path::Path;

use foretrace_client::{FaultReason, GhostState, Mode, Stage, Status, StopDetail, TickRecord};
use foretrace_config::{Config, JOINTS};
use foretrace_control::extent::{Extent, ExtentWatch};
use foretrace_control::plane::Plane;
use foretrace_record::page::{Compared, GhostSample, Run, tool_at};
use foretrace_sim::data::load_csv;
use foretrace_sim::metrics::{ErrorSample, ToolSample};
use foretrace_sim::path::PathSample;

use super::children::LastWords;
use crate::failure::Failure;

/// Everything collected while the loop ran.
#[derive(Debug, Default)]
pub(crate) struct Gathered {
    /// Tick records since arming, thinned to what the report needs.
    pub(crate) ticks: Vec<TickNote>,
    /// Every stop that latched while the arm followed.
    pub(crate) stops: Vec<StopNote>,
    /// Where the measured tool has been.
    pub(crate) extent: Option<Extent>,
    /// How close the commands came to the joints' limits.
    pub(crate) joints: JointUse,
    /// Records that did not arrive here.
    pub(crate) ticks_lost: u64,
    /// The daemon's last status.
    pub(crate) status: Option<Status>,
    /// The pen as it was sent, in the plane frame, host's clock.
    pub(crate) pen: Vec<PathSample>,
    /// The arm's joints as they were measured: when [s], angles [rad]; host's clock.
    pub(crate) measured: Vec<(f64, [f64; JOINTS])>,
    /// Their tool, in the plane frame.
    pub(crate) tool: Vec<ToolSample>,
    /// Its height over the paper: when [s], how high [m].
    pub(crate) heights: Vec<(f64, f64)>,
    /// What the arm's process said last.
    pub(crate) arm_said: LastWords,
    /// The arm's own report.
    pub(crate) arm: serde_json::Value,
    /// What a bare echo pair beside the arm counted; null where none ran.
    pub(crate) echo: serde_json::Value,
    /// The player's own report.
    pub(crate) player: serde_json::Value,
}

impl Gathered {
    /// What a page shows of it; `errors`: of the part that counts.
    pub(crate) fn run(&self, errors: Vec<ErrorSample>) -> Run {
        let mut run = Run {
            pen: self.pen.clone(),
            joints: self.measured.clone(),
            tool: self.tool.clone(),
            heights: self.heights.clone(),
            compared: self.ticks.iter().filter_map(|tick| tick.compared).collect(),
            trust: self.ticks.iter().map(|tick| (tick.t_s, tick.trust)).collect(),
            errors,
            ..Run::default()
        };
        for ghost in self.ticks.iter().filter_map(|tick| tick.ghost) {
            // The arm's lag is measured anew again and again, so that two commands may change places.
            if run.ghost.last().is_none_or(|last| last.t_s < ghost.t_s) {
                run.ghost.push(ghost);
            }
        }
        run
    }
}

/// One latched stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StopNote {
    pub(crate) fault: FaultReason,
    pub(crate) detail: StopDetail,
}

impl StopNote {
    pub(crate) fn of(fault: u32, detail: &StopDetail) -> Self {
        Self { fault: FaultReason::try_from(fault).unwrap_or(FaultReason::Internal), detail: *detail }
    }
}

/// One tick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TickNote {
    /// When it was released [s].
    pub(crate) t_s: f64,
    pub(crate) stage_ns: [u32; foretrace_shm::STAGES],
    pub(crate) trust: f64,
    pub(crate) health: u32,
    pub(crate) mode: u32,
    /// Distance between the commanded tool and the ghost's, where they can be compared [m].
    pub(crate) ghost_apart_m: Option<f64>,
    /// Where the ghost's tool was and when, behind an arm as late as the real one; as long as they can be
    /// compared.
    pub(crate) ghost: Option<GhostSample>,
    /// Both errors at one instant.
    pub(crate) compared: Option<Compared>,
}

/// Largest velocity and acceleration that commands asked of each joint, and the command before.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct JointUse {
    pub(crate) velocity_radps: [f64; JOINTS],
    pub(crate) acceleration_radps2: [f64; JOINTS],
    /// Tick, stamp [ns] and velocities [rad/s] of the last command.
    last: Option<(u64, u64, [f64; JOINTS])>,
}

impl JointUse {
    /// Takes in a tick; accelerations only between commands that follow each other.
    pub(crate) fn see(&mut self, record: &TickRecord) {
        let commanded = matches!(
            Mode::try_from(record.mode),
            Ok(Mode::Armed | Mode::Following | Mode::Holding | Mode::Stopped | Mode::Fault)
        );
        if !commanded {
            self.last = None;
            return;
        }
        let now = (record.tick, record.command_stamp_ns, record.qd);
        let before = self.last.replace(now).filter(|last| last.0 + 1 == now.0 && last.1 < now.1);
        for (most, speed) in self.velocity_radps.iter_mut().zip(now.2) {
            *most = most.max(speed.abs());
        }
        let Some((_, stamp, qd)) = before else { return };
        let elapsed_s = (now.1 - stamp) as f64 * 1e-9;
        for (most, (new, old)) in self.acceleration_radps2.iter_mut().zip(now.2.iter().zip(qd)) {
            *most = most.max((new - old).abs() / elapsed_s);
        }
    }
}

impl TickNote {
    pub(crate) fn of(record: &TickRecord) -> Self {
        let ([x, y, _], [ghost_x, ghost_y, _]) = (record.tool_m, record.ghost_tool_m);
        let comparable = record.ghost_state == u32::from(GhostState::Comparable);
        Self {
            t_s: record.release_ns as f64 * 1e-9,
            stage_ns: record.stage_ns,
            trust: record.trust,
            health: record.health,
            mode: record.mode,
            ghost_apart_m: comparable.then(|| (x - ghost_x).hypot(y - ghost_y)),
            ghost: GhostSample::of(record),
            compared: Compared::of(record),
        }
    }

    pub(crate) fn stage_ns(&self, stage: Stage) -> u32 {
        self.stage_ns.get(stage as usize).copied().unwrap_or(0)
    }
}

/// The player's record in the plane frame.
pub(crate) fn pen(file: &Path, plane: &Plane) -> Result<Vec<PathSample>, Failure> {
    let sent =
        load_csv(file).map_err(|error| Failure::failed(error, "the pen player left no usable record"))?;
    let placed = sent.samples.into_iter().map(|sample| {
        let [x_m, y_m] = plane.from_pen([sample.x_m, sample.y_m]);
        PathSample { x_m, y_m, ..sample }
    });
    Ok(placed.collect())
}

/// The arm's record, as `Gathered` has it.
#[derive(Debug, Default)]
pub(crate) struct Arm {
    pub(crate) measured: Vec<(f64, [f64; JOINTS])>,
    pub(crate) tool: Vec<ToolSample>,
    pub(crate) heights: Vec<(f64, f64)>,
    pub(crate) extent: Option<Extent>,
}

/// The arm's record, with the positions and heights of its tool in the plane frame.
pub(crate) fn arm(file: &Path, config: &Config, plane: &Plane) -> Result<Arm, Failure> {
    let wrong = |what: &dyn std::fmt::Display| {
        Failure::failed(format_args!("{}: {what}", file.display()), "the arm left no usable record")
    };
    let text = std::fs::read_to_string(file).map_err(|error| wrong(&error))?;
    let chain = &config.robot().chain;
    let mut arm = Arm::default();
    let mut extent = ExtentWatch::new(&config.follower_settings());
    for (index, line) in text.lines().enumerate().skip(1) {
        let numbers: Result<Vec<f64>, _> = line.split(',').map(str::parse).collect();
        let numbers = numbers.map_err(|error| wrong(&format_args!("line {}: {error}", index + 1)))?;
        let [t_s, q @ ..] = numbers.as_slice() else { continue };
        let q: [f64; JOINTS] =
            q.try_into().map_err(|_| wrong(&format_args!("line {}: not six joints", index + 1)))?;
        extent.see(&q);
        let (tool, height) = tool_at(*t_s, &chain.forward(&q).position, plane);
        arm.measured.push((*t_s, q));
        arm.tool.push(tool);
        arm.heights.push(height);
    }
    arm.extent = extent.extent();
    Ok(arm)
}

/// A child's own report.
pub(crate) fn report(file: &Path) -> Result<serde_json::Value, Failure> {
    let wrong = |what: &dyn std::fmt::Display| {
        Failure::failed(format_args!("{}: {what}", file.display()), "a process of the demo left no report")
    };
    let text = std::fs::read_to_string(file).map_err(|error| wrong(&error))?;
    serde_json::from_str(&text).map_err(|error| wrong(&error))
}
