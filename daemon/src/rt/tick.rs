//! One tick: receive, decide the budget, step the law, send, record.
//!
//! Contract: no allocation, lock, log, file or panic; work is bounded by capacities fixed at construction.
//! What does not fit into a ring is dropped and counted. The budget is decided before the step, from the
//! clock, and recorded, so that the step can be replayed. Absent: every decision about motion, which is the
//! follower's.

use rtrb::{Consumer, Producer, RingBuffer};

use foretrace_control::follower::{
    Budget, Follower, Health, JointReading, Mode, Refusal, Request, StepInput, StepOutput,
};
use foretrace_control::predict::LearnStep;
use foretrace_control::predict::OnlineWeights;
use foretrace_control::state;
use foretrace_control::stop::{StopDetail, StopReason};
use foretrace_control::units::{Stamp, Trust};

use super::clock::Clock;
use super::cyclic::Wake;
use super::facts::{Answered, Asked, LapClock, LoopTally, SeenPen, StateCopy, TickFacts};
use super::handover::{Mailbox, Outbox, Waiting, handover};
use super::os;
use super::overruns::{OverrunBudget, OverrunLimit, Solve, Verdict};
use super::stops::Stops;
use crate::alloc_count::allocations;
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
/// Room for the state of the law; a test knows how much of it is used.
pub const STATE_BYTES: usize = 1 << 20;

/// The loop's ends of the rings.
#[derive(Debug)]
pub struct TickRings {
    facts: Producer<TickFacts>,
    pen: Producer<SeenPen>,
    blanks: Consumer<Box<[u8]>>,
    states: Producer<StateCopy>,
    asked: Consumer<Asked>,
    answered: Producer<Answered>,
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
    /// Memory for the state of the law: the next tick fills it.
    pub blanks: Producer<Box<[u8]>>,
    /// That memory, filled.
    pub states: Consumer<StateCopy>,
    /// Requests to the loop.
    pub asked: Producer<Asked>,
    /// Its answers.
    pub answered: Consumer<Answered>,
}

/// The learner's ends.
#[derive(Debug)]
pub struct LearnerRings {
    /// Closed grid steps.
    pub learn: Consumer<LearnStep>,
    /// Promoted weights to the loop.
    pub weights: Outbox<OnlineWeights>,
}

/// All rings between the loop and the other threads.
#[must_use]
pub fn rings() -> (TickRings, IpcRings, LearnerRings) {
    let (facts, evidence_out) = RingBuffer::new(FACTS);
    let (pen, pen_out) = RingBuffer::new(SEEN_PEN);
    let (blanks_in, blanks) = RingBuffer::new(1);
    let (states, states_out) = RingBuffer::new(1);
    let (asked_in, asked) = RingBuffer::new(REQUESTS);
    let (answered, answered_out) = RingBuffer::new(REQUESTS);
    let (learn, learn_out) = RingBuffer::new(LEARN_STEPS);
    let (weights_in, weights) = handover(WEIGHTS);
    (
        TickRings { facts, pen, blanks, states, asked, answered, learn, weights },
        IpcRings {
            facts: evidence_out,
            pen: pen_out,
            blanks: blanks_in,
            states: states_out,
            asked: asked_in,
            answered: answered_out,
        },
        LearnerRings { learn: learn_out, weights: weights_in },
    )
}

/// The loop's body.
#[derive(Debug)]
pub struct Tick<const N: usize, P> {
    follower: Follower<N, JOINTS>,
    ports: P,
    rings: TickRings,
    inbox: Inbox,
    period_ns: u64,
    max_iterations: u32,
    /// Decaying maximum of the duration of a step with full budget \[ns\].
    usual_cost_ns: u64,
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
    way_asked: Option<u64>,
    stops: Stops,
    overruns: OverrunBudget,
}

