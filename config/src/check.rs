//! Constraints between keys: contradictions between values that are legal alone.
//!
//! Contract: every number here is finite, because the reader refuses non-finite ones.

use std::path::Path;

use foretrace_control::estimate::refine::RefinePrior;
use foretrace_control::pen::STEP_QUEUE_CAPACITY;
use foretrace_control::predict::models::dybm::MAX_TRACES;
use foretrace_control::predict::{MAX_PREVIEW, Models};

use crate::files::Files;
use crate::follower::judge;
use crate::layers::NodesByKey;
use crate::predictor::{models, prior};
use crate::problem::{Problem, ProblemKind, ValueFlaw};
use crate::robot::{Robot, robot};
use crate::settings::{Optimiser, Settings};
use crate::written::SettingOrigin;

/// Longest `instance.root_dir` \[bytes\]: what the sockets of the middleware leave of their 108 bytes.
pub const LONGEST_ROOT_BYTES: usize = 38;

/// Pushes every contradiction in `settings`; `found` tells where each value was written. Returns the robot,
/// the models and the start of refinement that the settings describe, unless a contradiction is about them.
pub(crate) fn check(
    settings: &Settings,
    found: &NodesByKey,
    whole: &SettingOrigin,
    problems: &mut Vec<Problem>,
    files: &Files,
) -> Option<(Robot, Models, RefinePrior)> {
    let mut report = Findings { found, whole, problems, files };
    time(settings, &mut report);
    plane(settings, &mut report);
    ranges(settings, &mut report);
    predictor(settings, &mut report);
    process(settings, &mut report);
    // An inconsistent plane cannot be checked for reach.
    if report.problems.iter().any(|problem| problem.key().is_some_and(|key| key.starts_with("plane."))) {
        return None;
    }
    let (robot, models) = (robot(settings, &mut report), models(settings, &mut report));
    let prior = prior(settings, &mut report);
    let (robot, models, prior) = (robot?, models?, prior?);
    if report.problems.is_empty()
        && let Err(refused) = judge(settings, &robot, &models, &prior)
    {
        report.problems.push(Problem::new(whole, ProblemKind::Refused(refused.to_string())));
        return None;
    }
    Some((robot, models, prior))
}

/// Knows where each key was written, and where the files are that values name.
pub(crate) struct Findings<'a> {
    pub(crate) found: &'a NodesByKey,
    pub(crate) whole: &'a SettingOrigin,
    pub(crate) problems: &'a mut Vec<Problem>,
    pub(crate) files: &'a Files,
}

impl Findings<'_> {
    /// Reports that `key` contradicts something.
    pub(crate) fn conflict(&mut self, key: &str, conflict: impl Into<String>, remedy: impl Into<String>) {
        let flaw = ValueFlaw::Conflict { conflict: conflict.into(), remedy: remedy.into() };
        self.problems.push(match self.found.get(key) {
            Some(node) => node.flawed(key, flaw),
            None => {
                let (key, value) = (key.to_owned(), "(not set)".to_owned());
                Problem::new(self.whole, ProblemKind::Value { key, value, flaw })
            }
        });
    }
}

