//! The ghost: the same loop at Hold (α = 0) with the same pen, arm and limits, run beside the real loop, and
//! how much the prediction gains over it.
//!
//! Contract: fed with the output of each tick of the real loop. A second [`Follower`] with the same settings
//! and trust 0 takes over the arm whenever the real one does, from the same measured joints, and receives the
//! newest pen reading of every tick at the same instant. The real arm is where its measured joints put it;
//! the ghost's arm responds to its commands as the real one was measured to respond to its own ([`ArmFit`]):
//! late by the lag, and rounded by the servo. Both are judged at the stamps of the real measurements, once
//! the pen around them is known, only while the loop follows, and only after both tools have come near the
//! pen. Where ticks are missing the ghost cannot know what the pen did: it starts again from the real command
//! at rest and is judged again after a second. Work per tick is one step of the law; nothing allocates after
//! construction. Absent: threads, and the source of the lag.

mod arm;
mod score;
mod track;

pub use arm::ArmFit;
pub use score::{PEN_AHEAD_NS, Score, Tracking};
pub use track::{Point, Track};

use std::collections::VecDeque;

use crate::arm::Chain;
use crate::follower::{
    Budget, Follower, FollowerError, FollowerSettings, JointReading, Mode, NoClock, StepInput, StepOutput,
};
use crate::pen::PenReading;
use crate::plane::Plane;
use crate::predict::PredictorKind;
use crate::trust::TrustRequest;
use crate::units::{Stamp, Trust};

/// Delay of the judgement \[ns\]: enough for every shift of the lag and a pen that is 50 ms old; for an older
/// one by its age more.
const JUDGED_AFTER_NS: u64 = PEN_AHEAD_NS + 50_000_000;
/// Oldest pen that the tracks have room for \[ns\].
const OLDEST_PEN_NS: u64 = 300_000_000;
/// Memory of recent figures, in time of writing \[ns\].
const MEMORY_NS: u64 = 3_000_000_000;
/// Settling time of both tools after missing ticks \[ns\].
const SETTLING_NS: u64 = 1_000_000_000;
/// Gaps in the pen longer than this are not interpolated \[ns\]; as in the lab's score.
const PEN_GAP_NS: i64 = 50_000_000;
/// Gaps in the ghost's commands longer than this are not interpolated \[ns\].
const TOOL_GAP_NS: i64 = 50_000_000;
/// Points kept: a second at 1 kHz.
const KEPT: usize = 1024;
/// No jump gate: the real loop's has judged already \[m/s\].
const ANY_SPEED_MPS: f64 = 1e9;

/// What one tick of the real loop showed.
#[derive(Debug, Clone, Copy)]
pub struct GhostTick<'a, const J: usize> {
    /// Number of the tick; consecutive.
    pub tick: u64,
    /// Nominal release time of the tick.
    pub now: Stamp,
    /// What the step was allowed to spend.
    pub budget: Budget,
    /// What the step answered.
    pub output: &'a StepOutput<J>,
    /// Newest measured joints \[rad\] and their stamp.
    pub measured: Option<(Stamp, [f64; J])>,
    /// Lag of the arm, from the stamp of a command to the motion \[ns\]; negative: ahead of it.
    pub lag_ns: i64,
}

/// Whether the ghost can be compared with the real loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GhostState {
    /// The loop does not follow the pen.
    #[default]
    Off,
    /// One of the tools is still on its way to the pen.
    Approaching,
    /// Ticks were missing; both tools settle.
    Settling,
    /// It can be compared with the loop.
    Comparable,
}

/// Both tools at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compared {
    /// Instant of the grid that it is about.
    pub instant: Stamp,
    /// Distance of the real tool from the pen \[m\].
    pub error_m: f64,
    /// Distance of the ghost's tool from the pen \[m\].
    pub ghost_error_m: f64,
    /// The pen touched the paper then.
    pub contact: bool,
}

/// What the ghost did in one tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GhostReport {
    /// Whether it can be compared.
    pub state: GhostState,
    /// Where its command puts the tool, plane frame \[m\]; `None` while there is no command.
    pub tool: Option<[f64; 3]>,
    /// The newest instant that was judged in this tick.
    pub compared: Option<Compared>,
}

/// Scores of both, since the loop was armed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GhostFigures {
    /// Whether they are being compared.
    pub state: GhostState,
    /// How long the pen wrote meanwhile \[s\].
    pub seconds: f64,
    /// Tracking of the real loop.
    pub real: Tracking,
    /// Tracking of Hold alone, the ghost.
    pub ghost: Tracking,
}

