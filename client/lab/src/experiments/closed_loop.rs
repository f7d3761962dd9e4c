//! One pen path through the whole control law in simulated time: the same `Follower::step` as the daemon's.
//!
//! Contract: deterministic. Samples reach the loop at the first tick at or after their stamp, as over shared memory with
//! no delay. The learner, if there is one, takes each closed step at once, and its weights go live at the next tick.

use foretrace_control::follower::{
    Budget, Follower, FollowerError, FollowerSettings, Health, JointCommand, JointReading, NoClock, Refusal,
    Request, StepInput, StepOutput,
};
use foretrace_control::learn::Learner;
use foretrace_control::pen::PenReading;
use foretrace_control::predict::Oracle;
use foretrace_control::units::Stamp;

use std::collections::VecDeque;

use crate::arm::{ArmModel, ArmSettings, JOINTS};
use crate::metrics::ToolSample;
use crate::path::PathSample;

/// The arm at the other end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArmKind {
    /// Is where the command says, without delay.
    Ideal,
    /// Is where the command said this long ago [s]; no limits.
    Delayed(f64),
    /// A simulated UR5 behind its servo.
    Ur5(ArmSettings),
}

/// What happened in one tick, in the plane frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickTrace {
    /// The instant for which the command holds [s], on the path's own time axis.
    pub t_s: f64,
    /// Commanded tool [m].
    pub setpoint: [f64; 2],
    /// Commanded tool acceleration [m/s²].
    pub acceleration: [f64; 2],
    /// Trust.
    pub alpha: f64,
    /// A limit of plan, joints or guard shaped the command.
    pub limited: bool,
}

/// One run.
#[derive(Debug, Clone, Default)]
pub struct ClosedLoop {
    /// The arm's tool, one sample a tick, on the path's time axis.
    pub tool: Vec<ToolSample>,
    /// What the law did, one entry a tick.
    pub ticks: Vec<TickTrace>,
}

/// How to run a path.
#[derive(Debug)]
pub struct RunOptions<'a> {
    /// The arm.
    pub arm: ArmKind,
    /// Know the recorded future.
    pub oracle: bool,
    /// Learns on along the way; carries over from run to run.
    pub learner: Option<&'a mut Learner>,
    /// Requests and the path times [s] at which they are made, in order of time.
    pub requests: &'a [(f64, Request)],
    /// The pen rests above its first sample for this long before the path begins [s].
    pub wait_s: f64,
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
    /// No path.
    #[error("the pen path has no samples")]
    Empty,
}

/// Where simulated time begins, so that stamps before the first sample exist.
const EPOCH_NS: u64 = 10_000_000_000;
/// Spacing of the samples while the pen waits [s].
const WAIT_STEP_S: f64 = 0.005;

/// As [`run`], with the horizon `horizon` of the settings: 10, 20 or 30 steps.
///
/// *Errors*: see [`run`].
pub fn run_with(
    horizon: u32,
    settings: &FollowerSettings<JOINTS>,
    home: [f64; JOINTS],
    path: &[PathSample],
    options: RunOptions<'_>,
) -> Result<ClosedLoop, RunError> {
    match horizon {
        30 => run::<30>(settings, home, path, options),
        20 => run::<20>(settings, home, path, options),
        _ => run::<10>(settings, home, path, options),
    }
}

/// Runs `path` from beginning to end, and 0.3 s of a resting pen behind it.
///
/// *Errors*: illegal settings, an arm that may not be armed, an empty path.
pub fn run<const N: usize>(
    settings: &FollowerSettings<JOINTS>,
    home: [f64; JOINTS],
    path: &[PathSample],
    options: RunOptions<'_>,
) -> Result<ClosedLoop, RunError> {
    let (first, last) = path.first().zip(path.last()).ok_or(RunError::Empty)?;
    let period_ns = settings.period_ns;
    let start_s = first.t_s - options.wait_s;
    let stamp_of = |t_s: f64| Stamp(EPOCH_NS + ((t_s - start_s) * 1e9).round().max(0.0) as u64);
    let path_time = |stamp: Stamp| stamp.seconds_since(Stamp(EPOCH_NS)) + start_s;
    let pen = feed(path, first, last, options.wait_s, stamp_of);

    let mut settings = settings.clone();
    let mut learner = options.learner;
    if let Some(learner) = &learner {
        settings.weights = *learner.weights();
    }
    let mut follower = Follower::<N, JOINTS>::new(settings)?;
    if options.oracle {
        follower.use_oracle(recorded_future(&pen, follower.settings().pen.step_ns, &follower));
    }
    let mut arm = Arm::new(options.arm, home);
    let mut out = ClosedLoop::default();
    let mut pending = options.requests.iter().peekable();
    let mut promoted = None;
    let mut samples = pen.iter().peekable();
    let mut due = Vec::new();
    let end = pen.last().map_or(Stamp(EPOCH_NS), |sample| sample.stamp);
    let mut now = Stamp(EPOCH_NS - EPOCH_NS % period_ns);
    let mut armed = false;
    while now <= end {
        due.clear();
        while let Some(sample) = samples.next_if(|sample| sample.stamp <= now) {
            due.push(*sample);
        }
        let request = if armed {
            pending.next_if(|(t_s, _)| stamp_of(*t_s) <= now).map(|(_, request)| *request)
        } else {
            Some(Request::Arm)
        };
        let joints = arm.reading(now);
        let input = StepInput {
            now,
            pen: &due,
            joints: Some(&joints),
            enable: None,
            request,
            weights: promoted.as_ref(),
        };
        let output = follower.step(&input, Budget::default(), &mut NoClock);
        promoted = None;
        if let (false, Some(answer)) = (armed, output.answer) {
            answer.map_err(RunError::Refused)?;
            armed = true;
        }
        if let Some(learner) = &mut learner {
            for step in output.learn.iter().take(output.learn_count) {
                if learner.learn(step).hand_over {
                    promoted = Some(*learner.weights());
                }
            }
        }
        now = now + period_ns;
        arm.obey(&output);
        out.record(path_time(now), &arm.tool(&follower), &output);
    }
    Ok(out)
}

