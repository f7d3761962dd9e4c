//! The tick on ports inside this process, in simulated time.

mod halts;
mod way_home;

use std::cell::Cell;

use foretrace_control::follower::{Refusal, Rung};
use foretrace_control::guard::CommandChecker;
use foretrace_control::pen::PenReading;

use super::*;
use crate::ports::PEN_PER_TICK;
use crate::ports::memory::{MemoryPeer, MemoryPorts, pair};
use crate::testing::config;

/// Each reading takes 100 ns, or as a test sets it; tests add the duration of a tick.
struct TestClock(Cell<u64>, Cell<u64>);

impl Clock for TestClock {
    fn now(&self) -> Stamp {
        self.0.set(self.0.get() + self.1.get());
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
        let clock = TestClock(Cell::new(0), Cell::new(100));
        Self { tick, peer, ipc, learner, clock, joints, checker, release: 10_000_000_000, index: 0 }
    }

    /// One period; the arm follows exactly.
    fn run(&mut self, late_ns: u64) -> TickFacts {
        let period = self.tick.period_ns;
        self.joints.stamp = Stamp(self.release);
        self.peer.joints.push(self.joints).unwrap();
        self.clock.0.set(self.release + late_ns);
        let started = self.clock.now();
        let wake = Wake {
            index: self.index,
            due: Stamp(self.release),
            release: Stamp(self.release),
            started,
            skipped: 0,
        };
        self.tick.run(&wake, &self.clock);
        self.release += period;
        self.index += 1;
        while let Ok(outgoing) = self.peer.commands.pop() {
            let command = outgoing.command;
            assert!(self.checker.observe(command.stamp, command.valid_until, &command.q, &command.qd));
            self.joints.q = command.q;
            self.joints.qd = command.qd;
        }
        self.ipc.facts.pop().unwrap()
    }

    fn ask(&mut self, token: u64, request: Request) -> Answered {
        self.ipc
            .asked
            .push(Asked { token, request, stamp: Stamp(self.release), sent: Stamp(self.release) })
            .unwrap();
        self.run(0);
        self.ipc.answered.pop().unwrap()
    }

    fn pen(&mut self, position: [f64; 2]) {
        let reading = PenReading::new(Stamp(self.release), position, true);
        self.peer.pen.push(reading).unwrap();
    }

    /// Follows a circle of 2 cm for `ticks`.
    fn follow(&mut self, ticks: u64) -> TickFacts {
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
        bench.peer.pen.push(PenReading::new(stamp, [0.0; 2], true)).unwrap();
    }
    let portions: Vec<_> = (0..5).map(|_| bench.run(0).given.pen_samples).collect();
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
    assert!(late.given.budget.shed);
    assert_eq!(late.output.rung, Rung::PreviousPlan);
    assert_eq!((late.tally.shed, late.tally.overruns), (1, 1));
    assert!(!bench.run(0).given.budget.shed);
}

#[test]
fn a_slow_solver_is_not_shed_for_ever() {
    let mut bench = Bench::new();
    bench.tick.usual_cost_ns = 10 * bench.tick.period_ns;
    assert!(!bench.run(0).given.budget.shed);
}

#[test]
fn a_ring_that_nobody_empties_drops_the_newest_and_counts_it() {
    let mut bench = Bench::new();
    for _ in 0..FACTS + 10 {
        let wake = Wake {
            index: 0,
            due: Stamp(bench.release),
            release: Stamp(bench.release),
            started: Stamp(bench.release),
            skipped: 0,
        };
        bench.clock.0.set(bench.release);
        bench.tick.run(&wake, &bench.clock);
        bench.release += bench.tick.period_ns;
    }
    assert_eq!(bench.tick.tally.evidence_dropped, 10);
    let first = bench.ipc.facts.pop().unwrap();
    assert_eq!(first.tick, 1);
}

