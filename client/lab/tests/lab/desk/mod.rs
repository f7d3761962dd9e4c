//! The daemon's law with a simulated arm that may fail: shared by the tests of the tracking monitor.

use std::collections::VecDeque;

use foretrace_config::Config;
use foretrace_control::arm::JointMotion;
use foretrace_control::follower::{
    Budget, Follower, FollowerSettings, JointCommand, JointReading, Mode, NoClock, Refusal, Request,
    StepInput, StepOutput,
};
use foretrace_control::guard::{CommandChecker, Commanded, consumer_state};
use foretrace_control::pen::PenReading;
use foretrace_control::stop::{StopDetail, StopReason};
use foretrace_control::units::Stamp;
use foretrace_sim::arm::{ArmModel, ArmSettings, JOINTS, Joints};
use foretrace_sim::path::{Layout, PathSample, Placement};
use foretrace_sim::writer::text_path;
use nalgebra::Vector3;

/// Of the presets.
const HORIZON: usize = 20;
/// Time for which the pen rests above its first sample \[ns\].
const WAIT_NS: u64 = 1_000_000_000;
/// Number of ticks whose commands the tool is compared with.
const REMEMBERED: usize = 250;

/// A pen that goes round and round.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pen {
    pub(crate) radius_m: f64,
    pub(crate) speed_mps: f64,
}

impl Pen {
    /// Where it is `t_s` after it began; it sets off and turns gently.
    fn at(&self, t_s: f64) -> [f64; 2] {
        let begun = if t_s < 1.0 { 0.5 * t_s * t_s } else { t_s - 0.5 };
        let angle = self.speed_mps / self.radius_m * begun.max(0.0);
        [self.radius_m * angle.cos(), self.radius_m * angle.sin()]
    }

    /// The same on a figure of eight.
    fn eight_at(&self, t_s: f64) -> [f64; 2] {
        let begun = if t_s < 1.0 { 0.5 * t_s * t_s } else { t_s - 0.5 };
        let angle = 0.7 * self.speed_mps / self.radius_m * begun.max(0.0);
        [self.radius_m * angle.sin(), 0.5 * self.radius_m * (2.0 * angle).sin()]
    }
}

/// Where the arm of a desk begins \[rad\].
pub(crate) fn home() -> [f64; JOINTS] {
    Config::preset("ur5e").unwrap().robot().home
}

/// Quantities observed from outside.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Seen {
    /// Fastest that a joint was commanded to move \[rad/s\].
    pub(crate) joint_radps: f64,
    /// Farthest that the tool really was from all commands of the last half second \[m\].
    pub(crate) off_m: f64,
    /// Smallest estimated share of its speed.
    pub(crate) share: Option<f64>,
    /// Fastest that the tool was commanded to move lately \[m/s\].
    pub(crate) tool_mps: f64,
    /// Farthest outside the workspace that a command had the tool \[m\].
    pub(crate) outside_m: f64,
    /// Farthest outside where the arm would have come to rest after any command, once ticks had been lost
    /// \[m\].
    pub(crate) silence_m: f64,
}

/// What a desk needs of an arm.
pub(crate) trait DeskArm {
    /// Length of its cycle \[s\].
    fn cycle_s(&self) -> f64;
    /// One cycle towards `target` \[rad\].
    fn cycle(&mut self, target: [f64; JOINTS]);
    /// What it reports.
    fn joints(&self) -> Joints;
    /// Where it is.
    fn really(&self) -> Joints;
}

impl DeskArm for ArmModel {
    fn cycle_s(&self) -> f64 {
        self.settings().cycle_s
    }

    fn cycle(&mut self, target: [f64; JOINTS]) {
        Self::cycle(self, target);
    }

    fn joints(&self) -> Joints {
        Self::joints(self)
    }

    fn really(&self) -> Joints {
        Self::really(self)
    }
}

pub(crate) struct Desk {
    follower: Follower<HORIZON, JOINTS>,
    judge: CommandChecker<JOINTS>,
    arm: Box<dyn DeskArm>,
    target: [f64; JOINTS],
    tick: u64,
    now: Stamp,
    begin: Stamp,
    sent: VecDeque<Vector3<f64>>,
    last: Option<JointCommand<JOINTS>>,
    /// How many periods are lost before the next tick; and whether any were.
    gaps: Option<Box<dyn FnMut() -> u64>>,
    lost: bool,
    pub(crate) seen: Seen,
    pub(crate) mode: Mode,
}

impl Desk {
    pub(crate) fn new(arm: ArmSettings) -> Self {
        Self::with(arm, Config::preset("ur5e").unwrap().follower_settings())
    }