/// The ghost of a loop with horizon `N` and `J` joints.
#[derive(Debug)]
pub struct Ghost<const N: usize, const J: usize> {
    follower: Follower<N, J>,
    chain: Chain<J>,
    plane: Plane,
    approach_distance: f64,
    last_tick: Option<u64>,
    /// Age of the newest pen sample when it arrived \[ns\].
    pen_late_ns: u64,
    looked: Stamp,
    engaged: bool,
    approached: bool,
    settled_at: Stamp,
    state: GhostState,
    /// Joints that the ghost's last command asked for \[rad\].
    commanded: [f64; J],
    pen: Track,
    /// Tool positions that the real loop and the ghost commanded.
    sent: Track,
    tool: Track,
    arm: ArmFit,
    /// Where and when the real tool was last measured.
    measured: (Stamp, [f64; 2]),
    /// Measurements that wait to be judged: when, and where the real tool was.
    waiting: VecDeque<(Stamp, [f64; 2])>,
    score: Score,
}

impl<const N: usize, const J: usize> Ghost<N, J> {
    /// The ghost of a loop with these settings.
    ///
    /// # Errors
    ///
    /// As [`Follower::new`].
    pub fn new(settings: FollowerSettings<J>) -> Result<Self, FollowerError> {
        let (chain, plane) = (settings.chain.clone(), settings.plane);
        let approach_distance = settings.safety.approach_distance;
        Ok(Self {
            follower: Follower::new(of_hold(settings))?,
            chain,
            plane,
            approach_distance,
            last_tick: None,
            pen_late_ns: 0,
            looked: Stamp(0),
            engaged: false,
            approached: false,
            settled_at: Stamp(0),
            state: GhostState::Off,
            commanded: [0.0; J],
            pen: Track::new(KEPT, PEN_GAP_NS),
            sent: Track::new(KEPT, TOOL_GAP_NS),
            tool: Track::new(KEPT, TOOL_GAP_NS),
            arm: ArmFit::default(),
            measured: (Stamp(0), [f64::INFINITY; 2]),
            waiting: VecDeque::with_capacity(KEPT),
            score: Score::new(MEMORY_NS),
        })
    }

    /// Follows one tick of the real loop.
    pub fn follow(&mut self, tick: &GhostTick<'_, J>) -> GhostReport {
        let output = tick.output;
        let whole =
            self.last_tick.replace(tick.tick).is_some_and(|last| last.checked_add(1) == Some(tick.tick));
        let looked = std::mem::replace(&mut self.looked, tick.now);
        if let Some(stamp) = output.pen_stamp {
            if self.pen.newest().is_none_or(|newest| newest < stamp) {
                self.pen_late_ns = looked.0.saturating_sub(stamp.0).min(OLDEST_PEN_NS);
            }
            let (position, contact) = (output.pen_position, output.pen_contact);
            self.pen.push(Point { stamp, position, contact });
        }
        let engaged = matches!(output.mode, Mode::Armed | Mode::Following | Mode::Holding);
        let begins = engaged && !self.engaged;
        self.engaged = engaged;
        if !engaged {
            self.part();
            self.state = GhostState::Off;
            return GhostReport::default();
        }
        if begins {
            self.score = Score::new(MEMORY_NS);
        }
        if !self.take_over(tick, begins, whole) {
            self.state = GhostState::Settling;
            return GhostReport { state: self.state, ..GhostReport::default() };
        }
        if let Some(command) = output.command {
            let [x, y, _] = output.tool;
            self.sent.push(Point { stamp: command.stamp, position: [x, y], contact: true });
        }
        let shadow = self.step(tick);
        let tool = shadow.command.map(|command| {
            let [x, y, _] = shadow.tool;
            self.commanded = command.q;
            self.tool.push(Point { stamp: command.stamp, position: [x, y], contact: true });
            shadow.tool
        });
        if !matches!(shadow.mode, Mode::Armed | Mode::Following | Mode::Holding) {
            // It stopped where the real loop did not: the two can no longer be compared.
            self.last_tick = None;
        }
        let fresh = self.measure(tick);
        self.state = self.judged_state(tick, &shadow);
        if fresh && self.state == GhostState::Comparable && self.waiting.len() < KEPT {
            self.waiting.push_back(self.measured);
        }
        GhostReport { state: self.state, tool, compared: self.judge(tick) }
    }

    /// Scores of both since arming.
    #[must_use]
    pub fn figures(&self) -> GhostFigures {
        let [real, ghost] = self.score.tracking();
        GhostFigures { state: self.state, seconds: self.score.seconds(), real, ghost }
    }

