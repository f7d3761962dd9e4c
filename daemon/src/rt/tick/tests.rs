//! The tick on ports inside this process, in simulated time.

mod halts;
mod ports;
mod way_home;

use std::cell::Cell;

use foretrace_control::follower::{EnableReading, JointReading, Rung};
use foretrace_control::guard::CommandChecker;
use foretrace_control::pen::PenReading;
use foretrace_control::predict::{ExternalPreview, PredictorKind};
use foretrace_shm::PenStep;

use super::*;
use crate::ports::{PEN_PER_TICK, PortTally};
use crate::testing::config;
use ports::{MemoryPeer, MemoryPorts, pair};

/// Simulated time; tests add the duration of a tick.
struct TestClock {
    now: Cell<u64>,
    /// What each reading takes \[ns\].
    reading_ns: Cell<u64>,
    readings: Cell<u64>,
    /// Each reading allocates.
    wasteful: Cell<bool>,
}

impl Clock for TestClock {
    fn now(&self) -> Stamp {
        self.readings.set(self.readings.get() + 1);
        if self.wasteful.get() {
            allocate();
        }
        self.now.set(self.now.get() + self.reading_ns.get());
        Stamp(self.now.get())
    }
    fn sleep_until(&self, instant: Stamp) {
        self.now.set(self.now.get().max(instant.0));
    }
}

fn allocate() {
    drop(std::hint::black_box(Box::new(0_u64)));
}

struct Bench<P = MemoryPorts> {
    tick: Tick<10, P>,
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
        Self::with_ports(|ports| ports)
    }
}

impl<P: Ports> Bench<P> {
    fn with_ports(wrap: impl FnOnce(MemoryPorts) -> P) -> Self {
        let config = config();
        let settings = config.follower_settings();
        let checker = CommandChecker::new(settings.limits);
        let q = settings.ik.home;
        let (ports, peer) = pair();
        let (rings, ipc, learner) = rings();
        let tick = Tick::new(Follower::new(settings).unwrap(), wrap(ports), rings, 100);
        let joints = JointReading { stamp: Stamp(0), q, qd: [0.0; JOINTS], motion_allowed: true };
        let clock = TestClock {
            now: Cell::new(0),
            reading_ns: Cell::new(100),
            readings: Cell::new(0),
            wasteful: Cell::new(false),
        };
        Self { tick, peer, ipc, learner, clock, joints, checker, release: 10_000_000_000, index: 0 }
    }

    /// One period; the arm follows exactly.
    fn run(&mut self, late_ns: u64) -> TickFacts {
        self.run_after(late_ns, 0)
    }

    /// The same after `skipped` periods.
    fn run_after(&mut self, late_ns: u64, skipped: u64) -> TickFacts {
        self.joints.stamp = Stamp(self.release);
        self.peer.joints.push(self.joints).unwrap();
        self.run_silent(late_ns, skipped);
        self.ipc.facts.pop().unwrap()
    }

    /// The same without a joint state.
    fn run_silent(&mut self, late_ns: u64, skipped: u64) {
        self.clock.now.set(self.release + late_ns);
        let (release, started) = (Stamp(self.release), self.clock.now());
        let wake = Wake { index: self.index, due: release, release, started, skipped };
        self.tick.run(&wake, &self.clock);
        self.release += self.tick.period_ns;
        self.index += 1;
        while let Ok(outgoing) = self.peer.commands.pop() {
            let command = outgoing.command;
            assert!(self.checker.observe(command.stamp, command.valid_until, &command.q, &command.qd));
            self.joints.q = command.q;
            self.joints.qd = command.qd;
        }
    }

