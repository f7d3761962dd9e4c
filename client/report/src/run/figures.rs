//! The numbers of a demo run.
//!
//! Contract: keys are stable, and each quantity has one of them, in one unit. Tracking is scored from the
//! first instant at which the tool is as near to the pen as the loop demands before it lowers it
//! (safety.approach_distance_m): what comes before is the approach to the paper.

use foretrace_client::{Mode, Stage};
use foretrace_config::{Config, JOINTS, Settings};
use foretrace_control::arm::limits::JointLimits;
use foretrace_record::page::{Late, approached};
use foretrace_sim::metrics::{ErrorSample, ToolSample, TrackingErrors, error_series, tracking};
use serde::Serialize;
use serde_json::Value;

use super::gathered::{Gathered, JointUse, StopNote};
use crate::extent::ExtentFigures;
use crate::ghost::Comparison;
use foretrace_failure::Failure;
use foretrace_sim::spread::{DurationHistogram, Quantiles};

/// The result of a demo.
#[derive(Debug, Serialize)]
pub struct RunFigures {
    #[serde(rename = "loop")]
    pub control_loop: LoopFigures,
    /// None where the arm never came near a pen that wrote.
    pub tracking: Option<TrackingFigures>,
    /// Where the tool was, by forward kinematics of the measured joints; none where nothing was measured.
    pub envelope: Option<ExtentFigures>,
    pub ghost: GhostSummary,
    /// As the arm counted and judged them; how fast they were is in `joints`.
    pub commands: Value,
    /// Largest value that commands asked of each joint over its limit, base first; 1: at the limit.
    pub joints: JointFigures,
    pub pen: PenFigures,
    pub learner: LearnerFigures,
    pub trust: TrustFigures,
    pub arm: Value,
    /// A bare echo pair beside the bridge to a controller: what line and machine alone do to counters; null
    /// with another arm.
    pub echo: Value,
    pub setting: SettingFigures,
}

#[derive(Debug, Serialize)]
pub struct LoopFigures {
    pub rate_hz: f64,
    pub ticks: u64,
    pub overruns: u64,
    /// Of these, since arming: ticks that the kernel woke late, which took longer than their work.
    pub overruns_by_wakeup: u64,
    /// Of these, since arming: the others, whose own work took long.
    pub overruns_by_work: u64,
    pub skipped_ticks: u64,
    pub allocations_per_tick: f64,
    pub connection_allocations: u64,
    /// From the start of the tick to the command published.
    pub step_us: Quantiles,
    /// From the planned start of the tick to its real one.
    pub wakeup_us: Quantiles,
    pub missing_rights: Vec<&'static str>,
    pub telemetry_lost: u64,
    /// Every stop that latched while the arm followed.
    pub stops: Vec<StopFigures>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StopFigures {
    /// Label of the reason; stable.
    pub reason: &'static str,
    /// After arming \[s\].
    pub at_s: f64,
    /// The evidence in words; empty without evidence.
    pub detail: String,
}

impl StopFigures {
    fn of(note: &StopNote, armed_s: f64) -> Self {
        let fault = note.fault;
        Self {
            reason: fault.label(),
            at_s: note.detail.at_ns as f64 * 1e-9 - armed_s,
            detail: note.detail.to_string(),
        }
    }

