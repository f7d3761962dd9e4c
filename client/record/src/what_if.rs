//! What if: the hand of a recording in front of another law, behind an arm as the recording shows it.
//!
//! Contract: pen samples, their stamps, the previews of another process and the ticks are those of the
//! recording; the learner runs in step with the loop, so that results depend on no machine's speed. The arm
//! is a delay and a servo fitted to the recorded commands and joint states; how far it is from the recorded
//! arm is part of the result. Absent: the arm's own limits, late ticks, requests but the first arming.

use std::path::Path;

use foretrace_config::{Config, Draft};
use foretrace_control::follower::{
    Budget, EnableReading, FollowerSettings, JointReading, Mode, Request, StepInput,
};
use foretrace_control::learn::{LearnError, Learner};
use foretrace_control::predict::{OnlineWeights, PredictorKind};
use foretrace_control::stop::StopReason;
use foretrace_control::units::Stamp;
use foretrace_shm::JOINTS;
use foretrace_sim::lag::{LagError, LagModel, Sample, Servo, identify};
use foretrace_sim::metrics::ToolSample;
use foretrace_sim::path::PathSample;
use foretraced::wire;
use serde::Serialize;

use crate::RecordError;
use crate::law::{law, quietly};
use crate::modelled::ModelledArm;
use crate::score::{ErrorCurve, PenTrack, VariantScore};
use crate::stretch::{RecordedTick, Stretch, longest};

