//! Stops that the shell demands: by the flag, and because ticks are late.

use std::sync::Arc;

use foretrace_control::stop::StopCause;

use super::*;
use crate::rt::stops::StopFlag;

impl Bench {
    fn supervised(flag: &Arc<StopFlag>, share: f64, window: usize) -> Self {
        let mut bench = Self::new();
        bench.tick.supervise(Stops::new(flag.clone()), OverrunLimit { share, window });
        bench
    }

    /// One tick whose work takes longer than its period.
    fn run_long(&mut self) -> TickFacts {
        self.clock.reading_ns.set(self.tick.period_ns / 2);
        let facts = self.run(0);
        self.clock.reading_ns.set(100);
        facts
    }

    /// One tick with a request that was sent `ago_ns` before its release; the answer.
    fn ask_sent(&mut self, request: Request, ago_ns: u64) -> Result<(), Refusal> {
        let (stamp, sent) = (Stamp(self.release), Stamp(self.release - ago_ns));
        self.ipc.requests.push(LoopRequest { token: 9, request, stamp, sent }).unwrap();
        self.run(0);
        self.ipc.answers.pop().unwrap().outcome
    }
}

fn following(flag: &Arc<StopFlag>) -> Bench {
    let mut bench = Bench::supervised(flag, 0.5, 100);
    assert_eq!(bench.ask(1, Request::Arm).outcome, Ok(()));
    assert_eq!(bench.follow(800).output.mode, Mode::Following);
    bench
}

fn to_rest(bench: &mut Bench) {
    for ticks in 0.. {
        assert!(ticks < 1000, "the arm never comes to rest");
        if bench.run(0).output.command.is_none_or(|command| !command.enabled) {
            break;
        }
    }
}

#[test]
fn a_flag_set_at_any_moment_latches_in_the_next_tick_and_is_reported() {
    let flag = Arc::new(StopFlag::default());
    for by_signal in [false, true] {
        let mut bench = following(&flag);
        let number = if by_signal {
            flag.signal().store(true, std::sync::atomic::Ordering::Release);
            0
        } else {
            flag.ask()
        };
        let last = bench.run(0);
        assert_eq!((last.output.mode, last.output.stop_reason), (Mode::Stopped, StopReason::Requested));
        if !by_signal {
            let stopped = u32::from(crate::wire::mode(Mode::Stopped));
            assert_eq!(flag.outcome(number).unwrap().0, stopped);
        }
        to_rest(&mut bench);
        // Consumed: arming works again without another stop.
        assert_eq!(bench.ask_sent(Request::Arm, 0), Ok(()));
        assert_eq!(bench.follow(200).output.mode, Mode::Following);
    }
}

#[test]
fn arming_never_undoes_a_stop_that_came_after_it_was_asked_for() {
    let flag = Arc::new(StopFlag::default());
    // In the very tick in which the arm would be taken over, from idle and from rest.
    let mut bench = Bench::supervised(&flag, 0.5, 100);
    bench.run(0);
    flag.ask();
    assert_eq!(bench.ask_sent(Request::Arm, 1_000), Err(Refusal::StopCame));
    assert_eq!(bench.run(0).output.mode, Mode::Idle);
    // Sent before that stop, received after it.
    assert_eq!(bench.ask_sent(Request::Arm, 20_000_000), Err(Refusal::StopCame));
    // Sent after it.
    assert_eq!(bench.ask_sent(Request::Arm, 0), Ok(()));
    assert_eq!(bench.run(0).output.mode, Mode::Armed);
    flag.ask();
    assert_eq!(bench.ask_sent(Request::Arm, 1_000), Err(Refusal::StopCame));
    assert_eq!(bench.run(0).output.mode, Mode::Stopped);
    // Other requests do not start motion, and are accepted.
    flag.ask();
    assert_eq!(bench.ask_sent(Request::SetTrust(0.5), 20_000_000), Ok(()));
}

#[test]
fn a_stop_is_taken_while_the_loop_sheds_and_is_late() {
    let flag = Arc::new(StopFlag::default());
    let mut bench = following(&flag);
    let period = bench.tick.period_ns;
    flag.ask();
    let last = bench.run(period - 200);
    assert!(last.given.budget.shed);
    assert_eq!(last.output.mode, Mode::Stopped);
}

#[test]
fn ticks_that_stay_late_shed_solves_first_and_then_latch_with_their_share() {
    let flag = Arc::new(StopFlag::default());
    let mut bench = following(&flag);
    let (mut shed, mut ticks) = (0, 0);
    let last = loop {
        let before = bench.tick.tally.overruns;
        // Only solving ticks are late, as with a solver that is too slow.
        let release = Stamp(bench.release);
        let wake = Wake { index: 0, due: release, release, started: release, skipped: 0 };
        let solve = bench.tick.overruns.decide(&wake, release, bench.tick.tally.ticks).solve;
        let solves = solve != Solve::ShedForRelief;
        let last = if solves { bench.run_long() } else { bench.run(0) };
        assert_eq!(bench.tick.tally.overruns > before, solves);
        // A tick that starts late sheds by itself; here only the others count.
        shed += u64::from(last.given.budget.shed && !solves);
        ticks += 1;
        assert!(ticks < 400, "never latched");
        if last.output.mode == Mode::Stopped {
            break last;
        }
    };
    assert!((50..150).contains(&ticks) && shed > 5, "{ticks} ticks, {shed} shed");
    let detail = last.output.stop_detail;
    assert_eq!((last.output.stop_reason, detail.cause), (StopReason::Overruns, StopCause::LateTicks));
    assert!(detail.amount > 0.5 && detail.limit == 0.5, "{detail:?}");
    // Arming restores the whole budget.
    to_rest(&mut bench);
    assert_eq!(bench.ask_sent(Request::Arm, 0), Ok(()));
    for _ in 0..40 {
        assert_ne!(bench.run_long().output.mode, Mode::Stopped);
    }
}

#[test]
fn a_loop_that_is_late_now_and_then_is_never_stopped() {
    let flag = Arc::new(StopFlag::default());
    let mut bench = following(&flag);
    for tick in 0..2000_u64 {
        if tick % 4 == 0 {
            let angle = tick as f64 * 0.01;
            bench.pen([0.02 * angle.cos(), 0.02 * angle.sin()]);
        }
        // Two of five.
        let last = if tick % 5 < 2 { bench.run_long() } else { bench.run(0) };
        assert_eq!(last.output.mode, Mode::Following, "tick {tick}");
    }
}

#[test]
fn what_a_busy_machine_takes_while_the_loop_sleeps_stops_nothing() {
    let flag = Arc::new(StopFlag::default());
    let mut bench = following(&flag);
    let period = bench.tick.period_ns;
    for tick in 0..500_u64 {
        bench.pen([0.02, 0.001 * (tick % 3) as f64]);
        let last = bench.run(period + 500_000);
        assert_eq!(last.output.mode, Mode::Following, "tick {tick}");
    }
    assert!(bench.tick.tally.overruns >= 500);
}