#[test]
fn of_several_weights_the_newest_is_used() {
    let mut bench = Bench::new();
    let weights = config().follower_settings().weights;
    let mut before = 0;
    // Long enough for the ring to wrap around.
    for round in 0..5 {
        for version in before + 1..=before + 3 {
            bench.learner.weights.announce();
            assert!(bench.learner.weights.put(|| OnlineWeights { version, ..weights }));
        }
        before += 3;
        let last = bench.run(0);
        assert_eq!(last.output.weights_version, before);
        assert_eq!(last.tally.weights_overtaken, 2 * (round + 1));
    }
    let last = bench.run(0);
    assert!(last.weights_since.is_some_and(|since| since < last.wake.release));
    assert_eq!((last.tally.weights_refused, last.tally.weights_overtaken), (0, 10));
}

#[test]
fn corrupted_weights_are_refused_and_counted() {
    let good = config().follower_settings().weights;
    let mut bench = Bench::new();
    let mut refused = 0;
    for value in [f64::NAN, f64::INFINITY, 1e9, -1e300] {
        let mut sets = [OnlineWeights { version: 9, ..good }; 5];
        sets[0].dybm.version = 9;
        sets[0].dybm.parameters.bias = [value, 0.0];
        sets[1].dybm_esn.dybm.version = 9;
        sets[1].dybm_esn.readout[7] = [0.0, value];
        sets[2].ar_rls.version = 9;
        sets[2].ar_rls.coefficients[3][0][1] = value;
        sets[3].mixture.version = 9;
        sets[3].mixture.ar.coefficients[0][0][0] = value;
        sets[4].bands.factors[0][3] = value as f32;
        for poison in sets {
            bench.learner.weights.announce();
            assert!(bench.learner.weights.put(|| poison));
            refused += 1;
            let last = bench.run(0);
            assert_eq!((last.tally.weights_refused, last.weights_since), (refused, None));
            assert_eq!(bench.tick.follower.weights(), good);
        }
    }
}

#[test]
fn a_request_that_waited_too_long_is_not_carried_out_but_a_stop_is() {
    let mut bench = Bench::new();
    let long_ago = Stamp(bench.release - 1_500_000_000);
    bench.ipc.asked.push(Asked { token: 1, request: Request::Arm, stamp: long_ago, sent: long_ago }).unwrap();
    bench.run(0);
    assert!(bench.ipc.answered.pop().is_err(), "an arm request of 1.5 s ago was carried out");
    // The first joint state arrived with the first tick.
    assert_eq!(bench.ask(2, Request::Arm).outcome, Ok(()));
    bench
        .ipc
        .asked
        .push(Asked { token: 3, request: Request::Stop, stamp: long_ago, sent: long_ago })
        .unwrap();
    bench.run(0);
    assert_eq!(bench.ipc.answered.pop().unwrap().mode, Mode::Stopped);
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

#[test]
fn a_command_that_is_over_before_it_is_sent_stays_unsent_and_the_arm_goes_on_from_the_one_before() {
    let mut bench = Bench::new();
    bench.ask(1, Request::Arm);
    let before = bench.follow(800);
    let period = bench.tick.period_ns;
    // Each reading of the clock inside the step takes longer than a command is valid.
    bench.clock.1.set(50_000_000);
    let held_up = bench.run(0);
    bench.clock.1.set(100);
    assert!(held_up.not_sent && held_up.output.command.is_some());
    assert_eq!(held_up.ports.commands_sent, before.ports.commands_sent);
    assert_eq!((before.tally.commands_over, held_up.tally.commands_over), (0, 1));
    assert_eq!(bench.joints.q, before.output.command.unwrap().q);
    bench.release += 300 * period;
    // What is sent from here on is continuous with what was sent before, as the checker sees it.
    let after = bench.run(0);
    assert!(after.given.unsent && !after.not_sent);
    assert_eq!((after.output.mode, after.output.stop_reason), (Mode::Stopped, StopReason::TimeLost));
    assert!(!bench.run(0).given.unsent);
}
