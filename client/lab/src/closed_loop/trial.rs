//! One method of the law in front of one arm, tick by tick: for arms of others, and for stops.
//!
//! Contract: the same desk, settings and scores as in the benchmark, so that an arm that answers as a
//! built-in one gives its figures bit for bit. A stop does not fail the trial: it is reported, with its
//! cause, what was written until then is scored, and the trial ends when the arm has been at rest for a
//! while.

use std::sync::{Mutex, PoisonError};

use foretrace_config::Config;
use foretrace_control::follower::{Mode, Request, StepOutput};
use foretrace_control::predict::PredictorKind;
use foretrace_control::stop::{StopDetail, StopReason};
use foretrace_sim::arm::JOINTS;
use foretrace_sim::path::PenPath;
use serde::Serialize;

use super::arm::FREE_GAIN;
use super::{BenchArm, Hand, Sequence, SequenceScore};
use crate::experiments::{
    ClosedLoop, DeskArm, DeskOptions, LawEntrant, RunError, WAIT_S, Watch, Watched, desk, learner_for,
    settings_for,
};
use crate::parallel;

/// Commands slower than this stand still \[rad/s\].
const REST_RADPS: f64 = 1e-9;

#[derive(Debug)]
pub struct Trial<'a> {
    pub config: &'a Config,
    /// The arm whose letters and limits these are; one with limits, where the arm is of others.
    pub like: BenchArm,
    pub law: LawEntrant,
    /// What is written, in order.
    pub hand: &'a Hand,
    /// Ask for a stop so long after the trial began \[s\].
    pub stop_at_s: Option<f64>,
    /// After a stop, go on for so long \[s\].
    pub after_stop_s: f64,
}

/// A stop that was seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SeenStop {
    /// When it latched, since the trial began \[s\].
    pub t_s: f64,
    /// Index of the sequence that was being written, from 0.
    pub sequence: usize,
    /// Why, as `StopReason` has it.
    #[serde(serialize_with = "debug")]
    pub reason: StopReason,
    #[serde(flatten, serialize_with = "detail")]
    pub detail: StopDetail,
    /// From then until the commands stood still \[s\]; absent where they never did.
    pub rest_after_s: Option<f64>,
}

/// How a trial went.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tried {
    /// Per sequence that was begun.
    pub scores: Vec<Option<SequenceScore>>,
    pub stop: Option<SeenStop>,
    /// How long it was \[s\].
    pub seconds: f64,
    /// Ticks whose command exceeds a joint's limit, the way back to rest included.
    pub illegal: u32,
}

