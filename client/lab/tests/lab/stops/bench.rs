//! A hand that writes, the law and an arm behind its servo, and at chosen moments a stop on a copy of the
//! law: the writing goes on undisturbed.

use foretrace_config::Config;
use foretrace_control::arm::limits::braking_straight;
use foretrace_control::arm::{Chain, JointMotion};
use foretrace_control::clearance::Clearance;
use foretrace_control::envelope::Envelope;
use foretrace_control::follower::{
    Budget, EnableReading, Follower, FollowerSettings, Health, JointCommand, JointReading, NoClock, Request,
    StepInput,
};
use foretrace_control::guard::{CommandChecker, Commanded, Guard, StopProfile, consumer_state};
use foretrace_control::ik::Ik;
use foretrace_control::pen::PenReading;
use foretrace_control::plane::Plane;
use foretrace_control::state;
use foretrace_control::stop::{StopDetail, StopReason};
use foretrace_control::units::Stamp;
use foretrace_sim::arm::{ArmModel, ArmSettings, JOINTS};
use foretrace_sim::path::PathSample;
use nalgebra::Vector3;

/// Of the presets.
const HORIZON: usize = 20;
/// Time for which the pen rests above its first sample \[s\].
const WAIT_S: f64 = 1.2;
/// Longest that a stop, and the arm behind it, may take \[s\].
const LONGEST_S: f64 = 1.0;
/// Slower than this in every joint is at rest \[rad/s\].
const STILL_RADPS: f64 = 2e-3;

type Law = Follower<HORIZON, JOINTS>;

/// What ends the writing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum End {
    Asked(Request),
    /// Latched by the loop around the law.
    Halted(StopReason),
    DeadManReleased,
    ArmSafety,
}

/// How a moment looks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moment {
    /// On the path's own axis \[s\].
    pub(crate) t_s: f64,
    /// Of the last command, plane frame \[m\], \[m/s\].
    pub(crate) tip: Vector3<f64>,
    pub(crate) velocity: Vector3<f64>,
    /// Height above the pressing depth \[m\].
    pub(crate) above_m: f64,
    pub(crate) contact: bool,
}

/// One way to rest.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Way {
    /// Lowest commanded tip \[m\].
    pub(crate) lowest_m: f64,
    /// Farthest off the line on which the tip moved \[m\].
    pub(crate) off_line_m: f64,
    /// Time to the rest of the command and of the arm, and to the very end of the command's motion \[s\].
    pub(crate) rest_s: f64,
    pub(crate) arm_rest_s: f64,
    pub(crate) end_s: f64,
    /// Largest change of a joint's acceleration per time \[share of the stop's jerk limit\].
    pub(crate) jerk: f64,
    /// Ticks in which the path was given up.
    pub(crate) lost: u32,
}

/// One moment, and the ways to rest from there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stop {
    pub(crate) moment: Moment,
    /// By the law; without the rows of the path; a consumer that hears nothing more; a UR's program that
    /// misses its commands.
    pub(crate) law: Way,
    pub(crate) without: Way,
    pub(crate) silent: Way,
    pub(crate) program: Way,
}

impl Stop {
    /// No deeper than this the tip should go \[m\].
    pub(crate) fn floor_m(&self) -> f64 {
        let Moment { tip, above_m, .. } = &self.moment;
        tip.z.min(tip.z - above_m)
    }
}

/// What a stop is tried with.
#[derive(Clone, Copy)]
pub(crate) struct Trial {
    pub(crate) end: End,
    pub(crate) budget: Budget,
}

impl Default for Trial {
    fn default() -> Self {
        Self { end: End::Asked(Request::Stop), budget: Budget::default() }
    }
}

/// The law, its arm, and what was commanded last.
struct Loop {
    law: Law,
    arm: ArmModel,
    settings: FollowerSettings<JOINTS>,
    now: Stamp,
    tick: u64,
    target: [f64; JOINTS],
    /// Newest command, and the joint velocities of the one before.
    last: Option<(JointCommand<JOINTS>, [f64; JOINTS])>,
}

