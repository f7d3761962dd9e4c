//! One tick: receive, decide the budget, step the law, send, record.
//!
//! Contract: no allocation, lock, log, file or panic; work is bounded by capacities fixed at construction.
//! What does not fit into a ring is dropped and counted. The budget is decided before the step, from the
//! clock, and recorded, so that the step can be replayed. Absent: every decision about motion, which is the
//! follower's.

use rtrb::{Consumer, Producer, RingBuffer};

use foretrace_control::follower::{Budget, Follower, Health, Mode, Refusal, Request, StepInput, StepOutput};
use foretrace_control::predict::{LearnStep, OnlineWeights};
use foretrace_control::state;
use foretrace_control::stop::{StopDetail, StopReason};
use foretrace_control::units::{Stamp, Trust};

use super::clock::Clock;
use super::cyclic::Wake;
use super::external::ExternalDoor;
use super::facts::{
    LapClock, LoopAnswer, LoopRequest, LoopTally, SeenPen, SeenPreview, StateCopy, TickFacts,
};
use super::handover::{Mailbox, Outbox, Waiting, handover};
use super::os;
use super::overruns::{OverrunDecision, OverrunLimit, Overruns, Solve};
use super::stops::{StopTicket, Stops};
use crate::alloc_count::AllocationMeter;
use crate::ports::{Inbox, Ports};
use crate::wire::{Echo, Given, JOINTS, Outgoing};

/// Ticks between two reads of the page-fault counters, which cost a system call.
const FAULT_TICKS: u64 = 64;
/// Requests that may wait; the ring of answers has as much room, so that none is lost.
const REQUESTS: usize = 16;
/// Sets of weights that may wait; the newest wins.
const WEIGHTS: usize = 4;
/// Grid steps that may wait for the learner: 5 s at 10 ms.
const LEARN_STEPS: usize = 512;
/// Records that may wait for the ipc thread: half a second at 1 kHz.
const FACTS: usize = 512;
/// Pen samples that may wait for the ipc thread: some per record.
const SEEN_PEN: usize = 4096;
/// Previews of another process that may wait for the ipc thread: half a second at 10 ms.
const SEEN_PREVIEWS: usize = 64;
/// Room for the state of the law; a test knows how much of it is used.
pub const STATE_BYTES: usize = 1 << 20;

/// The loop's ends of the rings.
#[derive(Debug)]
pub struct TickRings {
    facts: Producer<TickFacts>,
    pen: Producer<SeenPen>,
    previews: Producer<SeenPreview>,
    blanks: Consumer<Box<[u8]>>,
    states: Producer<StateCopy>,
    requests: Consumer<LoopRequest>,
    answers: Producer<LoopAnswer>,
    learn: Producer<LearnStep>,
    weights: Mailbox<OnlineWeights>,
}

/// The ipc thread's ends.
#[derive(Debug)]
pub struct IpcRings {
    /// One record per tick.
    pub facts: Consumer<TickFacts>,
    /// The pen samples of the ticks.
    pub pen: Consumer<SeenPen>,
    /// The previews of another process that the ticks were given.
    pub previews: Consumer<SeenPreview>,
    /// Memory for the state of the law: the next tick fills it.
    pub blanks: Producer<Box<[u8]>>,
    pub states: Consumer<StateCopy>,
    /// Requests to the loop.
    pub requests: Producer<LoopRequest>,
    pub answers: Consumer<LoopAnswer>,
}

#[derive(Debug)]
pub struct LearnerRings {
    /// Grid steps that have closed, oldest first.
    pub learn: Consumer<LearnStep>,
    /// Promoted weights to the loop.
    pub weights: Outbox<OnlineWeights>,
}

