//! One tick: receive, decide what may be spent, step the law, send, record.
//!
//! Contract: no allocation, lock, log, file or panic; work is bounded by capacities fixed at construction. What does not
//! fit into a ring is dropped and counted. The budget is decided before the step, from the clock, and recorded, so that
//! the step can be replayed. Absent on purpose: every decision about motion, which is the follower's.

use rtrb::{Consumer, Producer, RingBuffer};

use foretrace_control::follower::{
    Budget, Follower, Health, JointReading, Mode, Request, StepInput, StepOutput,
};
use foretrace_control::learn::LearnStep;
use foretrace_control::predict::DybmWeights;
use foretrace_control::units::Stamp;

use super::clock::Clock;
use super::cyclic::Wake;
use super::evidence::{Answered, Asked, Evidence, LapClock, LoopTally};
use super::os;
use crate::alloc_count::allocations;
use crate::ports::{Inbox, JOINTS, Outgoing, Ports};

/// Ticks between two looks at the page-fault counters, which cost a system call.
const FAULT_TICKS: u64 = 64;
/// Requests that may wait; as many answers fit, so that none is ever lost.
const REQUESTS: usize = 16;
/// Weights that may wait; the newest wins.
const WEIGHTS: usize = 4;
/// Grid steps that may wait for the learner: 5 s at 10 ms.
const LEARN_STEPS: usize = 512;
/// Records that may wait for the ipc thread: half a second at 1 kHz.
const EVIDENCE: usize = 512;

/// The loop's ends of the rings.
#[derive(Debug)]
pub struct TickRings {
    evidence: Producer<Evidence>,
    asked: Consumer<Asked>,
    answered: Producer<Answered>,
    learn: Producer<LearnStep>,
    weights: Consumer<DybmWeights>,
}

/// The ipc thread's ends.
#[derive(Debug)]
pub struct IpcRings {
    /// One record per tick.
    pub evidence: Consumer<Evidence>,
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
    pub weights: Producer<DybmWeights>,
}