impl<const N: usize, P: Ports> Tick<N, P> {
    /// A body around `follower`; each QP gets at most `max_iterations`.
    pub fn new(follower: Follower<N, JOINTS>, ports: P, rings: TickRings, max_iterations: u32) -> Self {
        let period_ns = follower.settings().period_ns;
        Self {
            follower,
            ports,
            rings,
            inbox: Inbox::empty(),
            period_ns,
            max_iterations,
            usual_cost_ns: 0,
            measured: None,
            echo: None,
            weights_since: None,
            faults_before: (0, 0),
            mode: Mode::Idle,
            trust: Trust::NONE,
            tally: LoopTally::default(),
            leaving: false,
            unsent: false,
            way_asked: None,
            stops: Stops::default(),
            overruns: OverrunBudget::new(OverrunLimit::NONE),
        }
    }

    /// Also takes stops from `stops`, with a limit on late ticks.
    pub fn mind(&mut self, stops: Stops, overruns: OverrunLimit) {
        self.stops = stops;
        self.overruns = OverrunBudget::new(overruns);
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
        let allocated = allocations();

        self.ports.receive(wake.started, &mut self.inbox);
        let receiving = allocations().wrapping_sub(allocated);
        let asked = if self.leaving { None } else { self.rings.asked.pop().ok() };
        // Not answered, so that the operator learns the truth: the loop did not answer in time.
        let asked = asked.filter(|asked| !asked.is_expired(wake.started));
        // After the requests: a stop that comes between the two looks is newer.
        let stop = self.stops.look(laps.now());
        let overtaken = asked.filter(|asked| asked.is_overtaken(self.stops.newest()));
        if let Some(Asked { token, .. }) = overtaken {
            self.answer(token, Err(Refusal::StopCame), self.mode, self.trust);
        }
        let asked = asked.filter(|_| overtaken.is_none());
        let request = if self.leaving { Some(Request::Disarm) } else { asked.map(|asked| asked.request) };
        if let Some(JointReading { stamp, q, .. }) = self.inbox.joints {
            self.measured = Some((stamp, q));
        }
        self.echo = self.inbox.echo.or(self.echo);
        let received = laps.received();

        let verdict = self.overruns.verdict(wake.release);
        let (budget, solve) = self.budget(received, wake, verdict);
        // The weights are read in place in the ring: they are too large for a further copy.
        let waiting = self.rings.weights.look();
        let weights = waiting.as_ref().and_then(Waiting::newest);
        let input = StepInput {
            now: wake.release,
            pen: self.inbox.pen(),
            joints: self.inbox.joints.as_ref(),
            effort: self.inbox.effort.as_ref(),
            enable: self.inbox.enable,
            request,
            halt: match (stop, verdict) {
                (Some(_), _) => Some((StopReason::Requested, StopDetail::default())),
                (None, Verdict::Stop(detail)) => Some((StopReason::Overruns, detail)),
                (None, Verdict::Fine | Verdict::Shed) => None,
            },
            weights,
            unsent: self.unsent,
        };
        let given = Given {
            now: input.now,
            budget,
            joints: self.inbox.joints,
            effort: self.inbox.effort,
            enable: input.enable,
            request,
            halt: input.halt,
            weights: weights.map(|weights| weights.version),
            unsent: input.unsent,
            pen_samples: input.pen.len() as u32,
            complete: true,
        };
        let output = self.follower.step(&input, budget, &mut laps);
        self.stops.tell(stop, output.mode, output.trust.alpha);
        (self.mode, self.trust) = (output.mode, output.trust.alpha);
        let exchanged = weights.is_some_and(|weights| weights.version == output.weights_version);
        if let Some(waiting) = waiting {
            self.tally.weights_overtaken += waiting.give_back();
        }

        let before_send = allocations();
        let published = laps.last();
        self.unsent = !self.send(published, &output);
        let sending = allocations().wrapping_sub(before_send);
        let finished = laps.sent(wake.started);

        if exchanged {
            self.weights_since = Some(wake.release);
        }
        // Time that a busy machine takes from the sleeping loop is not its own work: that delay passes by
        // itself.
        let overslept = wake.release.0.saturating_sub(wake.due.0) / self.period_ns.max(1);
        let too_long = finished.0.saturating_sub(wake.started.0) > self.period_ns;
        self.overruns.count(wake.skipped.saturating_sub(overslept), too_long, solve);
        self.settle(wake, &output, budget, finished, &laps);
        self.teach(&output);
        if let (Some(asked), Some(outcome)) = (asked, output.answer) {
            if asked.request == Request::MoveHome && outcome.is_ok() {
                self.way_asked = Some(asked.token);
            } else {
                self.answer(asked.token, outcome, output.mode, output.trust.alpha);
            }
        }
        self.answer_way(&output);
        if output.begins {
            self.overruns.forget();
        }
        let ports = receiving.wrapping_add(sending);
        let law = allocations().wrapping_sub(allocated).wrapping_sub(ports);
        self.tally.port_allocations = self.tally.port_allocations.wrapping_add(ports);
        self.tally.law_allocations = self.tally.law_allocations.wrapping_add(law);
        let before_keeping = allocations();
        let complete = self.keep_pen();
        let facts = TickFacts {
            tick: self.tally.ticks,
            given: Given { complete, ..given },
            wake: *wake,
            finished,
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
        };
        if self.rings.facts.push(facts).is_err() {
            self.tally.evidence_dropped += 1;
        }
        self.copy_state();
        // Told with the next tick: this one's facts are on their way.
        let keeping = allocations().wrapping_sub(before_keeping);
        self.tally.law_allocations = self.tally.law_allocations.wrapping_add(keeping);
        output.mode
    }