/// All rings between the loop and the other threads.
#[must_use]
pub fn rings() -> (TickRings, IpcRings, LearnerRings) {
    let (facts, facts_out) = RingBuffer::new(FACTS);
    let (pen, pen_out) = RingBuffer::new(SEEN_PEN);
    let (previews, previews_out) = RingBuffer::new(SEEN_PREVIEWS);
    let (blanks_in, blanks) = RingBuffer::new(1);
    let (states, states_out) = RingBuffer::new(1);
    let (requests_in, requests) = RingBuffer::new(REQUESTS);
    let (answers, answers_out) = RingBuffer::new(REQUESTS);
    let (learn, learn_out) = RingBuffer::new(LEARN_STEPS);
    let (weights_in, weights) = handover(WEIGHTS);
    (
        TickRings { facts, pen, previews, blanks, states, requests, answers, learn, weights },
        IpcRings {
            facts: facts_out,
            pen: pen_out,
            previews: previews_out,
            blanks: blanks_in,
            states: states_out,
            requests: requests_in,
            answers: answers_out,
        },
        LearnerRings { learn: learn_out, weights: weights_in },
    )
}

#[derive(Debug)]
pub struct Tick<const N: usize, P> {
    follower: Follower<N, JOINTS>,
    ports: P,
    rings: TickRings,
    inbox: Inbox,
    period_ns: u64,
    max_iterations: u32,
    measured: Option<(Stamp, [f64; JOINTS])>,
    echo: Option<Echo>,
    weights_since: Option<Stamp>,
    /// Page faults of the thread before its first tick.
    faults_before: (u64, u64),
    /// After the last tick.
    mode: Mode,
    trust: Trust,
    tally: LoopTally,
    leaving: bool,
    /// The last command was not sent.
    unsent: bool,
    /// Token of the request for the way home that is still being checked.
    home_token: Option<u64>,
    stops: Stops,
    overruns: Overruns,
    external: ExternalDoor,
}

impl<const N: usize, P: Ports> Tick<N, P> {
    /// A body around `follower`; each QP gets at most `max_iterations`.
    pub fn new(follower: Follower<N, JOINTS>, ports: P, rings: TickRings, max_iterations: u32) -> Self {
        let settings = follower.settings();
        let period_ns = settings.period_ns;
        let external = ExternalDoor::new(settings.preview.kind, settings.pen.step_ns);
        Self {
            follower,
            ports,
            rings,
            inbox: Inbox::empty(),
            period_ns,
            max_iterations,
            measured: None,
            echo: None,
            weights_since: None,
            faults_before: (0, 0),
            mode: Mode::Idle,
            trust: Trust::NONE,
            tally: LoopTally::default(),
            leaving: false,
            unsent: false,
            home_token: None,
            stops: Stops::default(),
            overruns: Overruns::new(OverrunLimit::NONE, period_ns),
            external,
        }
    }

    /// Also takes stops from `stops`, and stops the arm if more ticks are late than `limit` allows.
    pub fn supervise(&mut self, stops: Stops, limit: OverrunLimit) {
        self.stops = stops;
        self.overruns = Overruns::new(limit, self.period_ns);
    }

    /// From the next tick on, stops the arm smoothly and lets go of it; requests are ignored.
    pub const fn leave(&mut self) {
        self.leaving = true;
    }

