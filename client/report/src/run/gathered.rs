//! The records of a demo run: ticks, the last status, and those of arm and player.

use std::path::Path;

use foretrace_client::wire::{FaultReason, GhostState, StopDetail};
use foretrace_client::{Mode, Stage, Status, TickRecord};
use foretrace_config::{Config, JOINTS};
use foretrace_control::extent::{Extent, ExtentWatch};
use foretrace_control::plane::Plane;
use foretrace_record::page::{GhostComparison, GhostSample, Late, LateTicks, RunTraces, tool_at};
use foretrace_sim::data::load_csv;
use foretrace_sim::metrics::{ErrorSample, ToolSample};
use foretrace_sim::path::PathSample;

use super::last_words::LastWords;
use foretrace_failure::Failure;

/// Everything collected while the loop ran.
#[derive(Debug, Default)]
pub struct Gathered {
    /// Tick records since arming, thinned to what the report needs.
    pub ticks: Vec<TickNote>,
    /// Every stop that latched while the arm followed.
    pub stops: Vec<StopNote>,
    /// Where the measured tool has been.
    pub extent: Option<Extent>,
    /// How close the commands came to the joints' limits.
    pub joints: JointUse,
    /// Records that did not arrive here.
    pub ticks_lost: u64,
    /// The daemon's last status.
    pub status: Option<Status>,
    /// The pen as it was sent, in the plane frame, host's clock.
    pub pen: Vec<PathSample>,
    /// The arm's joints as they were measured: when \[s\], angles \[rad\]; host's clock.
    pub measured: Vec<(f64, [f64; JOINTS])>,
    /// Their tool, in the plane frame.
    pub tool: Vec<ToolSample>,
    /// Its height over the paper: when \[s\], how high \[m\].
    pub heights: Vec<(f64, f64)>,
    /// The last lines of the arm's process.
    pub arm_words: LastWords,
    /// The arm's own report.
    pub arm: serde_json::Value,
    /// What a bare echo pair beside the arm counted; null where none ran.
    pub echo: serde_json::Value,
    /// The player's own report.
    pub player: serde_json::Value,
}