/// Why a trial could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrialError {
    /// The settings.
    #[error("{0}")]
    Settings(String),
    /// The run.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl Trial<'_> {
    /// Writes the hand's sequences with `arm`; `see` hears every tick, with the index of its sequence.
    ///
    /// # Errors
    /// Illegal settings, an arm that cannot be armed or cannot go on.
    pub fn run(
        &self,
        arm: Box<dyn DeskArm>,
        see: &mut (dyn FnMut(usize, &Watched<'_>) + Send),
    ) -> Result<Tried, TrialError> {
        // On a worker's stack: a whole control law may be too large for the caller's.
        let job = Mutex::new(Some((arm, see)));
        let work = |job: &Mutex<Option<_>>| {
            let taken = job.lock().unwrap_or_else(PoisonError::into_inner).take();
            taken.map(|(arm, see)| self.write(arm, see))
        };
        let tried = parallel::map(&[job], work, || {}).into_iter().flatten().next();
        tried.unwrap_or_else(|| Err(TrialError::Settings("no thread could be started".to_owned())))
    }

    fn write(
        &self,
        arm: Box<dyn DeskArm>,
        see: &mut (dyn FnMut(usize, &Watched<'_>) + Send),
    ) -> Result<Tried, TrialError> {
        let wrong = |error: &dyn std::fmt::Display| TrialError::Settings(error.to_string());
        let kind = self.law.predictor();
        let mut settings = settings_for(self.config, &arm.facts(), kind);
        settings.trust_request = self.law.trust();
        self.like.fit(self.config, &mut settings);
        self.like.sharpen(&mut settings, FREE_GAIN);
        let learner = learner_for(self.config, &settings, kind).map_err(|error| wrong(&error))?;
        let options = DeskOptions { arm, oracle: kind == PredictorKind::ORACLE, learner, process: None };
        let mut desk = desk(self.config.settings().mpc.horizon, &settings, options)?;
        let mut observer = Observer {
            asked: self.stop_at_s,
            after_stop_s: self.after_stop_s,
            sequence: 0,
            stop: None,
            t_s: 0.0,
            illegal: 0,
            see,
        };
        let mut scores = Vec::new();
        for (index, sequence) in self.hand.sequences.iter().enumerate() {
            observer.sequence = index;
            let run = desk.write_watched(&sequence.path.samples, WAIT_S, &mut observer)?;
            let Some(stop) = observer.stop else {
                scores.push(SequenceScore::of(sequence, &run));
                continue;
            };
            // Instants of the trial and of the path end together.
            let to_path_s = run.ticks.last().map_or(0.0, |tick| tick.t_s) - observer.t_s;
            scores.push(until(sequence, &run, stop.t_s + to_path_s));
            break;
        }
        let Observer { stop, t_s, illegal, .. } = observer;
        Ok(Tried { scores, stop, seconds: t_s, illegal })
    }
}

/// The score of what was written before `end_s` \[s\] on the path's axis.
fn until(sequence: &Sequence, run: &ClosedLoop, end_s: f64) -> Option<SequenceScore> {
    let count = sequence.path.samples.iter().take_while(|sample| sample.t_s < end_s).count();
    let samples = sequence.path.samples[..count].to_vec();
    let path = PenPath { samples, ..sequence.path.clone() };
    let behind_leap = sequence.behind_leap[..count].to_vec();
    SequenceScore::of(&Sequence { label: sequence.label.clone(), path, behind_leap }, run)
}

/// Asks for the stop, and sees stops.
struct Observer<'a> {
    asked: Option<f64>,
    after_stop_s: f64,
    sequence: usize,
    stop: Option<SeenStop>,
    t_s: f64,
    illegal: u32,
    see: &'a mut (dyn FnMut(usize, &Watched<'_>) + Send),
}

impl Watch for Observer<'_> {
    fn request(&mut self, t_s: f64) -> Option<Request> {
        self.asked.take_if(|at_s| *at_s <= t_s).map(|_| Request::Stop)
    }

    fn see(&mut self, tick: &Watched<'_>) -> bool {
        (self.see)(self.sequence, tick);
        self.t_s = tick.t_s;
        self.illegal += u32::from(tick.illegal);
        if self.stop.is_none() && stopped(tick.output) {
            let (reason, detail) = (tick.output.stop_reason, tick.output.stop_detail);
            let sequence = self.sequence;
            self.stop = Some(SeenStop { t_s: tick.t_s, sequence, reason, detail, rest_after_s: None });
        }
        let Some(stop) = &mut self.stop else { return true };
        if stop.rest_after_s.is_none() && rests(tick.output) {
            stop.rest_after_s = Some(tick.t_s - stop.t_s);
        }
        // A stop that never comes to rest is reported as such, 5 s later.
        tick.t_s - stop.t_s < self.after_stop_s + if stop.rest_after_s.is_some() { 0.0 } else { 5.0 }
    }
}

fn stopped(output: &StepOutput<JOINTS>) -> bool {
    output.stop_reason != StopReason::None && matches!(output.mode, Mode::Stopped | Mode::Fault)
}

fn rests(output: &StepOutput<JOINTS>) -> bool {
    output.command.as_ref().is_none_or(|command| command.qd.iter().all(|qd| qd.abs() < REST_RADPS))
}

fn debug<S: serde::Serializer>(value: &impl std::fmt::Debug, out: S) -> Result<S::Ok, S::Error> {
    out.collect_str(&format_args!("{value:?}"))
}

fn detail<S: serde::Serializer>(detail: &StopDetail, out: S) -> Result<S::Ok, S::Error> {
    use serde::ser::SerializeMap as _;
    let mut map = out.serialize_map(Some(4))?;
    map.serialize_entry("cause", &format!("{:?}", detail.cause))?;
    map.serialize_entry("joint", &detail.joint)?;
    map.serialize_entry("amount", &detail.amount)?;
    map.serialize_entry("limit", &detail.limit)?;
    map.end()
}