    pub fn words(&self) -> String {
        if self.detail.is_empty() {
            self.reason.to_owned()
        } else {
            format!("{}: {}", self.reason, self.detail)
        }
    }
}

/// The tool against the pen while it wrote, and its ghost's at the same instants.
#[derive(Debug, Serialize)]
pub struct TrackingFigures {
    /// "daemon": while the loop ran, wherever the ghost could be compared. "records": from those of arm and
    /// player, after the approach, where there was no ghost.
    pub measured_by: &'static str,
    pub rms_m: f64,
    pub max_m: Option<f64>,
    pub lag_ms: Option<f64>,
    pub ghost_rms_m: Option<f64>,
    pub ghost_max_m: Option<f64>,
    pub ghost_lag_ms: Option<f64>,
    /// Hovering included.
    pub hover_rms_m: Option<f64>,
    pub ghost_hover_rms_m: Option<f64>,
    /// How much larger that distance is by the records than by the daemon, as a share of the latter.
    pub records_rms_apart: Option<f64>,
    /// How much longer the lag is by the records than by the daemon.
    pub records_lag_apart_ms: Option<f64>,
}

impl TrackingFigures {
    fn of(score: &TrackingErrors, gathered: &Gathered, comparison: &Comparison) -> Self {
        let session = &comparison.session;
        let written = || gathered.ticks.iter().filter_map(|tick| tick.compared).filter(|note| note.contact);
        let live = Self {
            measured_by: "daemon",
            rms_m: session.rms_m.unwrap_or(score.rmse_m),
            max_m: written().map(|note| note.error_m).reduce(f64::max),
            lag_ms: session.lag_ms,
            ghost_rms_m: session.ghost_rms_m,
            ghost_max_m: written().map(|note| note.ghost_error_m).reduce(f64::max),
            ghost_lag_ms: session.ghost_lag_ms,
            hover_rms_m: comparison.hover_rms_m,
            ghost_hover_rms_m: comparison.ghost_hover_rms_m,
            records_rms_apart: session.rms_m.map(|live_m| score.rmse_m / live_m - 1.0),
            records_lag_apart_ms: session.lag_ms.map(|live_ms| score.lag_ms - live_ms),
        };
        if session.rms_m.is_some() {
            return live;
        }
        Self {
            measured_by: "records",
            rms_m: score.rmse_m,
            max_m: Some(score.max_m),
            lag_ms: Some(score.lag_ms),
            ..live
        }
    }
}

/// The ghost, the loop at trust 0: how well it could be compared, and what it cost.
#[derive(Debug, Serialize)]
pub struct GhostSummary {
    /// Whether it was compared at the end.
    pub state: &'static str,
    /// How long the pen wrote while it was compared.
    pub compared_s: f64,
    /// Share of the ticks in which the loop followed.
    pub compared_share: f64,
    /// Largest distance between the commanded tool and the ghost's while both were compared; 0 at trust 0.
    pub apart_max_m: Option<f64>,
    /// Median cost per tick on the thread that publishes.
    pub cost_us: Option<f64>,
}

#[derive(Debug, Serialize)]
pub struct JointFigures {
    pub velocity_share: [f64; JOINTS],
    pub acceleration_share: [f64; JOINTS],
}

impl JointFigures {
    fn of(used: &JointUse, limits: &JointLimits<JOINTS>) -> Self {
        let share = |used: &[f64; JOINTS], limit: &[f64; JOINTS]| {
            let mut shares = *used;
            shares.iter_mut().zip(limit).for_each(|(share, limit)| *share /= limit);
            shares
        };
        Self {
            velocity_share: share(&used.velocity_radps, limits.velocity()),
            acceleration_share: share(&used.acceleration_radps2, limits.acceleration()),
        }
    }
}

#[derive(Debug, Serialize)]
pub struct PenFigures {
    pub samples: u64,
    pub rejected: u64,
    pub dropped: u64,
    pub gaps: u64,
    pub unheard: u64,
}

#[derive(Debug, Serialize)]
pub struct LearnerFigures {
    pub updates: u64,
    pub promotions: u64,
    pub rollbacks: u64,
    pub refused: u64,
}

#[derive(Debug, Serialize)]
pub struct TrustFigures {
    pub mean: f64,
    pub last: f64,
}

/// What the run was.
#[derive(Debug, Serialize)]
pub struct SettingFigures {
    pub pen: String,
    pub predictor: &'static str,
    pub seconds: f64,
    pub settings: String,
    pub optimised_build: bool,
}

/// The part of a run that counts, for the pictures.
#[derive(Debug)]
pub struct ScoredPart {
    pub tool: Vec<ToolSample>,
    pub errors: Vec<ErrorSample>,
}

/// The tool from the first instant at which it had come as near to the pen as the loop wants it before
/// lowering it.
///
/// `None`: it never did.
pub(super) fn scored(gathered: &Gathered, settings: &Settings) -> Option<ScoredPart> {
    let near = settings.safety.approach_distance_m;
    let following = gathered.ticks.iter().find(|tick| tick.mode == u32::from(Mode::Following));
    let from_s = following.map(|tick| tick.t_s).unwrap_or(f64::INFINITY);
    let errors = error_series(&gathered.pen, &gathered.tool);
    let errors = approached(&errors, from_s, near)?;
    let first_s = errors.first().map_or(f64::INFINITY, |error| error.t_s);
    let tool = gathered.tool.iter().filter(|sample| sample.t_s >= first_s).copied().collect();
    Some(ScoredPart { tool, errors: errors.to_vec() })
}

/// Recomputes the derived figures.
pub(super) fn figures(
    gathered: &Gathered,
    scored: Option<&ScoredPart>,
    config: &Config,
    setting: SettingFigures,
) -> Result<RunFigures, Failure> {
    let status = gathered
        .status
        .ok_or_else(|| Failure::failed("the daemon reported no status", "look at its messages above"))?;
    let counts = &status.counters;
    let score = scored.and_then(|scored| tracking(&gathered.pen, &scored.tool));
    let armed_s = gathered.ticks.first().map_or(0.0, |tick| tick.t_s);
    let spread = |stage: Stage| {
        let mut spread = DurationHistogram::default();
        gathered.ticks.iter().for_each(|tick| spread.add_ns(u64::from(tick.stage_ns(stage))));
        spread.quantiles()
    };
    let (step_us, wakeup_us) = (spread(Stage::Step), spread(Stage::Wakeup));
    let late = |cause: Late| gathered.ticks.iter().filter(|tick| tick.late == Some(cause)).count() as u64;
    let comparison = Comparison::of(&status);
    let trusts = gathered.ticks.iter().filter(|tick| tick.mode == u32::from(Mode::Following));
    let (sum, count) = trusts.fold((0.0, 0_u32), |(sum, count), tick| (sum + tick.trust, count + 1));
    let number = |value: &Value, key: &str| value.get(key).and_then(Value::as_u64).unwrap_or(0);
    Ok(RunFigures {
        control_loop: LoopFigures {
            rate_hz: status.rate_hz,
            ticks: counts.ticks,
            overruns: counts.overruns,
            overruns_by_wakeup: late(Late::Woken),
            overruns_by_work: late(Late::Worked),
            skipped_ticks: counts.skipped_ticks,
            allocations_per_tick: status.allocations_per_tick,
            connection_allocations: counts.connection_allocations,
            step_us,
            wakeup_us,
            missing_rights: foretrace_client::wire::missing_rights::labels(status.missing_rights).collect(),
            telemetry_lost: gathered.ticks_lost + counts.telemetry_ring_dropped,
            stops: gathered.stops.iter().map(|stop| StopFigures::of(stop, armed_s)).collect(),
        },
        tracking: score.map(|score| TrackingFigures::of(&score, gathered, &comparison)),
        envelope: gathered.extent.map(ExtentFigures::from),
        ghost: ghost(gathered, &comparison),
        commands: commands(&gathered.arm),
        joints: JointFigures::of(&gathered.joints, &config.robot().limits),
        pen: PenFigures {
            samples: number(&gathered.player, "samples"),
            rejected: counts.pen_rejected.total() + counts.pen_out_of_order + counts.pen_outliers,
            dropped: counts.pen_dropped,
            gaps: counts.pen_gaps,
            unheard: number(&gathered.player, "unheard"),
        },
        learner: LearnerFigures {
            updates: status.learner_updates,
            promotions: status.learner_promotions,
            rollbacks: status.learner_rollbacks,
            refused: status.learner_refused,
        },
        trust: TrustFigures { mean: sum / f64::from(count.max(1)), last: status.trust },
        arm: gathered.arm.get("arm").cloned().unwrap_or(Value::Null),
        echo: gathered.echo.clone(),
        setting,
    })
}

/// What the arm counted, without its largest velocity and acceleration: `joints` has those, per joint.
fn commands(arm: &Value) -> Value {
    let mut commands = arm.get("commands").cloned().unwrap_or(Value::Null);
    if let Some(counts) = commands.as_object_mut() {
        counts.retain(|key, _| !key.starts_with("max_"));
    }
    commands
}

/// What the daemon reports about its ghost, and how far apart the two were.
fn ghost(gathered: &Gathered, comparison: &Comparison) -> GhostSummary {
    let following = gathered.ticks.iter().filter(|tick| tick.mode == u32::from(Mode::Following));
    let (mut followed, mut compared, mut apart_m) = (0_u64, 0_u64, None);
    for tick in following {
        followed += 1;
        if let Some(distance) = tick.ghost_apart_m {
            compared += 1;
            apart_m = Some(distance.max(apart_m.unwrap_or(0.0)));
        }
    }
    GhostSummary {
        state: comparison.state,
        compared_s: comparison.compared_s,
        compared_share: compared as f64 / followed.max(1) as f64,
        apart_max_m: apart_m,
        cost_us: comparison.cost_us,
    }
}

impl RunFigures {
    /// Late ticks that have no record since arming: they came before it, or their record was lost.
    pub const fn overruns_unexplained(&self) -> u64 {
        let looped = &self.control_loop;
        looped.overruns.saturating_sub(looped.overruns_by_wakeup + looped.overruns_by_work)
    }