/// Why there is no answer.
#[derive(thiserror::Error)]
pub enum WhatIfError {
    /// The file.
    #[error(transparent)]
    File(#[from] RecordError),
    /// Settings, recorded or changed.
    #[error("{variant}: {why}")]
    Settings { variant: String, why: String },
    /// Not `key=value`.
    #[error("{text:?} is not a setting change; write KEY=VALUE, for example predictor=dybm or trust=0")]
    Change { text: String },
    /// Too little in the file.
    #[error("the recording has {what}; record an armed loop whose arm follows a pen for some seconds")]
    TooLittle { what: &'static str },
    /// The arm's answer cannot be fitted.
    #[error("the arm's answer cannot be told from the recording: {0}")]
    Arm(#[from] LagError),
    /// The law cannot be built.
    #[error("{variant}: the law cannot be built: {why}")]
    Law { variant: String, why: String },
}

foretrace_shm::debug_as_display!(WhatIfError);

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WhatIfReport {
    /// Time that was run again \[s\].
    pub seconds: f64,
    pub ticks: usize,
    /// Where and why the file ends early; `None`: it is whole.
    pub damage: Option<String>,
    /// Keys of the recorded settings that are gone, each with the reason; they have no effect here.
    pub gone: Vec<String>,
    /// Previews of another process that ticks were given and the file does not hold: the fallback serves
    /// there.
    pub previews_missing: usize,
    /// The arm that was fitted.
    pub arm: Servo,
    /// From the modelled to the recorded tool under the recorded commands, rms \[mm\].
    pub arm_misfit_mm: f64,
    /// As it was recorded; with the recorded settings behind the modelled arm; then the variants.
    pub rows: Vec<VariantScore>,
    /// For a picture, of each row.
    #[serde(skip)]
    pub curves: Vec<ErrorCurve>,
    /// Length of the stretches of time of these curves \[s\].
    #[serde(skip)]
    pub stretch_s: f64,
    /// The pen in the stroke that the tool followed worst as it was recorded.
    #[serde(skip)]
    pub stroke: Vec<PathSample>,
}

/// A variant: its name and its changes of settings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Variant {
    /// As it was written.
    pub name: String,
    changes: Vec<(String, String)>,
}

impl Variant {
    /// Reads `KEY=VALUE[,KEY=VALUE...]`; `predictor` and `trust` are short for what they mean.
    ///
    /// # Errors
    ///
    /// Not of that form.
    pub fn parse(text: &str) -> Result<Self, WhatIfError> {
        let mut changes = Vec::new();
        for pair in text.split(',') {
            let wrong = || WhatIfError::Change { text: pair.to_owned() };
            let (key, value) = pair.split_once('=').ok_or_else(wrong)?;
            let (key, value) = (key.trim(), value.trim());
            if key.is_empty() || value.is_empty() {
                return Err(wrong());
            }
            changes.push((key, value));
        }
        Ok(Self::of(text, changes))
    }

    /// The variant of this name with these changes, whose values may hold commas; the same short words as in
    /// [`Variant::parse`] are known.
    #[must_use]
    pub fn of<'a>(name: &str, pairs: impl IntoIterator<Item = (&'a str, &'a str)>) -> Self {
        let mut changes = Vec::new();
        for (key, value) in pairs {
            let mut change = |key: &str, value: &str| changes.push((key.to_owned(), value.to_owned()));
            match (key, value) {
                ("predictor", kind) => change("predictor.kind", kind),
                ("trust", "auto") => change("trust.mode", "auto"),
                ("trust", alpha) => {
                    change("trust.mode", "manual");
                    // A whole number is not a number with a point in TOML.
                    let whole = alpha.parse::<i64>().is_ok();
                    let alpha = if whole { format!("{alpha}.0") } else { alpha.to_owned() };
                    change("trust.value", &alpha);
                }
                (key, value) => change(key, value),
            }
        }
        Self { name: name.to_owned(), changes }
    }

    fn config(&self, toml: &str) -> Result<Config, WhatIfError> {
        let mut draft = Draft::recorded(toml);
        for (key, value) in &self.changes {
            draft = draft.set(key, value);
        }
        let failed = |why: String| WhatIfError::Settings { variant: self.name.clone(), why };
        draft.finish().map_err(|error| failed(error.to_string()))
    }
}

/// Runs the longest armed stretch of `path` with each of `variants`; `threads` at a time.
///
/// # Errors
///
/// See [`WhatIfError`].
pub fn what_if(path: &Path, variants: &[Variant], threads: usize) -> Result<WhatIfReport, WhatIfError> {
    let stretch = longest(path)?;
    let damage = stretch.damage.clone();
    answered(stretch, variants, threads).map_err(|error| match (error, damage) {
        (error @ (WhatIfError::TooLittle { .. } | WhatIfError::Arm(_)), Some(damage)) => {
            let (path, what) = (path.to_path_buf(), error.to_string());
            RecordError::Unread { path, what, damage }.into()
        }
        (error, _) => error,
    })
}

fn answered(stretch: Stretch, variants: &[Variant], threads: usize) -> Result<WhatIfReport, WhatIfError> {
    let Stretch { settings, ticks: life, previews_missing, damage } = stretch;
    if life.is_empty() {
        return Err(WhatIfError::TooLittle { what: "no armed loop" });
    }
    let toml = settings.ok_or(WhatIfError::TooLittle { what: "no settings of its armed loop" })?;
    let recorded = Variant { name: "recorded settings, learner cold".to_owned(), changes: Vec::new() };
    let all = std::iter::once(&recorded).chain(variants);
    // All settings are judged before the first is run.
    let jobs =
        all.map(|variant| Ok((variant, variant.config(&toml)?))).collect::<Result<Vec<_>, WhatIfError>>()?;
    if !life.iter().any(|tick| tick.preview.is_some())
        && let Some((variant, _)) =
            jobs.iter().find(|(_, config)| config.settings().predictor.kind == PredictorKind::EXTERNAL)
    {
        let why = "predictor.kind is external, and the recording holds no preview of another process: choose a \
                   built-in predictor, for example predictor=mixture";
        return Err(WhatIfError::Settings { variant: variant.name.clone(), why: why.to_owned() });
    }
    let Some((_, config)) = jobs.first() else { return Err(WhatIfError::TooLittle { what: "no settings" }) };
    let settings = config.follower_settings();
    let pen = pen_path(&life, &settings);
    let broken = || WhatIfError::TooLittle { what: "inputs that the law cannot run with" };
    let arm = quietly(|| fitted(&life)).ok_or_else(broken)??;
    let first = life.first().and_then(|tick| tick.measured);
    let start = first.ok_or(WhatIfError::TooLittle { what: "no joint state" })?.1;
    let origin_s = life.first().map_or(0.0, |tick| seconds(tick.now));

    let measured: Vec<ToolSample> = life
        .iter()
        .filter_map(|tick| Some(tool(&settings, seconds(tick.measured?.0), &tick.measured?.1)))
        .collect();
    let misfit = quietly(|| misfit_mm(&life, &settings, &arm, start)).ok_or_else(broken)?;
    let last_s = life.last().map_or(origin_s, |tick| seconds(tick.now));
    let hand = PenTrack { pen: &pen, origin_s, seconds: last_s - origin_s };
    let silent = || WhatIfError::TooLittle { what: "no pen that writes" };
    let mut rows = vec![hand.score("as recorded", &measured, None).ok_or_else(silent)?];
    let stroke = hand.worst(&measured);
    let mut curves = vec![hand.curve(&measured, stroke)];
    let mut results: Vec<Result<(VariantScore, ErrorCurve), WhatIfError>> = Vec::new();
    let (life, arm_of) = (&life, &arm);
    for batch in jobs.chunks(threads.max(1)) {
        std::thread::scope(|scope| {
            let running: Vec<_> = batch
                .iter()
                .map(|(variant, config)| {
                    // A whole law is too large for an ordinary stack.
                    std::thread::Builder::new().stack_size(32 << 20).spawn_scoped(scope, move || {
                        let run = quietly(|| run(&variant.name, config, life, arm_of, start));
                        let run = run.ok_or_else(broken)??;
                        let score = hand.score(&variant.name, &run.tool, Some(run.saturated));
                        let mut score = score.ok_or_else(silent)?;
                        score.stopped = run.stopped;
                        Ok((score, hand.curve(&run.tool, stroke)))
                    })
                })
                .collect();
            results.extend(running.into_iter().map(|thread| {
                let ended = thread.map(std::thread::ScopedJoinHandle::join);
                if let Ok(Ok(result)) = ended { result } else { Err(broken()) }
            }));
        });
    }
    for result in results {
        let (row, curve) = result?;
        rows.push(row);
        curves.push(curve);
    }
    Ok(WhatIfReport {
        seconds: hand.seconds,
        ticks: life.len(),
        damage,
        gone: config.gone(),
        previews_missing,
        arm,
        arm_misfit_mm: misfit,
        rows,
        curves,
        stretch_s: hand.stretch_s(),
        stroke: hand.during(stroke),
    })
}

fn seconds(stamp: Stamp) -> f64 {
    stamp.0 as f64 * 1e-9
}

/// The pen on the paper.
fn pen_path(life: &[RecordedTick], settings: &FollowerSettings<JOINTS>) -> Vec<PathSample> {
    let mut path: Vec<PathSample> = Vec::new();
    for reading in life.iter().flat_map(|tick| &tick.pen) {
        let [x_m, y_m] = settings.plane.from_pen(reading.position);
        let sample = PathSample { t_s: seconds(reading.stamp), x_m, y_m, contact: reading.contact };
        if x_m.is_finite() && y_m.is_finite() && path.last().is_none_or(|last| sample.t_s > last.t_s) {
            path.push(sample);
        }
    }
    path
}

/// The arm's answer to its commands, at the joint states' stamps.
fn fitted(life: &[RecordedTick]) -> Result<Servo, WhatIfError> {
    let of = |pair: Option<(Stamp, [f64; JOINTS])>| pair.map(|(stamp, q)| Sample { t_s: seconds(stamp), q });
    let commands: Vec<_> =
        life.iter().filter_map(|tick| of(tick.command.map(|command| (command.stamp, command.q)))).collect();
    let states: Vec<_> = life.iter().filter_map(|tick| of(tick.measured)).collect();
    let found = identify(&commands, &states)?;
    Ok(match found.verdict {
        LagModel::Servo => found.servo,
        LagModel::PureDelay => Servo {
            delay_s: found.shift.delay_s,
            filter_s: 0.0,
            joint_loop_s: 0.0,
            rms_rad: found.shift.rms_rad,
        },
    })
}

fn tool(settings: &FollowerSettings<JOINTS>, t_s: f64, q: &[f64; JOINTS]) -> ToolSample {
    let at = settings.plane.point_from_base(&settings.chain.forward(q).position);
    ToolSample { t_s, x_m: at.x, y_m: at.y }
}

/// Distance of the modelled from the recorded tool, both under the recorded commands \[mm\].
fn misfit_mm(
    life: &[RecordedTick],
    settings: &FollowerSettings<JOINTS>,
    arm: &Servo,
    start: [f64; JOINTS],
) -> f64 {
    let begin = life.first().map_or(Stamp(0), |tick| tick.now);
    let mut modelled = ModelledArm::new(arm, settings.period_ns, start, begin);
    let (mut sum, mut count) = (0.0, 0_u32);
    for tick in life {
        modelled.move_to(tick.now);
        // Joint states are a little older than the release; both motions are smooth.
        if let Some((_, q)) =
            tick.measured.filter(|(stamp, _)| stamp.since(tick.now).unsigned_abs() < 4_000_000)
        {
            let (real, model) = (tool(settings, 0.0, &q), tool(settings, 0.0, &modelled.joints.q));
            sum += (real.x_m - model.x_m).powi(2) + (real.y_m - model.y_m).powi(2);
            count += 1;
        }
        modelled.command = tick.command.or(modelled.command);
    }
    1e3 * (sum / f64::from(count.max(1))).sqrt()
}

/// What a run leaves.
struct Lived {
    tool: Vec<ToolSample>,
    saturated: f64,
    stopped: Option<String>,
}

fn run(
    name: &str,
    config: &Config,
    life: &[RecordedTick],
    arm: &Servo,
    start: [f64; JOINTS],
) -> Result<Lived, WhatIfError> {
    let failed = |why: String| WhatIfError::Law { variant: name.to_owned(), why };
    let settings = config.follower_settings();
    let mut law =
        law(settings.clone(), config.settings().mpc.horizon).map_err(|error| failed(error.to_string()))?;
    let learner = Learner::new(config.learner_settings(), config.models());
    let mut learner = learner.map_err(|error: LearnError| failed(error.to_string()))?;
    let learns = config.settings().learner.enabled;
    let begin = life.first().map_or(Stamp(0), |tick| tick.now);
    let mut arm = ModelledArm::new(arm, settings.period_ns, start, begin);
    let mut fresh: Option<Box<OnlineWeights>> = None;
    let mut lived = Lived { tool: Vec::with_capacity(life.len()), saturated: 0.0, stopped: None };
    let (mut limited, mut planned, mut armed, mut refused) = (0_u32, 0_u32, false, None);
    let origin = life.first().map_or(Stamp(0), |tick| tick.now);
    for tick in life {
        let now = tick.now;
        arm.move_to(now);
        let reading = JointReading { stamp: now, q: arm.joints.q, qd: arm.joints.qd, motion_allowed: true };
        let weights = fresh.take();
        let input = StepInput {
            pen: &tick.pen,
            joints: Some(&reading),
            enable: Some(EnableReading { stamp: now, stop: false }),
            // Until it is accepted: the arm has to stand for a moment first.
            request: (!armed).then_some(Request::Arm),
            weights: weights.as_deref(),
            preview: tick.preview.as_ref(),
            ..StepInput::nothing(now)
        };
        let output = law.tick(&input, Budget::default());
        armed |= output.mode != Mode::Idle;
        refused = output.answer.and_then(Result::err).or(refused);
        if output.stop_reason != StopReason::None && armed && lived.stopped.is_none() {
            let at_s = now.since(origin) as f64 * 1e-9;
            let reason = wire::fault(output.stop_reason);
            lived.stopped = Some(format!("after {at_s:.1} s: {reason}"));
        }
        for step in output.learn.iter().take(output.learn_count).filter(|_| learns) {
            if learner.learn(step).hand_over {
                fresh = Some(Box::new(*learner.weights()));
            }
        }
        if output.mode == Mode::Following {
            planned += 1;
            limited += u32::from(output.axes.iter().any(|axis| axis.active.total() > 0));
        }
        arm.command = output.command.or(arm.command);
        lived.tool.push(tool(&settings, seconds(now), &arm.joints.q));
    }
    if let (false, Some(refusal)) = (armed, refused) {
        let (_, why) = wire::refusal(refusal);
        lived.stopped = Some(format!("never armed: {why}"));
    }
    lived.saturated = f64::from(limited) / f64::from(planned.max(1));
    Ok(lived)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_words_mean_settings_and_nonsense_is_refused() {
        let variant = Variant::parse("predictor=dybm, trust=0,mpc.velocity_lead_ms=20").unwrap();
        let changes: Vec<_> = variant.changes.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
        assert_eq!(
            changes,
            [
                ("predictor.kind", "dybm"),
                ("trust.mode", "manual"),
                ("trust.value", "0.0"),
                ("mpc.velocity_lead_ms", "20"),
            ]
        );
        for wrong in ["", "trust", "=1", "a=", "a=1,,b=2"] {
            assert!(matches!(Variant::parse(wrong), Err(WhatIfError::Change { .. })), "{wrong}");
        }
    }
}