fn time(s: &Settings, report: &mut Findings<'_>) {
    let period_us = 1_000_000 / s.control_loop.rate_hz.max(1);
    let step_us = s.pen.step_ms * 1000;
    if !step_us.is_multiple_of(period_us) {
        let fitting: Vec<String> =
            (4..=20u32).filter(|ms| (ms * 1000).is_multiple_of(period_us)).map(|ms| ms.to_string()).collect();
        report.conflict(
            "pen.step_ms",
            format!(
                "is not a multiple of the period {} ms (loop.rate_hz = {})",
                f64::from(period_us) / 1e3,
                s.control_loop.rate_hz
            ),
            format!("use {} ms, or another rate", fitting.join(", ")),
        );
    }
    let (period_ms, step_ms) = (f64::from(period_us) * 1e-3, f64::from(s.pen.step_ms));
    if let Some(plan_ms) = s.mpc.step_ms.filter(|ms| !(period_ms..=step_ms.max(period_ms)).contains(ms)) {
        report.conflict(
            "mpc.step_ms",
            format!("= {plan_ms} is not between the loop's period and pen.step_ms"),
            format!("use {period_ms} to {step_ms} ms, or leave it out"),
        );
    }
    if s.control_loop.spin_us * 2 > period_us {
        report.conflict(
            "loop.spin_us",
            format!("spins more than half of the period {period_us} us"),
            "lower it, or lower loop.rate_hz",
        );
    }
    let most_steps = STEP_QUEUE_CAPACITY as f64 / 2.0;
    let gap_steps = s.pen.max_gap_ms / f64::from(s.pen.step_ms);
    if !(2.0..=most_steps).contains(&gap_steps) {
        report.conflict(
            "pen.max_gap_ms",
            format!(
                "is {gap_steps:.1} grid steps (pen.step_ms = {}), legal are 2 to {most_steps}",
                s.pen.step_ms
            ),
            format!("use {} to {} ms", 2 * s.pen.step_ms, most_steps * f64::from(s.pen.step_ms)),
        );
    }
    if s.timing.servo_filter_ms > s.timing.dead_time_ms {
        report.conflict(
            "timing.servo_filter_ms",
            format!("is more than timing.dead_time_ms = {}, of which it is a part", s.timing.dead_time_ms),
            "dead_time_ms is the whole time from command to motion, the servo's filter included: raise it, \
             or lower the part",
        );
    }
    let step_ms = f64::from(s.pen.step_ms);
    let (mut dead_time, mut dead_time_ms) = ("dead_time_ms", s.timing.dead_time_ms);
    if let Some(max_ms) = s.timing.dead_time_max_ms.filter(|_| s.timing.follow_lag) {
        if max_ms < s.timing.dead_time_ms {
            report.conflict(
                "timing.dead_time_max_ms",
                format!(
                    "= {max_ms} is below timing.dead_time_ms = {}, where it starts",
                    s.timing.dead_time_ms
                ),
                "raise it, leave it out, or set timing.follow_lag = false",
            );
        }
        (dead_time, dead_time_ms) = ("dead_time_max_ms", max_ms);
    }
    let plan_ms = s.plan_step_s() * 1e3 * f64::from(s.mpc.horizon);
    let ahead_ms = dead_time_ms + s.mpc.response_ms + s.pen.stale_ms + step_ms + plan_ms;
    let needed = (ahead_ms / step_ms).ceil() as usize + 1;
    if needed > MAX_PREVIEW {
        report.conflict(
            "mpc.horizon",
            format!(
                "with timing.{dead_time} = {dead_time_ms} and pen.stale_ms = {} needs {needed} predicted \
                 steps; there is room for {MAX_PREVIEW}",
                s.pen.stale_ms
            ),
            "shorten one of the three, or lengthen pen.step_ms",
        );
    }
    if s.pen.stale_ms < s.pen.max_gap_ms {
        report.conflict(
            "pen.stale_ms",
            format!("is shorter than the longest bridged gap (pen.max_gap_ms = {})", s.pen.max_gap_ms),
            "a bridged gap would stop the arm; make it at least as long",
        );
    }
    let controller_ms = 1e3 / f64::from(s.robot.controller_rate_hz.max(1));
    if s.safety.joint_state_timeout_ms < 2.0 * controller_ms {
        report.conflict(
            "safety.joint_state_timeout_ms",
            format!("is shorter than two cycles of the robot's controller ({controller_ms} ms each)"),
            format!("use at least {} ms", (2.0 * controller_ms).ceil()),
        );
    }
    let valid_ms = f64::from(s.control_loop.valid_periods) * f64::from(period_us) / 1e3;
    if s.safety.latch_after_ms < valid_ms {
        report.conflict(
            "safety.latch_after_ms",
            format!(
                "is shorter than the time a command stays valid ({valid_ms} ms, loop.valid_periods periods)"
            ),
            "a short hiccup would latch a stop; make it longer",
        );
    }
}