    /// Runs the tick that `wake` began; returns the mode after it.
    pub fn run<C: Clock>(&mut self, wake: &Wake, clock: &C) -> Mode {
        let mut laps = LapClock::new(clock, wake);
        if self.tally.ticks == 0 {
            self.faults_before = os::page_faults();
        }
        let mut allocations = AllocationMeter::start();
        self.inbox.asks_previews = self.external.asks();
        allocations.in_ports(|| self.ports.receive(wake.started, &mut self.inbox));
        self.measured = self.inbox.joints.map(|joints| (joints.stamp, joints.q)).or(self.measured);
        self.echo = self.inbox.echo.or(self.echo);
        let (request, stop) = self.requests(wake, &laps);
        let received = laps.received();

        let OverrunDecision { solve, stop: late } = self.overruns.decide(wake, received, self.tally.ticks);
        let budget = Budget { max_iterations: self.max_iterations, shed: solve != Solve::Wanted };
        // The weights are read in place in the ring: they are too large for a further copy.
        let waiting = self.rings.weights.look();
        let requested = stop.map(|_| (StopReason::Requested, StopDetail::default()));
        let input = StepInput {
            now: wake.release,
            pen: self.inbox.pen(),
            joints: self.inbox.joints.as_ref(),
            effort: self.inbox.effort.as_ref(),
            enable: self.inbox.enable,
            request: if self.leaving { Some(Request::Disarm) } else { request.map(|asked| asked.request) },
            halt: requested.or(late.map(|detail| (StopReason::Overruns, detail))),
            weights: waiting.as_ref().and_then(Waiting::newest),
            preview: self.inbox.preview.as_ref(),
            unsent: self.unsent,
        };
        let given = Given::of(&input, budget);
        let output = self.follower.step(&input, budget, &mut laps);
        if given.weights == Some(output.weights_version) {
            self.weights_since = Some(wake.release);
        }
        self.tally.weights_overtaken += waiting.map_or(0, Waiting::give_back);
        self.stops.report(stop, output.mode, output.trust.alpha);
        (self.mode, self.trust) = (output.mode, output.trust.alpha);

        let published = laps.last();
        self.unsent = !allocations.in_ports(|| self.send(published, &output));
        self.external.count(self.inbox.preview.as_ref(), &output, wake.started);
        allocations.in_ports(|| self.external.send(&mut self.ports, published, &output));
        let finished = laps.sent(wake.started);

        self.overruns.count(wake, finished, solve);
        self.count_outcome(wake, finished, &output, budget);
        self.offer_to_learner(&output);
        self.answer_requests(request, &output);
        if output.begins {
            self.overruns.forget();
        }
        self.record(wake, published, &laps, given, output, &mut allocations);
        output.mode
    }

    /// The request to carry out in this tick, and the stop that a program demanded, if there are any.
    fn requests<C: Clock>(
        &mut self,
        wake: &Wake,
        laps: &LapClock<'_, C>,
    ) -> (Option<LoopRequest>, Option<StopTicket>) {
        let request = if self.leaving { None } else { self.rings.requests.pop().ok() };
        // Not answered, so that the operator learns the truth: the loop did not answer in time.
        let request = request.filter(|request| !request.is_expired(wake.started));
        // After the requests: a stop that comes between the two looks is newer.
        let stop = self.stops.look(laps.now());
        match request {
            Some(overtaken) if overtaken.is_overtaken(self.stops.newest()) => {
                self.answer(overtaken.token, Err(Refusal::StopCame));
                (None, stop)
            }
            request => (request, stop),
        }
    }

    /// Hands the facts of this tick to the ipc thread, and the state of the law if it waits for one.
    #[inline]
    fn record<C: Clock>(
        &mut self,
        wake: &Wake,
        published: Stamp,
        laps: &LapClock<'_, C>,
        given: Given,
        output: StepOutput<JOINTS>,
        allocations: &mut AllocationMeter,
    ) {
        let (ports, law) = allocations.lap();
        self.tally.port_allocations = self.tally.port_allocations.wrapping_add(ports);
        self.tally.law_allocations = self.tally.law_allocations.wrapping_add(law);
        let complete = self.keep_pen() & self.keep_preview();
        let facts = TickFacts {
            tick: self.tally.ticks,
            given: Given { complete, ..given },
            wake: *wake,
            finished: laps.last(),
            deadline: wake.deadline(self.period_ns),
            times: laps.times(),
            measured: self.measured,
            published,
            echo: self.echo,
            not_sent: self.unsent,
            weights_since: self.weights_since,
            port_allocations: ports as u32,
            law_allocations: law as u32,
            output,
            tally: self.tally,
            ports: *self.ports.tally(),
            previews: self.external.tally(),
        };
        if self.rings.facts.push(facts).is_err() {
            self.tally.evidence_dropped += 1;
        }
        self.copy_state();
        // Reported with the next tick: this one's facts are on their way.
        let (_, recording) = allocations.lap();
        self.tally.law_allocations = self.tally.law_allocations.wrapping_add(recording);
    }