    /// Hands the pen samples of this tick to the ipc thread; `false` if there was no room for all.
    fn keep_pen(&mut self) -> bool {
        let (tick, pen) = (self.tally.ticks, &mut self.rings.pen);
        self.inbox.pen().iter().all(|reading| pen.push(SeenPen { tick, reading: *reading }).is_ok())
    }

    /// Copies the state of the law into memory that waits for it: after everything else.
    fn copy_state(&mut self) {
        let Ok(mut bytes) = self.rings.blanks.pop() else { return };
        let length = state::write(&self.follower, &mut bytes);
        // One copy is under way at a time, so that there is room.
        let _ = self.rings.states.push(StateCopy { tick: self.tally.ticks, length, bytes });
    }

    /// Answers whether the way home is clear, once that is known, or that a stop came before.
    fn answer_way(&mut self, output: &StepOutput<JOINTS>) {
        let ended = (output.mode != Mode::Homing).then_some(Err(Refusal::StopCame));
        let outcome = output.way.or(ended);
        if let Some((token, outcome)) = outcome.and_then(|outcome| Some((self.way_asked.take()?, outcome))) {
            self.answer(token, outcome, output.mode, output.trust.alpha);
        }
    }

    /// The ring has room for as many answers as requests, and the ipc thread asks no faster than it reads.
    fn answer(&mut self, token: u64, outcome: Result<(), Refusal>, mode: Mode, trust: Trust) {
        let _ = self.rings.answered.push(Answered { token, outcome, mode, trust });
    }

    /// Sheds the solve if less time is left than it usually takes; half a period is always enough, so that a
    /// slow solver is not shed for ever. A loop that is late too often solves in every second tick.
    fn budget(&self, now: Stamp, wake: &Wake, verdict: Verdict) -> (Budget, Solve) {
        let left = wake.deadline(self.period_ns).0.saturating_sub(now.0);
        let solve = if verdict == Verdict::Shed && self.tally.ticks.is_multiple_of(2) {
            Solve::ShedForRelief
        } else if left < self.usual_cost_ns.min(self.period_ns / 2) {
            Solve::ShedForTime
        } else {
            Solve::Done
        };
        (Budget { max_iterations: self.max_iterations, shed: solve != Solve::Done }, solve)
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

    /// Updates the counts.
    fn settle<C: Clock>(
        &mut self,
        wake: &Wake,
        output: &StepOutput<JOINTS>,
        budget: Budget,
        finished: Stamp,
        laps: &LapClock<'_, C>,
    ) {
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
        if !budget.shed {
            let fading = self.usual_cost_ns - self.usual_cost_ns / 64;
            self.usual_cost_ns = fading.max(laps.times().step);
        }
    }

    /// Sends the grid steps of this tick to the learner.
    fn teach(&mut self, output: &StepOutput<JOINTS>) {
        for step in output.learn.iter().take(output.learn_count) {
            if self.rings.learn.push(*step).is_err() {
                self.tally.learn_dropped += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests;