/// All rings between the loop and the other threads.
#[must_use]
pub fn rings() -> (TickRings, IpcRings, LearnerRings) {
    let (evidence, evidence_out) = RingBuffer::new(EVIDENCE);
    let (asked_in, asked) = RingBuffer::new(REQUESTS);
    let (answered, answered_out) = RingBuffer::new(REQUESTS);
    let (learn, learn_out) = RingBuffer::new(LEARN_STEPS);
    let (weights_in, weights) = RingBuffer::new(WEIGHTS);
    (
        TickRings { evidence, asked, answered, learn, weights },
        IpcRings { evidence: evidence_out, asked: asked_in, answered: answered_out },
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
    /// Decaying maximum of what a step with full budget costs [ns].
    usual_cost_ns: u64,
    measured: Option<(Stamp, [f64; JOINTS])>,
    weights_since: Option<Stamp>,
    tally: LoopTally,
    leaving: bool,
}

impl<const N: usize, P: Ports> Tick<N, P> {
    /// A body around `follower`; each quadratic programme gets at most `max_iterations`.
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
            weights_since: None,
            tally: LoopTally::default(),
            leaving: false,
        }
    }

    /// From the next tick on, stops the arm smoothly and lets go of it; requests are no longer heard.
    pub const fn leave(&mut self) {
        self.leaving = true;
    }

    /// Runs the tick that `wake` began; returns the mode after it.
    pub fn run<C: Clock>(&mut self, wake: &Wake, clock: &C) -> Mode {
        let mut laps = LapClock::new(clock, wake);
        let allocated = allocations();

        self.ports.receive(wake.started, &mut self.inbox);
        let receiving = allocations().wrapping_sub(allocated);
        let asked = if self.leaving { None } else { self.rings.asked.pop().ok() };
        let request = if self.leaving { Some(Request::Disarm) } else { asked.map(|asked| asked.request) };
        let weights = self.newest_weights();
        if let Some(JointReading { stamp, q, .. }) = self.inbox.joints {
            self.measured = Some((stamp, q));
        }
        let received = laps.received();

        let budget = self.budget(received, wake);
        let input = StepInput {
            now: wake.release,
            pen: self.inbox.pen(),
            joints: self.inbox.joints.as_ref(),
            enable: self.inbox.enable,
            request,
            weights: weights.as_ref(),
        };
        let output = self.follower.step(&input, budget, &mut laps);

        let before_send = allocations();
        let not_sent = !self.send(laps.last(), &output);
        let sending = allocations().wrapping_sub(before_send);
        let finished = laps.sent(wake.started);

        if weights.is_some_and(|weights| weights.version == output.weights_version) {
            self.weights_since = Some(wake.release);
        }
        self.settle(wake, &output, budget, finished, &laps);
        self.teach(&output);
        if let (Some(asked), Some(outcome)) = (asked, output.answer) {
            // As many answers fit as requests, and the ipc thread asks no faster than it hears.
            let (mode, trust) = (output.mode, output.trust.alpha);
            let _ = self.rings.answered.push(Answered { token: asked.token, outcome, mode, trust });
        }
        let ports = receiving.wrapping_add(sending);
        let law = allocations().wrapping_sub(allocated).wrapping_sub(ports);
        self.tally.port_allocations = self.tally.port_allocations.wrapping_add(ports);
        self.tally.law_allocations = self.tally.law_allocations.wrapping_add(law);
        let evidence = Evidence {
            tick: self.tally.ticks,
            wake: *wake,
            finished,
            deadline: wake.deadline(self.period_ns),
            times: laps.times(),
            budget,
            pen_samples: self.inbox.pen().len() as u32,
            measured: self.measured,
            not_sent,
            weights_since: self.weights_since,
            port_allocations: ports as u32,
            law_allocations: law as u32,
            output,
            tally: self.tally,
            ports: *self.ports.tally(),
        };
        if self.rings.evidence.push(evidence).is_err() {
            self.tally.evidence_dropped += 1;
        }
        output.mode
    }

    /// The newest of the weights that wait.
    fn newest_weights(&mut self) -> Option<DybmWeights> {
        let mut newest = None;
        for _ in 0..WEIGHTS {
            match self.rings.weights.pop() {
                Ok(weights) => newest = Some(weights),
                Err(_) => break,
            }
        }
        newest
    }

    /// Sheds the solve when less time is left than it usually takes; half a period is always enough, so that a slow
    /// solver cannot talk itself out of work for ever.
    fn budget(&self, now: Stamp, wake: &Wake) -> Budget {
        let left = wake.deadline(self.period_ns).0.saturating_sub(now.0);
        let shed = left < self.usual_cost_ns.min(self.period_ns / 2);
        Budget { max_iterations: self.max_iterations, shed }
    }

    /// Sends the command, if there is one; `true` also when there is nothing to send.
    fn send(&mut self, now: Stamp, output: &StepOutput<JOINTS>) -> bool {
        let Some(command) = output.command else { return true };
        let outgoing = Outgoing {
            tick: self.tally.ticks.wrapping_add(1),
            command,
            mode: output.mode,
            rung: output.rung,
            resynchronised: output.health.has(Health::RESYNCHRONISED),
            pen_stamp: output.pen_stamp,
        };
        self.ports.send(now, &outgoing)
    }

    /// Counts.
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
        tally.overruns += u64::from(finished > wake.deadline(self.period_ns));
        tally.shed += u64::from(budget.shed);
        tally.joints_stale += u64::from(output.health.has(Health::JOINTS_STALE));
        tally.weights_refused += u64::from(output.health.has(Health::WEIGHTS_REFUSED));
        if tally.ticks % FAULT_TICKS == 1 {
            (tally.faults_minor, tally.faults_major) = os::page_faults();
        }
        if !budget.shed {
            let fading = self.usual_cost_ns - self.usual_cost_ns / 64;
            self.usual_cost_ns = fading.max(laps.times().step);
        }
    }

    /// Hands the grid steps of this tick to the learner.
    fn teach(&mut self, output: &StepOutput<JOINTS>) {
        for step in output.learn.iter().take(output.learn_count) {
            if self.rings.learn.push(*step).is_err() {
                self.tally.learn_dropped += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use foretrace_control::follower::{Refusal, Rung};
    use foretrace_control::guard::CommandChecker;
    use foretrace_control::pen::PenReading;

    use super::*;
    use crate::ports::PEN_PER_TICK;
    use crate::ports::memory::{MemoryPeer, MemoryPorts, pair};
    use crate::testing::config;

    /// Each reading takes 100 ns; the tests add what a tick shall cost.
    struct TestClock(Cell<u64>);

    impl Clock for TestClock {
        fn now(&self) -> Stamp {
            self.0.set(self.0.get() + 100);
            Stamp(self.0.get())
        }
        fn sleep_until(&self, instant: Stamp) {
            self.0.set(self.0.get().max(instant.0));
        }
    }

    struct Bench {
        tick: Tick<10, MemoryPorts>,
        peer: MemoryPeer,
        ipc: IpcRings,
        learner: LearnerRings,
        clock: TestClock,
        joints: JointReading<JOINTS>,
        checker: CommandChecker<JOINTS>,
        release: u64,
        index: u64,
    }

    impl Bench {
        fn new() -> Self {
            let config = config();
            let settings = config.follower_settings();
            let checker = CommandChecker::new(settings.limits);
            let q = settings.ik.home;
            let (ports, peer) = pair();
            let (rings, ipc, learner) = rings();
            let tick = Tick::new(Follower::new(settings).unwrap(), ports, rings, 100);
            let joints = JointReading { stamp: Stamp(0), q, qd: [0.0; JOINTS], motion_allowed: true };
            let clock = TestClock(Cell::new(0));
            Self { tick, peer, ipc, learner, clock, joints, checker, release: 10_000_000_000, index: 0 }
        }

        /// One period; the arm follows exactly.
        fn run(&mut self, late_ns: u64) -> Evidence {
            let period = self.tick.period_ns;
            self.joints.stamp = Stamp(self.release);
            self.peer.joints.push(self.joints).unwrap();
            self.clock.0.set(self.release + late_ns);
            let started = self.clock.now();
            let wake = Wake { index: self.index, release: Stamp(self.release), started, skipped: 0 };
            self.tick.run(&wake, &self.clock);
            self.release += period;
            self.index += 1;
            while let Ok(outgoing) = self.peer.commands.pop() {
                let command = outgoing.command;
                assert!(self.checker.observe(command.stamp, command.valid_until, &command.q, &command.qd));
                self.joints.q = command.q;
                self.joints.qd = command.qd;
            }
            self.ipc.evidence.pop().unwrap()
        }

        fn ask(&mut self, token: u64, request: Request) -> Answered {
            self.ipc.asked.push(Asked { token, request }).unwrap();
            self.run(0);
            self.ipc.answered.pop().unwrap()
        }

        fn pen(&mut self, position: [f64; 2]) {
            let reading = PenReading { stamp: Stamp(self.release), position, contact: true };
            self.peer.pen.push(reading).unwrap();
        }

        /// Follows a circle of 2 cm for `ticks`.
        fn follow(&mut self, ticks: u64) -> Evidence {
            let mut last = self.run(0);
            for k in 0..ticks {
                if k % 4 == 0 {
                    let angle = k as f64 * 0.01;
                    self.pen([0.02 * angle.cos(), 0.02 * angle.sin()]);
                }
                last = self.run(0);
            }
            last
        }
    }

    #[test]
    fn an_armed_loop_follows_the_pen_with_legal_commands() {
        let mut bench = Bench::new();
        let answer = bench.ask(7, Request::Arm);
        assert_eq!((answer.token, answer.outcome, answer.mode), (7, Ok(()), Mode::Armed));
        let last = bench.follow(1500);
        assert_eq!(last.output.mode, Mode::Following);
        assert_eq!(last.tally.ticks, 1502);
        assert_eq!(last.ports.commands_sent, 1502);
        assert_eq!(last.tally.overruns, 0);
        assert!(last.times.step > 0 && last.finished > last.wake.started);
        assert!(bench.learner.learn.slots() > 0);
    }

    #[test]
    fn a_refused_request_comes_back_with_its_reason() {
        let mut bench = Bench::new();
        bench.joints.qd = [0.5; JOINTS];
        assert_eq!(bench.ask(1, Request::Arm).outcome, Err(Refusal::ArmMoves));
        bench.joints.qd = [0.0; JOINTS];
        bench.joints.motion_allowed = false;
        assert_eq!(bench.ask(2, Request::Arm).outcome, Err(Refusal::MotionNotAllowed));
        bench.joints.motion_allowed = true;
        assert_eq!(bench.ask(3, Request::Arm).outcome, Ok(()));
        assert_eq!(bench.ask(4, Request::SetTrust(f64::NAN)).outcome, Err(Refusal::BadValue));
    }

    #[test]
    fn a_flood_of_pen_samples_is_taken_in_portions_and_none_is_lost() {
        let mut bench = Bench::new();
        let flood = 3 * PEN_PER_TICK as u64 + 5;
        for k in 0..flood {
            let stamp = Stamp(bench.release - 1_000_000 + k * 1000);
            bench.peer.pen.push(PenReading { stamp, position: [0.0; 2], contact: true }).unwrap();
        }
        let portions: Vec<_> = (0..5).map(|_| bench.run(0).pen_samples).collect();
        assert_eq!(portions, [64, 64, 64, 5, 0]);
        let last = bench.run(0);
        assert_eq!((last.ports.pen_received, last.ports.pen_deferred), (flood, 3));
    }

    #[test]
    fn a_tick_too_late_to_solve_sheds_and_says_so() {
        let mut bench = Bench::new();
        bench.ask(1, Request::Arm);
        bench.follow(500);
        let period = bench.tick.period_ns;
        let late = bench.run(period - 200);
        assert!(late.budget.shed);
        assert_eq!(late.output.rung, Rung::PreviousPlan);
        assert_eq!((late.tally.shed, late.tally.overruns), (1, 1));
        assert!(!bench.run(0).budget.shed);
    }

    #[test]
    fn a_slow_solver_is_not_shed_for_ever() {
        let mut bench = Bench::new();
        bench.tick.usual_cost_ns = 10 * bench.tick.period_ns;
        assert!(!bench.run(0).budget.shed);
    }

    #[test]
    fn a_ring_that_nobody_empties_drops_the_newest_and_counts_it() {
        let mut bench = Bench::new();
        for _ in 0..EVIDENCE + 10 {
            let wake =
                Wake { index: 0, release: Stamp(bench.release), started: Stamp(bench.release), skipped: 0 };
            bench.clock.0.set(bench.release);
            bench.tick.run(&wake, &bench.clock);
            bench.release += bench.tick.period_ns;
        }
        assert_eq!(bench.tick.tally.evidence_dropped, 10);
        let first = bench.ipc.evidence.pop().unwrap();
        assert_eq!(first.tick, 1);
    }

    #[test]
    fn of_several_weights_the_newest_is_used() {
        let mut bench = Bench::new();
        let weights = config().follower_settings().dybm_weights;
        for version in 1..=3 {
            bench.learner.weights.push(DybmWeights { version, ..weights }).unwrap();
        }
        let last = bench.run(0);
        assert_eq!(last.output.weights_version, 3);
        assert_eq!(last.weights_since, Some(last.wake.release));
        assert_eq!(last.tally.weights_refused, 0);
    }

    #[test]
    fn corrupted_weights_are_refused_and_counted() {
        let mut bench = Bench::new();
        let mut weights = config().follower_settings().dybm_weights;
        weights.version = 9;
        weights.parameters.bias = [f64::NAN, 0.0];
        bench.learner.weights.push(weights).unwrap();
        let last = bench.run(0);
        assert_eq!((last.tally.weights_refused, last.weights_since), (1, None));
        assert_ne!(last.output.weights_version, 9);
    }

    #[test]
    fn a_leaving_loop_brings_the_arm_to_rest_and_lets_go() {
        let mut bench = Bench::new();
        bench.ask(1, Request::Arm);
        bench.follow(800);
        bench.tick.leave();
        let mut ticks = 0;
        while bench.run(0).output.mode != Mode::Idle {
            ticks += 1;
            assert!(ticks < 1000, "still in charge after {ticks} ticks");
        }
        assert!(ticks > 1, "an arm in motion cannot stop at once");
        assert!(bench.joints.qd.iter().all(|qd| qd.abs() < 1e-9), "{:?}", bench.joints.qd);
    }
}