    /// The largest share of a joint's limit that any command asked for.
    pub fn largest_share(of: &[f64; JOINTS]) -> f64 {
        of.iter().copied().fold(0.0, f64::max)
    }

    /// Commands that broke a limit, as the arm counted.
    pub fn limit_violations(&self) -> u64 {
        self.commands.get("limit_violations").and_then(Value::as_u64).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::gathered::TickNote;
    use super::*;
    use foretrace_sim::path::PathSample;

    /// The pen stands still at 0; the tool comes from 100 mm away at 0.1 m/s and stays from t = 1 s on.
    fn run() -> Gathered {
        let pen =
            (0..400).map(|k| PathSample { t_s: f64::from(k) * 0.005, x_m: 0.0, y_m: 0.0, contact: true });
        let tool = (0..1000).map(|k| {
            let t_s = f64::from(k) * 0.002;
            ToolSample { t_s, x_m: (0.1 - 0.1 * t_s).max(0.0), y_m: 0.0 }
        });
        let tick = TickNote {
            t_s: 0.1,
            stage_ns: [1000; foretrace_shm::STAGES],
            trust: 1.0,
            late: None,
            mode: Mode::Following.into(),
            ghost_apart_m: None,
            ghost: None,
            compared: None,
        };
        Gathered { pen: pen.collect(), tool: tool.collect(), ticks: vec![tick], ..Gathered::default() }
    }

    #[test]
    fn the_way_to_the_paper_is_not_scored() {
        let config = foretrace_config::Config::preset("ur5").unwrap();
        let near = config.settings().safety.approach_distance_m;
        let scored = scored(&run(), config.settings()).unwrap();
        assert!((scored.errors[0].error_m - near).abs() < 3e-4, "{:?}", scored.errors[0]);
        assert!(scored.errors.iter().all(|error| error.error_m <= near));
        assert_eq!(scored.tool[0].t_s, scored.errors[0].t_s);
    }

    #[test]
    fn an_arm_that_never_comes_near_is_not_scored() {
        let config = foretrace_config::Config::preset("ur5").unwrap();
        let mut gathered = run();
        gathered.tool.iter_mut().for_each(|sample| sample.y_m = 0.05);
        assert!(scored(&gathered, config.settings()).is_none());
        gathered.ticks.clear();
        assert!(scored(&gathered, config.settings()).is_none());
    }
}
