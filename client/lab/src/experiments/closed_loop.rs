//! Pen paths through the whole control law in simulated time: the same `Follower::step` as the daemon's.
//!
//! Contract: deterministic. Samples reach the loop at the first tick at or after their stamp, as over shared
//! memory with no delay, or later by a constant age, as over a network. The learner, if there is one, takes
//! each closed step at once, and its weights take effect at the next tick.
//! What another program predicts after a step arrives before the next tick, however long that takes.

use foretrace_control::contact::EffortUnit;
use foretrace_control::follower::{
    Budget, Follower, FollowerError, FollowerSettings, Health, NoClock, Refusal, Request, StepInput,
    StepOutput,
};
use foretrace_control::learn::Learner;
use foretrace_control::pen::PenReading;
use foretrace_control::predict::{ExternalPreview, OnlineWeights, Oracle};
use foretrace_control::stop::{StopDetail, StopReason};
use foretrace_control::units::Stamp;
use foretrace_sim::arm::JOINTS;
use foretrace_sim::metrics::ToolSample;
use foretrace_sim::path::PathSample;

use super::desk_arm::{ArmError, DeskArm, Measured, exceeds};
use super::other_program::StepPredictor;
use crate::process::ProcessError;

/// What happened in one tick, in the plane frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickTrace {
    /// The instant for which the command holds \[s\], on the path's own time axis.
    pub t_s: f64,
    /// Commanded tool \[m\].
    pub setpoint: [f64; 2],
    /// First reference of the plan \[m\]: where the pen is expected when the arm gets there.
    pub reference: [f64; 2],
    /// Commanded tool acceleration \[m/s²\].
    pub acceleration: [f64; 2],
    pub alpha: f64,
    /// A limit of plan, joints or guard shaped the command.
    pub limited: bool,
    /// The command asks a joint for more velocity or acceleration than its limit.
    pub illegal: bool,
}

#[derive(Debug, Clone, Default)]
pub struct ClosedLoop {
    /// The arm's tool, one sample a tick, on the path's time axis.
    pub tool: Vec<ToolSample>,
    /// What the law did, one entry a tick.
    pub ticks: Vec<TickTrace>,
}

/// A run that could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The settings.
    #[error(transparent)]
    Follower(#[from] FollowerError),
    /// The loop refused to take over the arm.
    #[error("the loop refuses to arm: {0:?}; check plane, home and workspace of the settings")]
    Refused(Refusal),
    /// The loop stopped the arm because it did not follow.
    #[error("the loop says that the arm does not follow: {}", evidence(.0))]
    NotFollowing(StopDetail),
    /// The arm cannot go on.
    #[error("{0}")]
    Arm(ArmError),
    /// The predictor in another program cannot go on.
    #[error(transparent)]
    Process(#[from] ProcessError),
    /// No path.
    #[error("the pen path has no samples")]
    Empty,
}

/// Where simulated time begins, so that stamps before the first sample exist.
const EPOCH_NS: u64 = 10_000_000_000;

/// Where a desk of this period [ns] begins.
pub(crate) fn epoch(period_ns: u64) -> Stamp {
    Stamp(EPOCH_NS - EPOCH_NS % period_ns)
}

/// Between two paths the pen is out of reach for this long [ns]: longer than any gap that is bridged.
pub(crate) const AWAY_NS: u64 = 700_000_000;
/// Spacing of the samples while the pen waits \[s\].
const WAIT_STEP_S: f64 = 0.005;

/// The predictor, learner and arm of a desk.
#[derive(Debug)]
pub struct DeskOptions {
    pub arm: Box<dyn DeskArm>,
    /// Know the recorded future.
    pub oracle: bool,
    pub learner: Option<Learner>,
    /// The predictor in another program, where `external` is chosen.
    pub process: Option<Box<dyn StepPredictor>>,
}

/// A loop and its arm that write one path after the other: between them only the loop's own reset for an
/// absent pen happens.
pub trait Desk {
    /// From now on pen samples are `age_ns` old when they arrive.
    fn delay_pen(&mut self, age_ns: u64);

    /// Writes `path` from beginning to end, and 0.3 s of a resting pen behind it. The pen rests above its
    /// first sample for `wait_s` \[s\] before. `requests` are made at the path times \[s\] given with them,
    /// which rise.
    ///
    /// # Errors
    /// An arm that may not be armed, an empty path.
    fn write(
        &mut self,
        path: &[PathSample],
        wait_s: f64,
        requests: &[(f64, Request)],
    ) -> Result<ClosedLoop, RunError>;
}

/// One tick of a watched desk, after it.
#[derive(Debug)]
pub struct Watched<'a> {
    /// The instant for which the command holds, on the desk's own axis, which begins when the desk does
    /// \[s\].
    pub t_s: f64,
    pub until: Stamp,
    /// What the arm had measured when the tick began.
    pub measured: &'a Measured,
    /// What the law made of it.
    pub output: &'a StepOutput<JOINTS>,
    /// Position of the tool that was measured, in the plane frame \[m\].
    pub tool: [f64; 3],
    /// The tick's command exceeds the joints' limits.
    pub illegal: bool,
}

