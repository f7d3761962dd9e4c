//! What the bench times: every tick of a closed loop on handwriting, and the problems that occurred in it.
//!
//! Contract: recorded once by the exact path with a perfect arm, from stamps alone, so that the same settings
//! and path give the same workload. The MPC problems start from the loop's own commanded states and follow
//! the recorded pen.

use foretrace_config::Config;
use foretrace_control::arm::JointMotion;
use foretrace_control::follower::{Budget, Follower, JointReading, Mode, NoClock, Request, StepInput};
use foretrace_control::ik::ToolTarget;
use foretrace_control::pen::{PenReading, PenTracker};
use foretrace_control::plane::Plane;
use foretrace_control::units::{AxisState, Stamp};
use foretrace_sim::path::{PathSample, PenPath};
use nalgebra::Vector3;

use foretrace_failure::Failure;

/// Joints of the arm.
pub(crate) const J: usize = 6;

/// The loop starts here, so that ages before it exist.
const BEGIN_NS: u64 = 10_000_000_000;

/// The inputs of one tick.
#[derive(Debug, Clone)]
pub(crate) struct WorkloadTick {
    pub(crate) now: Stamp,
    pub(crate) pen: Vec<PenReading>,
    pub(crate) joints: JointReading<J>,
    pub(crate) request: Option<Request>,
    /// The arm followed the pen in this tick.
    pub(crate) following: bool,
}

impl WorkloadTick {
    pub(crate) fn input(&self) -> StepInput<'_, J> {
        StepInput {
            pen: &self.pen,
            joints: Some(&self.joints),
            request: self.request,
            ..StepInput::nothing(self.now)
        }
    }

    /// Gives its pen to `tracker`, in the plane frame.
    pub(crate) fn ingest(&self, tracker: &mut PenTracker, plane: &Plane) {
        for reading in &self.pen {
            let position = plane.from_pen(reading.position);
            tracker.ingest(self.now, &PenReading { position, ..*reading });
        }
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Planning<const N: usize> {
    pub(crate) start: [AxisState; 3],
    pub(crate) held: [AxisState; 3],
    pub(crate) preview: [[AxisState; N]; 3],
}

/// One problem of inverse kinematics.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reaching {
    pub(crate) motion: JointMotion<J>,
    pub(crate) target: ToolTarget,
}

#[derive(Debug, Default)]
pub(crate) struct Workload<const N: usize> {
    pub(crate) ticks: Vec<WorkloadTick>,
    pub(crate) plannings: Vec<Planning<N>>,
    pub(crate) reachings: Vec<Reaching>,
}

/// Runs `seconds` of the loop on `path`, over and over, with plans of N steps.
///
/// # Errors
///
/// Settings the loop refuses, a path on which the arm never follows.
pub(crate) fn record<const N: usize>(
    config: &Config,
    path: &PenPath,
    seconds: f64,
) -> Result<Workload<N>, Failure> {
    let settings = config.follower_settings();
    let period_ns = settings.period_ns;
    let (plane, step_ns, lead_ns) = (settings.plane, settings.pen.step_ns, settings.dead_time_ns);
    let plan_ns = (settings.mpc.step_s * 1e9).round() as u64;
    let period_s = period_ns as f64 * 1e-9;
    let mut follower = Follower::<N, J>::new(settings).map_err(|error| Failure::bad_input(error, ""))?;
    let mut pen = RepeatedPen::new(path, plane);

    let mut workload = Workload::default();
    let mut joints =
        JointReading { stamp: Stamp(BEGIN_NS), q: config.robot().home, qd: [0.0; J], motion_allowed: true };
    let mut before: Option<Before> = None;
    for k in 0..(seconds / period_s) as u64 {
        let now = Stamp(BEGIN_NS + k * period_ns);
        joints.stamp = now;
        let request = (k == 10).then_some(Request::Arm);
        let mut tick = WorkloadTick { now, pen: pen.until(now), joints, request, following: false };
        let out = follower.step(&tick.input(), Budget::default(), &mut NoClock);
        if let Some(Err(refusal)) = out.answer {
            let what = format!("the loop cannot be armed at robot.home_rad: {refusal:?}");
            return Err(Failure::bad_input(what, "choose other settings for the bench"));
        }
        tick.following = out.mode == Mode::Following;
        if let Some(command) = out.command {
            let height = out.reference[2];
            if let Some(last) = before.filter(|_| tick.following) {
                let ahead = |i: usize| pen.reference(now + lead_ns + (i as u64 + 1) * plan_ns, step_ns);
                workload.plannings.push(Planning {
                    start: last.setpoint,
                    held: [out.pen_position[0], out.pen_position[1], height].map(AxisState::at_rest),
                    preview: [
                        std::array::from_fn(|i| ahead(i)[0]),
                        std::array::from_fn(|i| ahead(i)[1]),
                        [AxisState::at_rest(height); N],
                    ],
                });
                let point = |axes: &[AxisState; 3]| Vector3::from(axes.map(|axis| axis.position));
                let (here, there) = (point(&last.setpoint), point(&out.setpoint));
                workload.reachings.push(Reaching {
                    motion: last.motion,
                    target: ToolTarget {
                        position: plane.point_to_base(&here),
                        velocity: plane.vector_to_base(&((there - here) / period_s)),
                        axis: plane.tool_axis(),
                        spin: None,
                    },
                });
            }
            let qd_before = before.map_or([0.0; J], |last| last.motion.qd);
            let qdd = std::array::from_fn(|i| (command.qd[i] - qd_before[i]) / period_s);
            let motion = JointMotion { q: command.q, qd: command.qd, qdd };
            before = Some(Before { motion, setpoint: out.setpoint });
            (joints.q, joints.qd) = (command.q, command.qd);
        }
        workload.ticks.push(tick);
    }
    if workload.plannings.is_empty() {
        return Err(Failure::bad_input(
            "the arm never followed the pen in the recorded loop",
            "choose a longer path, or other settings",
        ));
    }
    Ok(workload)
}