impl Loop {
    fn new(config: &Config) -> Self {
        let settings = config.follower_settings();
        let cycle_s = 1.0 / f64::from(config.settings().robot.controller_rate_hz);
        let home = config.robot().home;
        Self {
            law: Follower::new(settings.clone()).unwrap(),
            arm: ArmModel::at_rest(ArmSettings::ur5(cycle_s, 0.030), home),
            now: Stamp(10_000_000_000 - 10_000_000_000 % settings.period_ns),
            settings,
            tick: 0,
            target: home,
            last: None,
        }
    }

    fn period_s(&self) -> f64 {
        self.settings.period_ns as f64 * 1e-9
    }

    /// One period; returns the law's health.
    fn tick(&mut self, pen: &[PenReading], end: Option<End>, budget: Budget) -> Health {
        let joints = self.arm.joints();
        let motion_allowed = end != Some(End::ArmSafety);
        let reading = JointReading { stamp: self.now, q: joints.q, qd: joints.qd, motion_allowed };
        let mut input = StepInput { pen, joints: Some(&reading), ..StepInput::nothing(self.now) };
        match end {
            Some(End::Asked(request)) => input.request = Some(request),
            Some(End::Halted(reason)) => input.halt = Some((reason, StopDetail::default())),
            Some(End::DeadManReleased) => {
                input.enable = Some(EnableReading { stamp: self.now, stop: true });
            }
            Some(End::ArmSafety) | None => {}
        }
        let output = self.law.step(&input, budget, &mut NoClock);
        if let Some(Err(refusal)) = output.answer {
            panic!("refused: {refusal:?}");
        }
        // A command made now is answered from the next controller cycle on.
        self.arm_passes();
        if let Some(command) = output.command {
            let before = self.last.map_or([0.0; JOINTS], |(last, _)| last.qd);
            self.last = Some((command, before));
            self.target = command.q;
        }
        self.now = self.now + self.settings.period_ns;
        self.tick += 1;
        output.health
    }

    /// One period of the arm, which may be several of its cycles, or part of one.
    fn arm_passes(&mut self) {
        let cycle_ns = (self.arm.settings().cycle_s * 1e9).round() as u64;
        let period_ns = self.settings.period_ns;
        let due = |tick: u64| tick * period_ns / cycle_ns;
        for _ in due(self.tick)..due(self.tick + 1) {
            self.arm.cycle(self.target);
        }
    }

    fn tip(&self, q: &[f64; JOINTS]) -> Vector3<f64> {
        tip(&self.settings.chain, &self.settings.plane, q)
    }

    fn moment(&self, t_s: f64, contact: bool) -> Option<Moment> {
        let (command, _) = self.last.as_ref()?;
        let motion = self.settings.chain.forward(&command.q).tool_motion(&command.qd, &[0.0; JOINTS]);
        let velocity = self.settings.plane.vector_from_base(&motion.velocity);
        let tip = self.tip(&command.q);
        Some(Moment { t_s, tip, velocity, above_m: tip.z + self.settings.plane.press_depth, contact })
    }
}

fn tip(chain: &Chain<JOINTS>, plane: &Plane, q: &[f64; JOINTS]) -> Vector3<f64> {
    plane.point_from_base(&chain.forward(q).position)
}