/// Who watches a desk.
pub trait Watch {
    /// A request for the tick that begins at `t_s` \[s\] on the desk's axis.
    fn request(&mut self, t_s: f64) -> Option<Request>;

    /// Sees a tick; `false` ends the path here.
    fn see(&mut self, tick: &Watched<'_>) -> bool;
}

/// A desk of the law: a stop is seen, and ends nothing by itself.
pub trait LawDesk: Desk {
    /// As [`Desk::write`], watched; the requests are the watcher's.
    ///
    /// # Errors
    /// An arm that may not be armed or cannot go on, an empty path.
    fn write_watched(
        &mut self,
        path: &[PathSample],
        wait_s: f64,
        watch: &mut dyn Watch,
    ) -> Result<ClosedLoop, RunError>;
}

/// A desk with a horizon of 10, 20 or 30 steps.
///
/// # Errors
/// Illegal settings, an arm that cannot be reached.
pub fn desk(
    horizon: u32,
    settings: &FollowerSettings<JOINTS>,
    options: DeskOptions,
) -> Result<Box<dyn LawDesk>, RunError> {
    match horizon {
        30 => built::<30>(settings, options),
        20 => built::<20>(settings, options),
        _ => built::<10>(settings, options),
    }
}

/// In a stack frame of its own: three loops together are too large for small stacks.
#[inline(never)]
fn built<const N: usize>(
    settings: &FollowerSettings<JOINTS>,
    options: DeskOptions,
) -> Result<Box<dyn LawDesk>, RunError> {
    Ok(Box::new(LoopDesk::<N>::new(settings, options)?))
}

struct LoopDesk<const N: usize> {
    follower: Follower<N, JOINTS>,
    arm: Box<dyn DeskArm>,
    /// Unit of its efforts, if it measures them.
    effort: Option<EffortUnit>,
    /// Newest of the arm.
    measured: Measured,
    learner: Option<Learner>,
    promoted: Option<Box<OnlineWeights>>,
    process: Option<Box<dyn StepPredictor>>,
    /// It came since the last tick.
    preview: Option<ExternalPreview>,
    oracle: bool,
    armed: bool,
    now: Stamp,
    pen_age_ns: u64,
    /// Commanded last \[rad/s\].
    qd: [f64; JOINTS],
}

impl<const N: usize> LoopDesk<N> {
    fn new(settings: &FollowerSettings<JOINTS>, mut options: DeskOptions) -> Result<Self, RunError> {
        let mut settings = settings.clone();
        if let Some(learner) = &options.learner {
            settings.weights = *learner.weights();
        }
        let now = epoch(settings.period_ns);
        Ok(Self {
            now,
            follower: Follower::new(settings)?,
            effort: options.arm.facts().effort,
            measured: options.arm.begin(now).map_err(RunError::Arm)?,
            arm: options.arm,
            learner: options.learner,
            promoted: None,
            process: options.process,
            preview: None,
            oracle: options.oracle,
            armed: false,
            pen_age_ns: 0,
            qd: [0.0; JOINTS],
        })
    }

    /// One period with the pen samples `due` and at most one request.
    fn tick(&mut self, due: &[PenReading], request: Option<Request>) -> Result<StepOutput<JOINTS>, RunError> {
        let joints = self.measured.reading();
        let efforts = self.effort.map(|unit| self.measured.efforts(unit));
        let (promoted, preview) = (self.promoted.take(), self.preview.take());
        let input = StepInput {
            pen: due,
            joints: Some(&joints),
            effort: efforts.as_ref(),
            request: if self.armed { request } else { Some(Request::Arm) },
            weights: promoted.as_deref(),
            preview: preview.as_ref(),
            ..StepInput::nothing(self.now)
        };
        let output = self.follower.step(&input, Budget::default(), &mut NoClock);
        if let (false, Some(answer)) = (self.armed, output.answer) {
            answer.map_err(RunError::Refused)?;
            self.armed = true;
        }
        if let Some(learner) = &mut self.learner {
            for step in output.learn.iter().take(output.learn_count) {
                if learner.learn(step).hand_over {
                    self.promoted = Some(Box::new(*learner.weights()));
                }
            }
        }
        if let Some(process) = &mut self.process {
            for step in output.learn.iter().take(output.learn_count) {
                self.preview = process.tell(step, output.preview_steps)?.or(self.preview);
            }
        }
        self.now = self.now + self.follower.settings().period_ns;
        self.measured = self.arm.step(self.now, output.command.as_ref()).map_err(RunError::Arm)?;
        Ok(output)
    }