    pub(crate) fn with(arm: ArmSettings, settings: FollowerSettings<JOINTS>) -> Self {
        Self::around(Box::new(ArmModel::at_rest(arm, home())), settings)
    }

    /// Around an arm at rest at [`home`].
    pub(crate) fn around(arm: Box<dyn DeskArm>, settings: FollowerSettings<JOINTS>) -> Self {
        let home = home();
        Self {
            judge: CommandChecker::new(settings.limits),
            follower: Follower::new(settings).unwrap(),
            arm,
            target: home,
            tick: 0,
            now: Stamp(10_000_000_000),
            begin: Stamp(10_000_000_000 + WAIT_NS),
            sent: VecDeque::new(),
            last: None,
            gaps: None,
            lost: false,
            seen: Seen::default(),
            mode: Mode::Idle,
        }
    }

    pub(crate) fn armed(arm: ArmSettings) -> Self {
        let mut desk = Self::new(arm);
        assert_eq!(desk.ask(Request::Arm), Ok(()));
        desk
    }

    /// Asks, and lets half a second pass.
    pub(crate) fn ask(&mut self, request: Request) -> Result<(), Refusal> {
        let answer = self.tick(&[], Some(request)).answer.unwrap();
        for _ in 0..250 {
            self.tick(&[], None);
        }
        answer
    }

    /// Time since the pen began \[s\].
    pub(crate) fn since_begin(&self, at: Stamp) -> f64 {
        at.seconds_since(self.begin)
    }

    /// Lets the pen write for `seconds`, or until a stop; goes on to the rest then.
    pub(crate) fn write(&mut self, pen: Pen, seconds: f64) -> Option<(StopReason, StopDetail)> {
        let centre = self.centre();
        self.until(seconds, |t_s| {
            let [x, y] = pen.at(t_s);
            ([x + centre[0], y + centre[1]], t_s > 0.0)
        })
    }

    /// The same on figures of eight, as wide as the circles.
    pub(crate) fn write_eight(&mut self, pen: Pen, seconds: f64) -> Option<(StopReason, StopDetail)> {
        let centre = self.centre();
        self.until(seconds, |t_s| {
            let [x, y] = pen.eight_at(t_s);
            ([x + centre[0], y + centre[1]], t_s > 0.0)
        })
    }

    /// The same without a pen.
    pub(crate) fn wait(&mut self, seconds: f64) -> Option<(StopReason, StopDetail)> {
        while self.since_begin(self.now) < seconds {
            let output = self.tick(&[], None);
            if output.stop_reason != StopReason::None {
                return Some((output.stop_reason, output.stop_detail));
            }
        }
        None
    }

    pub(crate) fn write_text(&mut self, text: &str, seed: u64) -> Option<(StopReason, StopDetail)> {
        let placement = Placement { layout: Layout::Line, ..Placement::default() };
        let samples = text_path(text, seed, 200.0, &placement).unwrap().samples;
        self.write_path(&samples, 0.0).err()
    }

    /// Writes `samples` from `begin_s` after the pen began on; when it was done, or the stop.
    pub(crate) fn write_path(
        &mut self,
        samples: &[PathSample],
        begin_s: f64,
    ) -> Result<f64, (StopReason, StopDetail)> {
        let (first, last) = (samples[0], samples[samples.len() - 1]);
        let end_s = begin_s + last.t_s - first.t_s;
        let mut next = 0;
        let stop = self.until(end_s, |t_s| {
            while next + 1 < samples.len() && samples[next + 1].t_s - first.t_s <= t_s - begin_s {
                next += 1;
            }
            ([samples[next].x_m, samples[next].y_m], t_s > begin_s && samples[next].contact)
        });
        stop.map_or(Ok(end_s), Err)
    }

    fn until(
        &mut self,
        seconds: f64,
        mut pen: impl FnMut(f64) -> ([f64; 2], bool),
    ) -> Option<(StopReason, StopDetail)> {
        let mut stop = None;
        while self.since_begin(self.now) < seconds {
            let (position, contact) = pen(self.since_begin(self.now));
            let output = self.tick(&[PenReading::new(self.now, position, contact)], None);
            if stop.is_none() && output.stop_reason != StopReason::None {
                stop = Some((output.stop_reason, output.stop_detail));
            }
            if stop.is_some() && output.command.is_none_or(|command| !command.enabled) {
                break;
            }
        }
        stop
    }

    /// Middle of the workspace, device coordinates.
    fn centre(&self) -> [f64; 2] {
        let settings = self.follower.settings();
        let axes = settings.mpc.axes;
        let middle = |axis: usize| 0.5 * (axes[axis].position_m[0] + axes[axis].position_m[1]);
        [middle(0), middle(1)]
    }