/// Lets `path` be written behind `config`, and makes every trial at each moment picked, in this order.
pub(crate) fn write(
    config: &Config,
    path: &[PathSample],
    trials: &[Trial],
    mut picks: impl FnMut(&Moment) -> bool,
) -> Vec<Stop> {
    let mut real = Loop::new(config);
    let mut copy = Loop::new(config);
    let (first, last) = (path[0], path[path.len() - 1]);
    let begin = real.now;
    let start_s = first.t_s - WAIT_S;
    let at = |t_s: f64, sample: &PathSample, contact: bool| {
        let stamp = begin + ((t_s - start_s) * 1e9).round() as u64;
        let [ox, oy] = real.settings.plane.pen_origin;
        let scale = real.settings.plane.pen_scale;
        PenReading::new(stamp, [sample.x_m / scale + ox, sample.y_m / scale + oy], contact)
    };
    let waiting = (0..(WAIT_S / 0.005) as u32).map(|i| at(start_s + 0.005 * f64::from(i), &first, false));
    let pen: Vec<_> = waiting.chain(path.iter().map(|s| at(s.t_s, s, s.contact))).collect();
    let mut stops = Vec::new();
    let (mut next, mut contact) = (0, false);
    let period_s = real.period_s();
    for tick in 0_u64.. {
        let t_s = start_s + tick as f64 * period_s;
        if t_s > last.t_s {
            break;
        }
        let begun = next;
        while next < pen.len() && pen[next].stamp <= real.now {
            contact = pen[next].contact;
            next += 1;
        }
        let due = &pen[begun..next];
        let moment = real.moment(t_s, contact).filter(|_| t_s > first.t_s);
        if let Some(moment) = moment.filter(|moment| picks(moment)) {
            let begun = state::bytes_of(&real.law).unwrap();
            for trial in trials {
                state::read(&mut copy.law, &begun).unwrap();
                let Loop { arm, now, tick, target, last, .. } = &real;
                (copy.arm, copy.now, copy.tick) = (arm.clone(), *now, *tick);
                (copy.target, copy.last) = (*target, *last);
                stops.push(stop(&mut copy, moment, due, *trial));
            }
        }
        let end = (tick == 1).then_some(End::Asked(Request::Arm));
        real.tick(due, end, Budget::default());
    }
    stops
}

/// Stops the loop, with the pen samples of the first tick, and compares.
fn stop(copy: &mut Loop, moment: Moment, pen: &[PenReading], trial: Trial) -> Stop {
    let (command, before) = copy.last.unwrap();
    let (settings, h) = (copy.settings.clone(), copy.period_s());
    let qdd = std::array::from_fn(|i| (command.qd[i] - before[i]) / h);
    let begun = Commanded::new(command.stamp, JointMotion { q: command.q, qd: command.qd, qdd }).unwrap();
    let ticks = (LONGEST_S / h) as usize;

    let mut judge = CommandChecker::new(settings.limits);
    judge.observe(command.stamp, command.valid_until, &command.q, &command.qd);
    let (mut arm, mut target, mut tick) = (copy.arm.clone(), copy.target, copy.tick);
    let mut trace = Trace::new(&settings, &moment, &begun);
    for step in 0..ticks {
        let pen = if step == 0 { pen } else { &[] };
        let health = copy.tick(pen, (step == 0).then_some(trial.end), trial.budget);
        let Some((command, _)) = copy.last else { unreachable!() };
        let legal = judge.observe(command.stamp, command.valid_until, &command.q, &command.qd)
            || judge.statistics().violations.stamp > 0;
        assert!(legal, "illegal at {moment:?}: {command:?}");
        trace.way.lost += u32::from(health.has(Health::PATH_LOST));
        trace.see(&command.q, &command.qd, &copy.arm);
    }
    let law = trace.way;

    let (profile, guard) = (StopProfile::new(settings.limits), Guard::new(settings.limits));
    let mut ik = joints_alone(&settings);
    let mut trace = Trace::new(&settings, &moment, &begun);
    let mut last = begun;
    let cycle_ns = (arm.settings().cycle_s * 1e9).round() as u64;
    for _ in 0..ticks {
        let stamp = last.stamp() + settings.period_ns;
        let (kinematics, wanted) = (settings.chain.forward(last.q()), profile.next(&last, stamp));
        let qd = ik.stopping(&kinematics, last.motion(), &wanted, h, None, true).qd;
        let q = std::array::from_fn(|i| last.q()[i] + qd[i] * h);
        last = guard.clamp(&last, &q, stamp).command;
        for _ in tick * settings.period_ns / cycle_ns..(tick + 1) * settings.period_ns / cycle_ns {
            arm.cycle(target);
        }
        (target, tick) = (*last.q(), tick + 1);
        trace.see(last.q(), last.qd(), &arm);
    }
    let without = trace.way;

    let still = copy.arm.clone();
    let mut trace = Trace::new(&settings, &moment, &begun);
    for step in 1..=ticks {
        let at = command.stamp + settings.period_ns * step as u64;
        let motion = consumer_state(&begun, command.valid_until, settings.limits.deceleration(), at);
        trace.see(&motion.q, &motion.qd, &still);
    }
    let silent = trace.way;

    // A program goes on for as long, then calls `stopj`: the leading joint brakes, the others in proportion.
    let mut trace = Trace::new(&settings, &moment, &begun);
    let (mut q, mut qd) = (command.q, command.qd);
    let least = settings.limits.deceleration().iter().fold(f64::INFINITY, |a, b| a.min(*b));
    for step in 1..=ticks {
        if command.stamp + settings.period_ns * step as u64 > command.valid_until {
            qd = braking_straight(&qd, &[least; JOINTS], h);
        }
        q.iter_mut().zip(&qd).for_each(|(q, qd)| *q += qd * h);
        trace.see(&q, &qd, &still);
    }
    Stop { moment, law, without, silent, program: trace.way }
}