impl ClosedLoop {
    fn record(&mut self, t_s: f64, tool: &[f64; 2], output: &StepOutput<JOINTS>) {
        let [x_m, y_m] = *tool;
        self.tool.push(ToolSample { t_s, x_m, y_m });
        let [x, y, _] = &output.setpoint;
        self.ticks.push(TickTrace {
            t_s,
            setpoint: [x.position, y.position],
            acceleration: [x.acceleration, y.acceleration],
            alpha: output.trust.alpha.alpha(),
            limited: output.axes.iter().take(2).any(|axis| axis.active.total() > 0)
                || output.health.has(Health::IK_LIMITED | Health::GUARD_ALTERED),
        });
    }
}

/// The pen as the loop hears it: waiting above the first sample, the path, resting at the last one.
fn feed(
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

/// The pen's displacements on the loop's own grid, as its tracker will see them: linear between samples.
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

/// Either arm, as the loop sees it.
struct Arm {
    q: [f64; JOINTS],
    qd: [f64; JOINTS],
    servo: Option<ArmModel>,
    /// Delay [s] and the commands that are on their way, oldest first.
    delay: Option<(f64, VecDeque<JointCommand<JOINTS>>)>,
}

impl Arm {
    fn new(kind: ArmKind, home: [f64; JOINTS]) -> Self {
        let servo = match kind {
            ArmKind::Ideal | ArmKind::Delayed(_) => None,
            ArmKind::Ur5(settings) => Some(ArmModel::at_rest(settings, home)),
        };
        let delay = match kind {
            ArmKind::Delayed(delay_s) => Some((delay_s, VecDeque::new())),
            _ => None,
        };
        Self { q: home, qd: [0.0; JOINTS], servo, delay }
    }

    fn reading(&self, stamp: Stamp) -> JointReading<JOINTS> {
        JointReading { stamp, q: self.q, qd: self.qd, motion_allowed: true }
    }

    /// Lives through one period with the command made at its beginning.
    fn obey(&mut self, output: &StepOutput<JOINTS>) {
        let Some(command) = &output.command else { return };
        if let Some((delay_s, underway)) = &mut self.delay {
            underway.push_back(*command);
            // The command that ends at or after the instant which the arm has reached holds for it, as a line.
            let reached = |c: &JointCommand<JOINTS>| command.stamp.seconds_since(c.stamp) - *delay_s;
            while underway.len() > 1 && underway.front().is_some_and(|c| reached(c) > 1e-9) {
                underway.pop_front();
            }
            if let Some(due) =
                underway.front().filter(|c| command.stamp.seconds_since(c.stamp) > *delay_s - 1e-9)
            {
                (self.q, self.qd) = (due.q, due.qd);
            }
            return;
        }
        match &mut self.servo {
            None => (self.q, self.qd) = (command.q, command.qd),
            Some(servo) => {
                // The controller follows the command's line; at the beginning of its cycle that is one period back.
                let cycle_s = servo.settings().cycle_s;
                let mut target = command.q;
                for (q, qd) in target.iter_mut().zip(&command.qd) {
                    *q -= qd * cycle_s;
                }
                let joints = servo.cycle(target);
                (self.q, self.qd) = (joints.q, joints.qd);
            }
        }
    }

    fn tool<const N: usize>(&self, follower: &Follower<N, JOINTS>) -> [f64; 2] {
        let settings = follower.settings();
        let tool = settings.plane.point_from_base(&settings.chain.forward(&self.q).position);
        [tool.x, tool.y]
    }
}