    /// Hands the pen samples of this tick to the ipc thread; `false` if there was no room for all.
    fn keep_pen(&mut self) -> bool {
        let (tick, pen) = (self.tally.ticks, &mut self.rings.pen);
        self.inbox.pen().iter().all(|reading| pen.push(SeenPen { tick, reading: *reading }).is_ok())
    }

    /// Hands the preview of another process to the ipc thread; `false` if there was no room for it.
    fn keep_preview(&mut self) -> bool {
        let Some(preview) = self.inbox.preview else { return true };
        self.rings.previews.push(SeenPreview { tick: self.tally.ticks, preview }).is_ok()
    }

    /// Copies the state of the law into memory that waits for it: after everything else.
    fn copy_state(&mut self) {
        let Ok(mut bytes) = self.rings.blanks.pop() else { return };
        let length = state::write(&self.follower, &mut bytes);
        // One copy is under way at a time, so that there is room.
        let _ = self.rings.states.push(StateCopy { tick: self.tally.ticks, length, bytes });
    }

    /// Answers the request of this tick, and that for the way home once it is known whether it is clear, or
    /// that a stop came before.
    fn answer_requests(&mut self, request: Option<LoopRequest>, output: &StepOutput<JOINTS>) {
        if let (Some(LoopRequest { token, request, .. }), Some(outcome)) = (request, output.answer) {
            if request == Request::MoveHome && outcome.is_ok() {
                self.home_token = Some(token);
            } else {
                self.answer(token, outcome);
            }
        }
        let ended = (output.mode != Mode::Homing).then_some(Err(Refusal::StopCame));
        if let Some(outcome) = output.way.or(ended)
            && let Some(token) = self.home_token.take()
        {
            self.answer(token, outcome);
        }
    }

    /// The ring has room for as many answers as requests, and the ipc thread asks no faster than it reads.
    fn answer(&mut self, token: u64, outcome: Result<(), Refusal>) {
        let (mode, trust) = (self.mode, self.trust);
        let _ = self.rings.answers.push(LoopAnswer { token, outcome, mode, trust });
    }

    /// Sends the command, if there is one; `true` also if there is none. A step that was held up for so long
    /// that its command is over sends nothing: consumers have braked by the one before.
    fn send(&mut self, now: Stamp, output: &StepOutput<JOINTS>) -> bool {
        let Some(command) = output.command else { return true };
        if now >= command.valid_until {
            self.tally.commands_over += 1;
            return false;
        }
        let outgoing = Outgoing {
            tick: self.tally.ticks.wrapping_add(1),
            command,
            mode: output.mode,
            rung: output.rung,
            begins: output.begins,
            pen_sequence: output.pen_origin.sequence,
            pen_stamp: output.pen_stamp,
        };
        self.ports.send(now, &outgoing)
    }

    /// Adds what became of this tick to the counts.
    fn count_outcome(&mut self, wake: &Wake, finished: Stamp, output: &StepOutput<JOINTS>, budget: Budget) {
        let tally = &mut self.tally;
        tally.ticks = tally.ticks.wrapping_add(1);
        tally.skipped = tally.skipped.saturating_add(wake.skipped);
        // A tick that woke after its period was over missed its deadline too, however fast it was.
        tally.overruns += u64::from(wake.skipped > 0 || finished > wake.deadline(self.period_ns));
        tally.shed += u64::from(budget.shed);
        tally.joints_stale += u64::from(output.health.has(Health::JOINTS_STALE));
        tally.weights_refused += u64::from(output.health.has(Health::WEIGHTS_REFUSED));
        if tally.ticks % FAULT_TICKS == 1 {
            let ((minor, major), (minor_before, major_before)) = (os::page_faults(), self.faults_before);
            tally.faults_minor = minor.saturating_sub(minor_before);
            tally.faults_major = major.saturating_sub(major_before);
        }
    }

    /// Sends the grid steps of this tick to the learner.
    fn offer_to_learner(&mut self, output: &StepOutput<JOINTS>) {
        for step in output.learn.iter().take(output.learn_count) {
            if self.rings.learn.push(*step).is_err() {
                self.tally.learn_dropped += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests;