/// The commanded state after a tick.
#[derive(Debug, Clone, Copy)]
struct Before {
    motion: JointMotion<J>,
    setpoint: [AxisState; 3],
}

/// The pen of the path, repeated.
struct RepeatedPen {
    plane: Plane,
    /// One repetition, stamps from 0, device coordinates.
    readings: Vec<PenReading>,
    turn_ns: u64,
    sent: u64,
}

impl RepeatedPen {
    fn new(path: &PenPath, plane: Plane) -> Self {
        let first_s = path.samples.first().map_or(0.0, |sample| sample.t_s);
        let reading = |sample: &PathSample| {
            let stamp = Stamp(((sample.t_s - first_s) * 1e9) as u64);
            PenReading::new(stamp, [sample.x_m, sample.y_m], sample.contact)
        };
        let turn_s = path.duration_s() + 1.0 / path.rate_hz.max(1.0);
        Self {
            plane,
            readings: path.samples.iter().map(reading).collect(),
            turn_ns: (turn_s * 1e9) as u64,
            sent: 0,
        }
    }

    /// Readings stamped up to `now` that have not been given yet.
    fn until(&mut self, now: Stamp) -> Vec<PenReading> {
        let mut out = Vec::new();
        while let Some(reading) = self.nth(self.sent).filter(|reading| reading.stamp <= now) {
            out.push(reading);
            self.sent += 1;
        }
        out
    }

    fn nth(&self, n: u64) -> Option<PenReading> {
        let count = self.readings.len() as u64;
        let reading = self.readings.get(usize::try_from(n.checked_rem(count)?).ok()?)?;
        let stamp = Stamp(BEGIN_NS + n / count * self.turn_ns + reading.stamp.0);
        Some(PenReading { stamp, ..*reading })
    }

    /// Position at `instant` in the plane frame \[m\].
    fn at(&self, instant: Stamp) -> [f64; 2] {
        let t = instant.0.saturating_sub(BEGIN_NS) % self.turn_ns.max(1);
        let after = self.readings.partition_point(|reading| reading.stamp.0 <= t);
        let last = self.readings.len().saturating_sub(1);
        let (a, b) = (&self.readings[after.saturating_sub(1)], &self.readings[after.min(last)]);
        let elapsed = b.stamp.seconds_since(a.stamp);
        let share = if elapsed > 0.0 { (t - a.stamp.0) as f64 * 1e-9 / elapsed } else { 0.0 };
        let between = |axis: usize| a.position[axis] + share * (b.position[axis] - a.position[axis]);
        self.plane.from_pen([between(0), between(1)])
    }

    /// Where the pen goes: position, velocity and acceleration over one grid step around `instant`.
    fn reference(&self, instant: Stamp, step_ns: u64) -> [AxisState; 2] {
        let step_s = step_ns as f64 * 1e-9;
        let (before, here, after) =
            (self.at(Stamp(instant.0 - step_ns)), self.at(instant), self.at(instant + step_ns));
        [0, 1].map(|axis| AxisState {
            position: here[axis],
            velocity: (after[axis] - before[axis]) / (2.0 * step_s),
            acceleration: (after[axis] - 2.0 * here[axis] + before[axis]) / (step_s * step_s),
        })
    }
}