    /// Where the tool is that was measured, in the plane \[m\].
    fn tool(&self) -> [f64; 3] {
        let settings = self.follower.settings();
        let position = settings.chain.forward(&self.measured.q).position;
        settings.plane.point_from_base(&position).into()
    }

    /// Whether the command exceeds the joints' limits, given the one before.
    fn judge(&mut self, output: &StepOutput<JOINTS>) -> bool {
        let Some(command) = &output.command else { return false };
        let settings = self.follower.settings();
        let before = std::mem::replace(&mut self.qd, command.qd);
        exceeds(&settings.limits, &before, &command.qd, settings.period_ns as f64 * 1e-9)
    }
}

impl<const N: usize> Desk for LoopDesk<N> {
    fn delay_pen(&mut self, age_ns: u64) {
        self.pen_age_ns = age_ns;
    }

    fn write(
        &mut self,
        path: &[PathSample],
        wait_s: f64,
        requests: &[(f64, Request)],
    ) -> Result<ClosedLoop, RunError> {
        let mut strict = Strict { stopped: None };
        let run = self.follow(path, wait_s, requests, &mut strict)?;
        strict.stopped.map_or(Ok(run), |detail| Err(RunError::NotFollowing(detail)))
    }
}

/// What was observed, of which joint, and its bound.
fn evidence(detail: &StopDetail) -> String {
    let StopDetail { cause, joint, amount, limit, .. } = *detail;
    let joint = joint.map(|joint| format!(" of joint {joint}")).unwrap_or_default();
    let unit =
        Some(cause.unit()).filter(|unit| !unit.is_empty()).map(|unit| format!(" {unit}")).unwrap_or_default();
    // Some bounds are the least that is allowed.
    format!("{cause:?}{joint} is {amount:.5}{unit}, its bound {limit:.5}{unit}")
}

/// Ends where the arm does not follow.
struct Strict {
    stopped: Option<StopDetail>,
}

impl Watch for Strict {
    fn request(&mut self, _t_s: f64) -> Option<Request> {
        None
    }

    fn see(&mut self, tick: &Watched<'_>) -> bool {
        let follows = tick.output.stop_reason != StopReason::TrackingError;
        self.stopped = (!follows).then_some(tick.output.stop_detail);
        follows
    }
}

impl<const N: usize> LawDesk for LoopDesk<N> {
    fn write_watched(
        &mut self,
        path: &[PathSample],
        wait_s: f64,
        watch: &mut dyn Watch,
    ) -> Result<ClosedLoop, RunError> {
        self.follow(path, wait_s, &[], watch)
    }
}

impl<const N: usize> LoopDesk<N> {
    /// Writes a path; requests at its own times come before those of `watch`.
    fn follow(
        &mut self,
        path: &[PathSample],
        wait_s: f64,
        requests: &[(f64, Request)],
        watch: &mut dyn Watch,
    ) -> Result<ClosedLoop, RunError> {
        let (first, last) = path.first().zip(path.last()).ok_or(RunError::Empty)?;
        let mut out = ClosedLoop::default();
        let away = self.now + AWAY_NS;
        while self.armed && self.now < away {
            if !self.watched(&[], None, watch)?.2 {
                return Ok(out);
            }
        }
        let begin = self.now;
        let start_s = first.t_s - wait_s;
        let stamp_of = |t_s: f64| begin + ((t_s - start_s) * 1e9).round().max(0.0) as u64;
        let pen = feed(path, first, last, wait_s, stamp_of);
        if self.oracle {
            let future = recorded_future(&pen, self.follower.settings().pen.step_ns, &self.follower);
            self.follower.use_oracle(future);
        }
        let mut requests = requests.iter().peekable();
        let mut samples = pen.iter().peekable();
        let mut due = Vec::new();
        let end = pen.last().map_or(begin, |sample| sample.stamp) + self.pen_age_ns;
        while self.now <= end {
            due.clear();
            while let Some(sample) = samples.next_if(|sample| sample.stamp + self.pen_age_ns <= self.now) {
                due.push(*sample);
            }
            let ready = |(t_s, _): &&(f64, Request)| self.armed && stamp_of(*t_s) <= self.now;
            let request = requests.next_if(ready).map(|(_, request)| *request);
            let (output, illegal, on) = self.watched(&due, request, watch)?;
            let [x, y, _] = self.tool();
            out.record(self.now.seconds_since(begin) + start_s, &[x, y], &output, illegal);
            if !on {
                break;
            }
        }
        Ok(out)
    }