impl Gathered {
    /// What a page shows of it; `errors`: of the part that counts.
    pub fn run(&self, errors: Vec<ErrorSample>) -> RunTraces {
        let mut run = RunTraces {
            pen: self.pen.clone(),
            joints: self.measured.clone(),
            tool: self.tool.clone(),
            heights: self.heights.clone(),
            compared: self.ticks.iter().filter_map(|tick| tick.compared).collect(),
            trust: self.ticks.iter().map(|tick| (tick.t_s, tick.trust)).collect(),
            errors,
            ..RunTraces::default()
        };
        for ghost in self.ticks.iter().filter_map(|tick| tick.ghost) {
            // The arm's lag is measured again and again, so that two commands may change their order.
            if run.ghost.last().is_none_or(|last| last.t_s < ghost.t_s) {
                run.ghost.push(ghost);
            }
        }
        run
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StopNote {
    pub fault: FaultReason,
    pub detail: StopDetail,
}

impl StopNote {
    pub fn of(fault: u32, detail: &StopDetail) -> Self {
        Self { fault: FaultReason::try_from(fault).unwrap_or(FaultReason::Internal), detail: *detail }
    }
}

#[derive(Debug, Clone, Copy)]
pub struct TickNote {
    /// When it was released \[s\].
    pub t_s: f64,
    pub stage_ns: [u32; foretrace_shm::STAGES],
    pub trust: f64,
    /// Why the tick was late, if it was.
    pub late: Option<Late>,
    pub mode: u32,
    /// Distance between the commanded tool and the ghost's, where they can be compared \[m\].
    pub ghost_apart_m: Option<f64>,
    /// Where the ghost's tool was and when, behind an arm as late as the real one; as long as they can be
    /// compared.
    pub ghost: Option<GhostSample>,
    /// Both errors at one instant.
    pub compared: Option<GhostComparison>,
}

/// Largest velocity and acceleration that commands asked of each joint, and the command before.
#[derive(Debug, Clone, Copy, Default)]
pub struct JointUse {
    pub velocity_radps: [f64; JOINTS],
    pub acceleration_radps2: [f64; JOINTS],
    /// Tick, stamp \[ns\] and velocities \[rad/s\] of the last command.
    last: Option<(u64, u64, [f64; JOINTS])>,
}

impl JointUse {
    /// Takes in a tick; accelerations only between commands that follow each other.
    pub fn see(&mut self, record: &TickRecord) {
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
    /// `lateness` has seen the records before.
    pub fn of(record: &TickRecord, lateness: &mut LateTicks) -> Self {
        let ([x, y, _], [ghost_x, ghost_y, _]) = (record.tool_m, record.ghost_tool_m);
        let comparable = record.ghost_state == u32::from(GhostState::Comparable);
        Self {
            t_s: record.release_ns as f64 * 1e-9,
            stage_ns: record.stage_ns,
            trust: record.trust,
            late: lateness.see(record),
            mode: record.mode,
            ghost_apart_m: comparable.then(|| (x - ghost_x).hypot(y - ghost_y)),
            ghost: GhostSample::of(record),
            compared: GhostComparison::of(record),
        }
    }

    pub fn stage_ns(&self, stage: Stage) -> u32 {
        self.stage_ns.get(stage as usize).copied().unwrap_or(0)
    }
}

impl Gathered {
    /// Reads what the processes left in `folder`: pen.csv and pen.json of the player, arm.csv and arm.json of
    /// the arm, and echo.json where an echo pair ran.
    ///
    /// # Errors
    ///
    /// A file is missing or malformed.
    pub fn read(&mut self, folder: &Path, config: &Config, echo: bool) -> Result<(), Failure> {
        let plane = config.follower_settings().plane;
        self.pen = pen(&folder.join("pen.csv"), &plane)?;
        self.read_arm(&folder.join("arm.csv"), config, &plane)?;
        self.arm = report(&folder.join("arm.json"))?;
        if echo {
            self.echo = report(&folder.join("echo.json"))?;
        }
        self.player = report(&folder.join("pen.json"))?;
        Ok(())
    }

    /// The arm's record, with the positions and heights of its tool in the plane frame.
    fn read_arm(&mut self, file: &Path, config: &Config, plane: &Plane) -> Result<(), Failure> {
        let wrong = |what: &dyn std::fmt::Display| unusable(file, what, "the arm left no usable record");
        let text = std::fs::read_to_string(file).map_err(|error| wrong(&error))?;
        let chain = &config.robot().chain;
        let mut extent = ExtentWatch::new(&config.follower_settings());
        for (index, line) in text.lines().enumerate().skip(1) {
            let numbers: Result<Vec<f64>, _> = line.split(',').map(str::parse).collect();
            let numbers = numbers.map_err(|error| wrong(&format_args!("line {}: {error}", index + 1)))?;
            let [t_s, q @ ..] = numbers.as_slice() else { continue };
            let q: [f64; JOINTS] =
                q.try_into().map_err(|_| wrong(&format_args!("line {}: not six joints", index + 1)))?;
            extent.see(&q);
            let (tool, height) = tool_at(*t_s, &chain.forward(&q).position, plane);
            self.measured.push((*t_s, q));
            self.tool.push(tool);
            self.heights.push(height);
        }
        self.extent = extent.extent();
        Ok(())
    }
}

fn unusable(file: &Path, what: &dyn std::fmt::Display, remedy: &str) -> Failure {
    Failure::failed(format_args!("{}: {what}", file.display()), remedy)
}

/// The player's record in the plane frame.
fn pen(file: &Path, plane: &Plane) -> Result<Vec<PathSample>, Failure> {
    let sent =
        load_csv(file).map_err(|error| Failure::failed(error, "the pen player left no usable record"))?;
    let in_plane = sent.samples.into_iter().map(|sample| {
        let [x_m, y_m] = plane.from_pen([sample.x_m, sample.y_m]);
        PathSample { x_m, y_m, ..sample }
    });
    Ok(in_plane.collect())
}

/// A child's own report.
fn report(file: &Path) -> Result<serde_json::Value, Failure> {
    let wrong = |what: &dyn std::fmt::Display| unusable(file, what, "a process of the demo left no report");
    let text = std::fs::read_to_string(file).map_err(|error| wrong(&error))?;
    serde_json::from_str(&text).map_err(|error| wrong(&error))
}