    fn part(&mut self) {
        self.approached = false;
        self.sent.clear();
        self.tool.clear();
        self.waiting.clear();
    }

    /// Puts the ghost where the real arm is, if the two begin together or the comparison ended; `false` if it
    /// cannot.
    fn take_over(&mut self, tick: &GhostTick<'_, J>, begins: bool, whole: bool) -> bool {
        if whole && !begins {
            return true;
        }
        let together = begins && whole;
        let joints = if together {
            tick.measured.map(|(_, q)| q)
        } else {
            // A moving arm whose past is unknown cannot be taken over.
            self.settled_at = tick.now.plus_ns(SETTLING_NS);
            tick.output.command.map(|command| command.q)
        };
        self.part();
        let taken = joints.filter(|q| self.follower.take_over(tick.now, q).is_ok());
        if let Some(q) = taken {
            self.commanded = q;
        } else {
            self.last_tick = None;
        }
        taken.is_some()
    }

    fn step(&mut self, tick: &GhostTick<'_, J>) -> StepOutput<J> {
        let output = tick.output;
        let reading = output.pen_stamp.map(|stamp| PenReading {
            origin: output.pen_origin,
            ..PenReading::new(stamp, output.pen_position, output.pen_contact)
        });
        // A repeated reading is refused as a repeat and changes nothing.
        let joints = JointReading { stamp: tick.now, q: self.commanded, qd: [0.0; J], motion_allowed: true };
        let input =
            StepInput { pen: reading.as_slice(), joints: Some(&joints), ..StepInput::nothing(tick.now) };
        self.follower.step(&input, tick.budget, &mut NoClock)
    }

    /// Stores where the real tool was measured; returns whether that is new.
    fn measure(&mut self, tick: &GhostTick<'_, J>) -> bool {
        let Some((stamp, q)) = tick.measured.filter(|(stamp, _)| *stamp > self.measured.0) else {
            return false;
        };
        let at = self.plane.point_from_base(&self.chain.forward(&q).position);
        self.measured = (stamp, [at.x, at.y]);
        true
    }

    fn judged_state(&mut self, tick: &GhostTick<'_, J>, shadow: &StepOutput<J>) -> GhostState {
        let settling = tick.now < self.settled_at;
        if tick.output.mode != Mode::Following || shadow.mode != Mode::Following {
            self.approached = false;
        } else if !self.approached {
            // Judged by the arms, not by their commands: the approach to the pen ends when the arms have
            // arrived.
            let (measured, real) = self.measured;
            let [px, py] = tick.output.pen_position;
            let near = |[x, y]: [f64; 2]| (x - px).hypot(y - py) <= self.approach_distance;
            let ghost = self.tool.at(earlier(measured, tick.lag_ns));
            self.approached = near(real) && ghost.is_some_and(|ghost| near(ghost.position));
        }
        match self.approached {
            _ if settling => GhostState::Settling,
            true => GhostState::Comparable,
            false => GhostState::Approaching,
        }
    }

    /// Judges the instants around which everything is known by now.
    fn judge(&mut self, tick: &GhostTick<'_, J>) -> Option<Compared> {
        let mut newest = None;
        let after_ns = JUDGED_AFTER_NS + self.pen_late_ns;
        while let Some(&(instant, real)) = self.waiting.front() {
            if instant.plus_ns(after_ns) > tick.now {
                break;
            }
            self.waiting.pop_front();
            let then = earlier(instant, tick.lag_ns);
            self.arm.learn(&self.sent, then, real);
            let Some(ghost) = self.arm.respond(&self.tool, then) else { continue };
            if let Some(([error_m, ghost_error_m], contact)) =
                self.score.judge(instant, [real, ghost], &self.pen)
            {
                newest = Some(Compared { instant, error_m, ghost_error_m, contact });
            }
        }
        newest
    }
}

/// When the command for the motion at `instant` was given, for an arm with this lag.
fn earlier(instant: Stamp, lag_ns: i64) -> Stamp {
    Stamp(instant.0.saturating_add_signed(lag_ns.saturating_neg()))
}

/// The settings of a loop that only holds, with readings that were already judged and placed in the plane.
fn of_hold<const J: usize>(mut settings: FollowerSettings<J>) -> FollowerSettings<J> {
    settings.trust_request = TrustRequest::Manual(Trust::NONE);
    settings.preview.kind = PredictorKind::HOLD;
    settings.pen.max_speed_mps = ANY_SPEED_MPS;
    settings.plane.pen_scale = 1.0;
    settings.plane.pen_origin = [0.0; 2];
    // The operator's commands go to the real arm; the ghost follows their effects.
    settings.safety.enable_required = false;
    settings
}