    /// Time since the desk began \[s\].
    fn since_epoch(&self) -> f64 {
        self.now.seconds_since(epoch(self.follower.settings().period_ns))
    }

    /// A tick that `watch` sees; also whether its command is illegal, and whether to go on.
    fn watched(
        &mut self,
        due: &[PenReading],
        request: Option<Request>,
        watch: &mut dyn Watch,
    ) -> Result<(StepOutput<JOINTS>, bool, bool), RunError> {
        let asked = if self.armed { watch.request(self.since_epoch()) } else { None };
        let measured = self.measured;
        let tool = self.tool();
        let output = self.tick(due, request.or(asked))?;
        let illegal = self.judge(&output);
        let t_s = self.since_epoch();
        let on =
            watch.see(&Watched { t_s, until: self.now, measured: &measured, output: &output, tool, illegal });
        Ok((output, illegal, on))
    }
}

impl ClosedLoop {
    fn record(&mut self, t_s: f64, tool: &[f64; 2], output: &StepOutput<JOINTS>, illegal: bool) {
        let [x_m, y_m] = *tool;
        self.tool.push(ToolSample { t_s, x_m, y_m });
        let [x, y, _] = &output.setpoint;
        self.ticks.push(TickTrace {
            t_s,
            setpoint: [x.position, y.position],
            reference: [output.reference[0], output.reference[1]],
            acceleration: [x.acceleration, y.acceleration],
            alpha: output.trust.alpha.alpha(),
            limited: output.axes.iter().take(2).any(|axis| axis.active.total() > 0)
                || output.health.has(Health::IK_LIMITED | Health::GUARD_ALTERED),
            illegal,
        });
    }
}

/// The pen as the loop receives it: waiting above the first sample, the path, resting at the last one.
pub(crate) fn feed(
    path: &[PathSample],
    first: &PathSample,
    last: &PathSample,
    wait_s: f64,
    stamp_of: impl Fn(f64) -> Stamp,
) -> Vec<PenReading> {
    let at = |t_s: f64, sample: &PathSample, contact: bool| {
        PenReading::new(stamp_of(t_s), [sample.x_m, sample.y_m], contact)
    };
    let waiting = (0..(wait_s / WAIT_STEP_S) as u32)
        .map(|i| at(first.t_s - wait_s + f64::from(i) * WAIT_STEP_S, first, false));
    let written = path.iter().map(|sample| at(sample.t_s, sample, sample.contact));
    let resting = (1..=60).map(|i| at(last.t_s + f64::from(i) * WAIT_STEP_S, last, last.contact));
    waiting.chain(written).chain(resting).collect()
}

/// The pen's displacements on the loop's grid, as its tracker computes them: linear between samples.
fn recorded_future<const N: usize>(
    pen: &[PenReading],
    step_ns: u64,
    follower: &Follower<N, JOINTS>,
) -> Oracle {
    let plane = follower.settings().plane;
    let first_index = pen.first().map_or(0, |sample| sample.stamp.0.div_ceil(step_ns));
    let last_index = pen.last().map_or(0, |sample| sample.stamp.0 / step_ns);
    let mut pairs = pen.windows(2).peekable();
    let mut positions = (first_index..=last_index).map(|index| {
        let t = Stamp(index * step_ns);
        while pairs.next_if(|pair| pair[1].stamp < t).is_some() {}
        pairs.peek().map_or([0.0; 2], |pair| {
            let [a, b] = [&pair[0], &pair[1]];
            let part = (t.seconds_since(a.stamp) / b.stamp.seconds_since(a.stamp)).clamp(0.0, 1.0);
            plane.from_pen([0, 1].map(|axis| a.position[axis] + part * (b.position[axis] - a.position[axis])))
        })
    });
    let mut before = positions.next().unwrap_or_default();
    let steps = positions.map(|[x, y]| {
        let [x0, y0] = before;
        before = [x, y];
        [x - x0, y - y0]
    });
    Oracle::new(first_index + 1, steps.collect())
}