    /// From the next tick on, loses as many periods before each as `gaps` says.
    pub(crate) fn lose(&mut self, gaps: impl FnMut() -> u64 + 'static) {
        self.gaps = Some(Box::new(gaps));
    }

    /// Where the arm is asked to be at `now` if nothing comes after the last command \[rad\].
    fn unheard(&self, now: Stamp) -> [f64; JOINTS] {
        let Some(last) = &self.last else { return self.target };
        let motion = JointMotion { q: last.q, qd: last.qd, qdd: [0.0; JOINTS] };
        let command = Commanded::new(last.stamp, motion).unwrap();
        let limits = self.follower.settings().limits;
        consumer_state(&command, last.valid_until, limits.deceleration(), now).q
    }

    /// Periods without a tick, in which the arm goes on by itself; how many.
    fn gap(&mut self) -> u64 {
        let lost = self.gaps.as_mut().map_or(0, |gaps| gaps());
        for _ in 0..lost {
            self.target = self.unheard(self.now);
            self.pass();
        }
        self.lost |= lost > 0;
        lost
    }

    /// One period of the arm.
    fn pass(&mut self) {
        let period_ns = self.follower.settings().period_ns;
        let ticks_per_cycle = (self.arm.cycle_s() * 1e9).round() as u64 / period_ns;
        if self.tick.is_multiple_of(ticks_per_cycle) {
            self.arm.cycle(self.target);
        }
        self.tick += 1;
        self.now = self.now + period_ns;
    }

    /// Distance outside the workspace of an arm at `q` \[m\].
    fn outside_m(&self, q: &[f64; JOINTS]) -> f64 {
        let settings = self.follower.settings();
        let tool = settings.plane.point_from_base(&settings.chain.forward(q).position);
        let axes = tool.iter().zip(&settings.mpc.axes);
        axes.map(|(at, axis)| (at - axis.position_m[1]).max(axis.position_m[0] - at)).fold(0.0, f64::max)
    }

    fn tick(&mut self, pen: &[PenReading], request: Option<Request>) -> StepOutput<JOINTS> {
        let gap = self.gap();
        let period_ns = self.follower.settings().period_ns;
        let ticks_per_cycle = (self.arm.cycle_s() * 1e9).round() as u64 / period_ns;
        let joints = self.arm.joints();
        let reading = JointReading { stamp: self.now, q: joints.q, qd: joints.qd, motion_allowed: true };
        let fresh = (gap > 0 || self.tick.is_multiple_of(ticks_per_cycle)).then_some(&reading);
        let input = StepInput { pen, joints: fresh, request, ..StepInput::nothing(self.now) };
        let output = self.follower.step(&input, Budget::default(), &mut NoClock);
        if output.begins {
            self.judge.restart();
        }
        if let Some(command) = &output.command {
            let legal = self.judge.observe(command.stamp, command.valid_until, &command.q, &command.qd);
            assert!(legal, "illegal command: {command:?}");
        }
        self.look(&output);
        self.pass();
        if let Some(command) = &output.command {
            self.target = command.q;
        }
        self.last = output.command;
        if self.last.is_some() {
            let rest = self.unheard(self.now.plus_ns(1_000_000_000));
            self.seen.outside_m = self.seen.outside_m.max(self.outside_m(&self.target));
            if self.lost {
                self.seen.silence_m = self.seen.silence_m.max(self.outside_m(&rest));
            }
        }
        self.mode = output.mode;
        output
    }

    fn look(&mut self, output: &StepOutput<JOINTS>) {
        let Some(command) = &output.command else { return };
        let chain = &self.follower.settings().chain;
        let really = chain.forward(&self.arm.really().q).position;
        let sent = chain.forward(&command.q).position;
        if let Some(before) = self.sent.front() {
            self.seen.tool_mps = self.seen.tool_mps.max((sent - before).norm() / 0.002);
        }
        self.sent.push_front(sent);
        self.sent.truncate(REMEMBERED);
        let off = self.sent.iter().map(|sent| (sent - really).norm()).fold(f64::INFINITY, f64::min);
        self.seen.off_m = self.seen.off_m.max(off);
        let fastest = command.qd.iter().fold(0.0, |most: f64, qd| most.max(qd.abs()));
        self.seen.joint_radps = self.seen.joint_radps.max(fastest);
        if let Some(share) = output.arm_speed_share {
            self.seen.share = Some(self.seen.share.map_or(share, |least| least.min(share)));
        }
    }
}
