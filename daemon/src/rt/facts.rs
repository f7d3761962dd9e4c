//! Output of the real-time thread besides commands: plain data about each tick, and answers to requests.

use foretrace_control::follower::{Mode, Refusal, Request, Stage, StageClock, StepOutput};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::ExternalPreview;
use foretrace_control::units::{Stamp, Trust};

use super::clock::Clock;
use super::cyclic::Wake;
use super::external::ExternalTally;
use crate::ports::PortTally;
use crate::wire::{Echo, Given, JOINTS};

/// Duration of each part of a tick \[ns\].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StageTimes {
    /// From the release to the start of the tick.
    pub wakeup: u64,
    /// Receiving, requests and weights, until the decision on the budget.
    pub receive: u64,
    /// Requests, joint states and pen samples onto the grid.
    pub pen: u64,
    /// Trust, and the preview of the pen's path.
    pub predict: u64,
    /// The tool's reference, and its plan.
    pub mpc: u64,
    pub ik: u64,
    /// Guard and record keeping.
    pub guard: u64,
    pub send: u64,
    /// Start to command sent.
    pub step: u64,
}

/// Times the stages of one tick by the clock of the loop.
#[derive(Debug)]
pub struct LapClock<'a, C> {
    clock: &'a C,
    last: Stamp,
    times: StageTimes,
}

impl<'a, C: Clock> LapClock<'a, C> {
    /// The tick that `wake` began.
    pub fn new(clock: &'a C, wake: &Wake) -> Self {
        let times = StageTimes { wakeup: wake.latency_ns(), ..StageTimes::default() };
        Self { clock, last: wake.started, times }
    }

    /// Time since the last lap \[ns\].
    fn lap_ns(&mut self) -> u64 {
        let now = self.clock.now();
        let ns = now.0.saturating_sub(self.last.0);
        self.last = now;
        ns
    }

    /// Ends the lap of receiving.
    pub fn received(&mut self) -> Stamp {
        self.times.receive = self.lap_ns();
        self.last
    }

    /// Ends the lap of sending; `started` is the start of the tick.
    pub fn sent(&mut self, started: Stamp) -> Stamp {
        self.times.send = self.lap_ns();
        self.times.step = self.last.0.saturating_sub(started.0);
        self.last
    }

    /// The present time, outside of any lap.
    pub fn now(&self) -> Stamp {
        self.clock.now()
    }

    /// The end of the last lap.
    #[must_use]
    pub const fn last(&self) -> Stamp {
        self.last
    }

    #[must_use]
    pub const fn times(&self) -> StageTimes {
        self.times
    }
}

impl<C: Clock> StageClock for LapClock<'_, C> {
    fn lap(&mut self, stage: Stage) {
        let ns = self.lap_ns();
        *match stage {
            Stage::Pen => &mut self.times.pen,
            Stage::Predict => &mut self.times.predict,
            Stage::Mpc => &mut self.times.mpc,
            Stage::Ik => &mut self.times.ik,
            Stage::Guard => &mut self.times.guard,
        } += ns;
    }
}

/// Counts of the loop since its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LoopTally {
    pub ticks: u64,
    /// Ticks that ended after their deadline.
    pub overruns: u64,
    /// Whole periods without a tick.
    pub skipped: u64,
    /// Ticks with a shed budget.
    pub shed: u64,
    /// Commands that were over before they could be sent.
    pub commands_over: u64,
    /// Ticks whose newest joint state was stale.
    pub joints_stale: u64,
    /// Records lost because the ring to the ipc thread was full.
    pub evidence_dropped: u64,
    /// Grid steps lost because the learner's ring was full.
    pub learn_dropped: u64,
    /// Sets of weights refused by the loop.
    pub weights_refused: u64,
    /// Sets of weights that a newer one overtook in the ring.
    pub weights_overtaken: u64,
    /// Allocations while receiving and sending.
    pub port_allocations: u64,
    /// Allocations anywhere else in the tick.
    pub law_allocations: u64,
    /// Page faults of the thread since its first tick, without disk; read every few ticks.
    pub faults_minor: u64,
    /// Page faults of the thread since its first tick, with disk; read every few ticks.
    pub faults_major: u64,
}

/// Inputs, decisions and costs of one tick.
#[derive(Debug, Clone, Copy)]
pub struct TickFacts {
    /// Number of the tick, from 1, without skipped ones.
    pub tick: u64,
    pub wake: Wake,
    /// When its command had been sent.
    pub finished: Stamp,
    pub deadline: Stamp,
    /// Durations of its parts.
    pub times: StageTimes,
    /// What it was given.
    pub given: Given,
    /// Newest measured joints so far, stamp and positions \[rad\].
    pub measured: Option<(Stamp, [f64; JOINTS])>,
    /// When the command, if there is one, was handed to the port.
    pub published: Stamp,
    /// Echo in the newest joint state that has one.
    pub echo: Option<Echo>,
    /// The command could not be sent.
    pub not_sent: bool,
    /// When the weights in use arrived.
    pub weights_since: Option<Stamp>,
    /// Allocations in this tick while receiving and sending.
    pub port_allocations: u32,
    /// Allocations in this tick anywhere else.
    pub law_allocations: u32,
    pub output: StepOutput<JOINTS>,
    /// Totals of the loop.
    pub tally: LoopTally,
    /// Totals of the ports.
    pub ports: PortTally,
    /// Totals of the previews of another process.
    pub previews: ExternalTally,
}

/// A pen sample and the tick that got it.
#[derive(Debug, Clone, Copy)]
pub struct SeenPen {
    pub tick: u64,
    pub reading: PenReading,
}

/// A preview of another process and the tick that got it.
#[derive(Debug, Clone, Copy)]
pub struct SeenPreview {
    pub tick: u64,
    pub preview: ExternalPreview,
}

/// The state of the law after a tick.
#[derive(Debug)]
pub struct StateCopy {
    pub tick: u64,
    /// Bytes used; `None` if the state found no room, or cannot be written.
    pub length: Option<usize>,
    pub bytes: Box<[u8]>,
}

/// A request on its way to the loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopRequest {
    /// Returned with the answer.
    pub token: u64,
    pub request: Request,
    /// When it was received.
    pub stamp: Stamp,
    /// When the operator's program sent it, at most `stamp`.
    pub sent: Stamp,
}

/// A loop that stood still for longer must not carry out what was reported to the operator as failed \[ns\];
/// below the ipc thread's patience.
const REQUEST_LIFE_NS: i64 = 1_000_000_000;

impl LoopRequest {
    /// Whether a request to take charge was sent before a stop at `stopped`, which it must not undo.
    #[must_use]
    pub fn is_overtaken(&self, stopped: Stamp) -> bool {
        matches!(self.request, Request::Arm | Request::MoveHome) && self.sent <= stopped
    }

    /// Whether it is too old to be carried out at `now`. A stop is never too old.
    #[must_use]
    pub fn is_expired(&self, now: Stamp) -> bool {
        !matches!(self.request, Request::Stop | Request::Disarm) && now.since(self.stamp) > REQUEST_LIFE_NS
    }
}

/// The loop's answer to a [`LoopRequest`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopAnswer {
    /// Token of the request.
    pub token: u64,
    /// Whether it was carried out.
    pub outcome: Result<(), Refusal>,
    /// Mode after the tick that answered.
    pub mode: Mode,
    /// Trust in that tick.
    pub trust: Trust,
}