    fn ask(&mut self, token: u64, request: Request) -> LoopAnswer {
        self.ipc
            .requests
            .push(LoopRequest { token, request, stamp: Stamp(self.release), sent: Stamp(self.release) })
            .unwrap();
        self.run(0);
        self.ipc.answers.pop().unwrap()
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
    let release = Stamp(bench.release);
    let wake = Wake { index: 0, due: release, release, started: release, skipped: 0 };
    bench.tick.overruns.count(&wake, release.plus_ns(10 * bench.tick.period_ns), Solve::Wanted);
    assert!(!bench.run(0).given.budget.shed);
}

#[test]
fn a_ring_that_nobody_empties_drops_the_newest_and_counts_it() {
    let mut bench = Bench::new();
    for _ in 0..FACTS + 10 {
        bench.run_silent(0, 0);
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
    bench
        .ipc
        .requests
        .push(LoopRequest { token: 1, request: Request::Arm, stamp: long_ago, sent: long_ago })
        .unwrap();
    bench.run(0);
    assert!(bench.ipc.answers.pop().is_err(), "an arm request of 1.5 s ago was carried out");
    // The first joint state arrived with the first tick.
    assert_eq!(bench.ask(2, Request::Arm).outcome, Ok(()));
    bench
        .ipc
        .requests
        .push(LoopRequest { token: 3, request: Request::Stop, stamp: long_ago, sent: long_ago })
        .unwrap();
    bench.run(0);
    assert_eq!(bench.ipc.answers.pop().unwrap().mode, Mode::Stopped);
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
    bench.clock.reading_ns.set(50_000_000);
    let held_up = bench.run(0);
    bench.clock.reading_ns.set(100);
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

/// Allocates once when it receives, and three times when it sends.
struct Wasteful(MemoryPorts);

impl Ports for Wasteful {
    fn receive(&mut self, now: Stamp, inbox: &mut Inbox) {
        allocate();
        self.0.receive(now, inbox);
    }
    fn send(&mut self, now: Stamp, outgoing: &Outgoing) -> bool {
        (0..3).for_each(|_| allocate());
        self.0.send(now, outgoing)
    }
    fn send_step(&mut self, now: Stamp, step: PenStep) {
        self.0.send_step(now, step);
    }
    fn tally(&self) -> &PortTally {
        self.0.tally()
    }
}

#[test]
fn allocations_belong_to_the_ports_or_to_the_law() {
    let mut bench = Bench::with_ports(Wasteful);
    assert_eq!(bench.ask(1, Request::Arm).outcome, Ok(()));
    let before = bench.run(0);
    assert_eq!((before.port_allocations, before.law_allocations), (4, 0));
    bench.clock.wasteful.set(true);
    bench.clock.readings.set(0);
    let last = bench.run(0);
    // The first reading is the bench's own, before the tick.
    let readings = bench.clock.readings.get() - 1;
    assert_eq!((last.port_allocations, u64::from(last.law_allocations)), (4, readings));
    assert_eq!(last.tally.port_allocations, before.tally.port_allocations + 4);
    assert_eq!(last.tally.law_allocations, before.tally.law_allocations + readings);
}

#[test]
fn skipped_periods_are_overruns_and_counted() {
    let mut bench = Bench::new();
    bench.run(0);
    let late = bench.run_after(0, 3);
    assert_eq!((late.tally.skipped, late.tally.overruns, late.tally.ticks), (3, 1, 2));
    let punctual = bench.run(0);
    assert_eq!((punctual.tally.skipped, punctual.tally.overruns), (3, 1));
    // A tick that ends at its deadline is in time, a nanosecond later it is not.
    bench.clock.readings.set(0);
    bench.run(0);
    let work_ns = 100 * bench.clock.readings.get();
    let latest = bench.tick.period_ns - work_ns;
    assert_eq!([latest, latest + 1].map(|late_ns| bench.run(late_ns).tally.overruns), [1, 2]);
}

#[test]
fn the_newest_joint_state_stays_known_in_a_tick_without_one() {
    let mut bench = Bench::new();
    let first = bench.run(0);
    assert_eq!(first.measured, Some((first.wake.release, bench.joints.q)));
    bench.run_silent(0, 0);
    let silent = bench.ipc.facts.pop().unwrap();
    assert_eq!((silent.given.joints, silent.measured), (None, first.measured));
    // Half a second later it is stale.
    bench.release += 500_000_000;
    bench.run_silent(0, 0);
    assert_eq!(bench.ipc.facts.pop().unwrap().tally.joints_stale, 1);
}

#[test]
fn pen_samples_and_grid_steps_that_find_no_room_are_owned_up_to() {
    let mut bench = Bench::new();
    for full in 0..SEEN_PEN / PEN_PER_TICK + 1 {
        for k in 0..PEN_PER_TICK as u64 {
            let reading = PenReading::new(Stamp(bench.release - 1_000_000 + k), [0.0; 2], true);
            bench.peer.pen.push(reading).unwrap();
        }
        assert_eq!(bench.run(0).given.complete, full < SEEN_PEN / PEN_PER_TICK, "{full}");
    }
    let seen = bench.ipc.pen.pop().unwrap();
    assert_eq!((seen.tick, bench.ipc.pen.slots()), (1, SEEN_PEN - 1));
    // Five ticks make a grid step.
    let last = bench.follow(5 * LEARN_STEPS as u64 + 100);
    assert_eq!(bench.learner.learn.slots(), LEARN_STEPS);
    assert!((1..=40).contains(&last.tally.learn_dropped), "{}", last.tally.learn_dropped);
}

#[test]
fn the_state_of_the_law_goes_into_memory_that_waits_for_it() {
    let mut bench = Bench::new();
    bench.run(0);
    assert!(bench.ipc.states.pop().is_err());
    bench.ipc.blanks.push(vec![0; STATE_BYTES].into_boxed_slice()).unwrap();
    let facts = bench.run(0);
    let copy = bench.ipc.states.pop().unwrap();
    let length = copy.length.unwrap();
    assert_eq!(copy.tick, facts.tick);
    let mut again = vec![0; STATE_BYTES];
    assert_eq!(state::write(&bench.tick.follower, &mut again), Some(length));
    assert!(copy.bytes[..length] == again[..length] && bench.ipc.blanks.slots() == 1);
}

#[test]
fn page_faults_are_those_since_the_first_tick_and_read_every_few_ticks() {
    let mut bench = Bench::new();
    let first = bench.run(0).tally.faults_minor;
    // More than the allocator keeps for reuse.
    let pages: Vec<u8> = std::hint::black_box(vec![1; 40 << 20]);
    for _ in 1..FAULT_TICKS {
        assert_eq!(bench.run(0).tally.faults_minor, first);
    }
    let later = bench.run(0).tally.faults_minor;
    assert!(first < 1000 && later > first, "{first}, {later}");
    drop(pages);
}

#[test]
fn the_newest_dead_man_message_reaches_the_law() {
    let mut bench = Bench::new();
    assert_eq!(bench.run(0).given.enable, None);
    let message = |stop| EnableReading { stamp: Stamp(bench.release), stop };
    let (first, newest) = (message(false), message(true));
    bench.peer.enable.push(first).unwrap();
    bench.peer.enable.push(newest).unwrap();
    assert_eq!(bench.run(0).given.enable, Some(newest));
}

/// The process answers every step with its displacement again and again.
#[test]
fn a_predictor_of_another_process_gets_the_steps_and_its_previews_are_taken_counted_and_kept() {
    let mut bench = Bench::new();
    bench.ask(1, Request::SwitchPredictor(PredictorKind::EXTERNAL));
    bench.ask(2, Request::Arm);
    let (mut steps, mut kept, mut next) = (0_u64, 0_u64, None);
    let mut last = bench.run(0);
    for k in 0..2000_u64 {
        if k % 4 == 0 {
            let angle = k as f64 * 0.01;
            bench.pen([0.02 * angle.cos(), 0.02 * angle.sin()]);
        }
        while let Ok(step) = bench.peer.steps.pop() {
            steps += 1;
            assert!(next.is_none_or(|next| step.index == next), "{} is no {next:?}", step.index);
            next = Some(step.index + 1);
            assert!(step.wanted as usize >= last.output.preview_steps && step.scale_m > 0.0);
            let mut preview = ExternalPreview { base_index: step.index, count: 64, ..ExternalPreview::EMPTY };
            for (ahead, slot) in (1..).map(f64::from).zip(&mut preview.positions) {
                *slot = [step.x_m + ahead * step.dx_m, step.y_m + ahead * step.dy_m];
            }
            if step.index.is_multiple_of(10) {
                preview.positions[3][0] = f64::NAN;
            }
            bench.peer.previews.push(preview).unwrap();
        }
        let taken = last.previews.taken;
        last = bench.run(0);
        assert_eq!((last.port_allocations, last.law_allocations), (0, 0));
        while let Ok(seen) = bench.ipc.previews.pop() {
            assert_eq!(seen.tick, last.tick);
            kept += 1;
        }
        // One that is refused answers no step.
        assert_eq!(last.previews.latency_ns.is_some(), last.previews.taken > taken);
    }
    assert!(steps > 300, "{steps}");
    let [_, non_finite, others @ ..] = last.previews.refused;
    assert_eq!(others, [0; 5]);
    assert!(last.previews.taken > 250 && non_finite > 25, "{:?}", last.previews);
    assert_eq!(last.previews.taken + non_finite, kept);
    assert_eq!(last.ports.steps_failed, 0);
    // Back to a built-in one: nothing is sent or asked for.
    bench.ask(3, Request::SwitchPredictor(PredictorKind::MIXTURE));
    bench.follow(600);
    while bench.peer.steps.pop().is_ok() {}
    bench.peer.previews.push(ExternalPreview::EMPTY).unwrap();
    let after = bench.follow(100);
    assert!(after.output.external.is_none() && !after.given.preview && bench.peer.steps.pop().is_err());
}