fn plane(s: &Settings, report: &mut Findings<'_>) {
    /// A calibration with three touches is good to about this much; beyond it, something was mistyped.
    const TOLERANCE: f64 = 1e-2;
    let dot = |a: &[f64; 3], b: &[f64; 3]| -> f64 { a.iter().zip(b).map(|(x, y)| x * y).sum() };
    for (key, vector) in [("plane.x_axis", &s.plane.x_axis), ("plane.normal", &s.plane.normal)] {
        let length = dot(vector, vector).sqrt();
        if (length - 1.0).abs() > TOLERANCE {
            report.conflict(
                key,
                format!("has length {length:.4} instead of 1"),
                if length > 1e-6 {
                    let [x, y, z] = vector.map(|c| c / length);
                    format!("write the direction with length 1: [{x:.6}, {y:.6}, {z:.6}]")
                } else {
                    "write a direction".to_owned()
                },
            );
        }
    }
    let cosine = dot(&s.plane.x_axis, &s.plane.normal);
    if cosine.abs() > TOLERANCE {
        report.conflict(
            "plane.x_axis",
            format!(
                "is not at right angles to plane.normal (their product is {cosine:.4}, allowed {TOLERANCE})"
            ),
            "x_axis lies in the paper, normal stands on it: calibrate again",
        );
    }
    let [_, _, z] = s.plane.workspace_m;
    for (key, height) in [("plane.workspace_m", 0.0), ("plane.lift_height_m", s.plane.lift_height_m)] {
        let [low, high] = z;
        if !(low..=high).contains(&height) {
            report.conflict(
                key,
                format!("leaves the height {height} m outside the workspace's z range {low} to {high} m"),
                "the z range has to hold contact (0) and plane.lift_height_m",
            );
        }
    }
    let ([low, _], press) = (z, s.plane.press_m);
    if low <= 0.0 && !(-press >= low) {
        /// Room below the pressing depth for what the tip sinks in fast strokes.
        const ROOM_M: f64 = 5e-4;
        report.conflict(
            "plane.press_m",
            format!("presses the tip {press} m below the paper, but plane.workspace_m ends {} m below it", -low),
            format!(
                "press less, or let the workspace's z range begin at {:.4} m: so deep may the pen's spring be \
                 pushed in",
                -press - ROOM_M
            ),
        );
    }
}

fn ranges(s: &Settings, report: &mut Findings<'_>) {
    /// What the plan needs to tell one wall from the other.
    const NARROWEST_M: f64 = 1e-3;
    let workspace =
        ["x", "y", "z"].into_iter().zip(s.plane.workspace_m).map(|range| ("plane.workspace_m", range));
    let bounds = ["x", "y"].into_iter().zip(s.pen.bounds_m).map(|range| ("pen.bounds_m", range));
    for (key, (axis, [low, high])) in workspace.chain(bounds) {
        if high - low < NARROWEST_M {
            report.conflict(
                key,
                format!("has an {axis} range that is empty or narrower than 1 mm, {low} to {high} m"),
                "write [low, high], far enough apart",
            );
        }
    }
}

fn predictor(s: &Settings, report: &mut Findings<'_>) {
    let dybm = &s.predictor.dybm;
    if dybm.decays.len() > MAX_TRACES {
        report.conflict(
            "predictor.dybm.decays",
            format!("has {} entries; there is room for {MAX_TRACES} traces", dybm.decays.len()),
            "drop the ones that are closest to each other",
        );
    }
    if dybm.optimiser != Optimiser::Adagrad && dybm.rate > 0.05 {
        report.conflict(
            "predictor.dybm.rate",
            format!("is far too fast for {}, whose steps do not shrink with time", dybm.optimiser.word()),
            "use 0.001, or optimiser = \"adagrad\" with 0.1",
        );
    }
    let scale = &s.predictor.scale;
    if !(scale.min_m..=scale.max_m).contains(&scale.initial_m) {
        report.conflict(
            "predictor.scale.initial_m",
            format!("is not between min_m = {:e} and max_m = {:e}", scale.min_m, scale.max_m),
            "keep min_m <= initial_m <= max_m",
        );
    }
}

fn process(s: &Settings, report: &mut Findings<'_>) {
    if let Some(root) = &s.instance.root_dir
        && (!Path::new(root).is_absolute() || root.len() > LONGEST_ROOT_BYTES)
    {
        report.conflict(
            "instance.root_dir",
            format!("is not an absolute path of at most {LONGEST_ROOT_BYTES} bytes ({} bytes)", root.len()),
            "use a short path such as /run/foretrace-1, or leave the key out",
        );
    }
    if let Some(gain_hz) = s.ik.gain_hz
        && gain_hz > f64::from(s.control_loop.rate_hz)
    {
        report.conflict(
            "ik.gain_hz",
            format!("is above the rate of the loop ({} Hz)", s.control_loop.rate_hz),
            "the correction would overshoot; leave the key out or halve the rate of the loop",
        );
    }
}