/// The law's inverse kinematics of a stop, with the rows of clearance and envelope.
fn joints_alone(settings: &FollowerSettings<JOINTS>) -> Ik<JOINTS> {
    let (chain, limits, axes) = (&settings.chain, &settings.limits, settings.mpc.limits());
    let mut ik = Ik::new(*limits, settings.ik);
    if let Some(wanted) = &settings.clearance {
        let period_s = settings.period_ns as f64 * 1e-9;
        ik = ik.keeping_clear(Clearance::new(chain, limits, period_s, wanted).unwrap());
    }
    let workspace = axes.map(|axis| axis.position_m);
    let fastest = Vector3::from(axes.map(|axis| axis.velocity_mps)).norm() + settings.ik.correction_mps;
    let envelope = &settings.safety.envelope;
    ik.inside(Envelope::new(envelope, chain, settings.plane, workspace, fastest, limits).unwrap())
}

/// Follows one way to rest.
struct Trace<'a> {
    settings: &'a FollowerSettings<JOINTS>,
    from: Vector3<f64>,
    across: Vector3<f64>,
    ticks: u32,
    qd: [f64; JOINTS],
    qdd: [f64; JOINTS],
    way: Way,
}

impl<'a> Trace<'a> {
    fn new(settings: &'a FollowerSettings<JOINTS>, moment: &Moment, begun: &Commanded<JOINTS>) -> Self {
        let Moment { tip, velocity, .. } = moment;
        let along = Vector3::new(velocity.x, velocity.y, 0.0).normalize();
        Self {
            settings,
            from: *tip,
            across: Vector3::new(-along.y, along.x, 0.0),
            ticks: 0,
            qd: *begun.qd(),
            qdd: *begun.qdd(),
            way: Way { lowest_m: tip.z, ..Way::default() },
        }
    }

    fn see(&mut self, q: &[f64; JOINTS], qd: &[f64; JOINTS], arm: &ArmModel) {
        let h = self.settings.period_ns as f64 * 1e-9;
        self.ticks += 1;
        let (t, way) = (f64::from(self.ticks) * h, &mut self.way);
        let at = tip(&self.settings.chain, &self.settings.plane, q);
        way.lowest_m = way.lowest_m.min(at.z);
        way.off_line_m = way.off_line_m.max((at - self.from).dot(&self.across).abs());
        let moves = |qd: &[f64; JOINTS]| qd.iter().any(|v| v.abs() > STILL_RADPS);
        if moves(qd) {
            way.rest_s = t;
        }
        if moves(&arm.really().qd) {
            way.arm_rest_s = t;
        }
        if qd.iter().any(|v| *v != 0.0) {
            way.end_s = t;
        }
        let jerk = foretrace_control::arm::limits::stop_jerk(&self.settings.limits);
        let qdd: [f64; JOINTS] = std::array::from_fn(|i| (qd[i] - self.qd[i]) / h);
        for ((now, before), most) in qdd.iter().zip(self.qdd).zip(jerk) {
            way.jerk = way.jerk.max((now - before).abs() / h / most);
        }
        (self.qd, self.qdd) = (*qd, qdd);
    }
}
