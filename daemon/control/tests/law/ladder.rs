//! The degradation ladder: fresh plan, previous plan, jerk-limited stop, hold. Each rung, each transition
//! down and up, and no other. Every command is checked by `CommandChecker` (inside `support::Bench`).

use std::collections::BTreeSet;

use crate::support::{Bench, PERIOD_NS, settings};
use foretrace_control::arm::limits::stop_jerk;
use foretrace_control::follower::{Budget, Health, Mode, Request, Rung, StepInput, StepOutput};
use foretrace_control::predict::PredictorKind;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const SHED: Budget = Budget { max_iterations: 100, shed: true };

fn curve(t: f64) -> [f64; 2] {
    [0.015 * (11.0 * t).sin(), 0.012 * (17.0 * t).sin()]
}

/// A bench that follows the curve, and how far it has come.
struct Writer {
    bench: Bench,
    tick: u64,
}

impl Writer {
    /// Three seconds into the curve.
    fn writing() -> Self {
        let bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
        let mut writer = Self { bench, tick: 0 };
        for _ in 0..1500 {
            writer.write(None, Budget::default());
        }
        assert!(writer.write(None, Budget::default()).rung == Rung::FreshPlan && writer.speed() > 0.01);
        writer
    }

    /// One tick with a sample.
    fn write(&mut self, request: Option<Request>, budget: Budget) -> StepOutput<6> {
        let pen = [self.bench.pen(curve(self.tick as f64 * 0.002))];
        self.tick += 1;
        self.bench.tick_with(&pen, request, budget)
    }

    /// Fastest joint of the last command \[rad/s\].
    fn speed(&self) -> f64 {
        self.bench.last.map_or(0.0, |last| last.qd.iter().fold(0.0, |most: f64, v| most.max(v.abs())))
    }

    /// Writes with `budget` until the rung is `wanted`; how many ticks that took.
    fn until(&mut self, wanted: Rung, budget: Budget) -> u64 {
        for count in 1..500 {
            if self.write(None, budget).rung == wanted {
                return count;
            }
        }
        panic!("never {wanted:?}");
    }

    /// Distance of the commanded tool from the curve \[m\], apart from the lag of feedback.
    fn rms(&mut self, ticks: u64) -> f64 {
        let mut sum = 0.0;
        for _ in 0..ticks {
            let [x, y] = curve(self.tick as f64 * 0.002);
            let [tool_x, tool_y, _] = self.write(None, Budget::default()).tool;
            sum += (tool_x - x).powi(2) + (tool_y - y).powi(2);
        }
        (sum / ticks as f64).sqrt()
    }
}

#[test]
fn one_shed_tick_costs_next_to_nothing() {
    let (mut whole, mut shed) = (Writer::writing(), Writer::writing());
    let usual = whole.rms(500);
    assert_eq!(shed.write(None, SHED).rung, Rung::PreviousPlan);
    assert_eq!(shed.write(None, Budget::default()).rung, Rung::FreshPlan);
    assert!(shed.rms(498) < 1.05 * usual);
    // Every other tick shed: the previous tick's plan, at its second period.
    let mut alternating = Writer::writing();
    let mut sum = 0.0;
    for tick in 0..500 {
        let [x, y] = curve(alternating.tick as f64 * 0.002);
        let output = alternating.write(None, if tick % 2 == 0 { SHED } else { Budget::default() });
        assert_eq!(output.rung, [Rung::PreviousPlan, Rung::FreshPlan][tick % 2]);
        sum += (output.tool[0] - x).powi(2) + (output.tool[1] - y).powi(2);
    }
    let rms = (sum / 500.0).sqrt();
    assert!(rms < 1.3 * usual, "{rms} m with every other tick shed, {usual} m usually");
}

#[test]
fn previous_plan_is_taken_at_the_true_elapsed_time() {
    let (mut steady, mut stalled) = (Writer::writing(), Writer::writing());
    let mut last = None;
    for _ in 0..5 {
        last = Some(steady.write(None, SHED));
    }
    stalled.bench.now = stalled.bench.now + 4 * PERIOD_NS;
    stalled.tick += 4;
    let output = stalled.write(None, SHED);
    let steady = last.unwrap();
    assert_eq!((steady.rung, output.rung), (Rung::PreviousPlan, Rung::PreviousPlan));
    assert_eq!(steady.command.unwrap().stamp, output.command.unwrap().stamp);
    for axis in 0..2 {
        let apart = (steady.setpoint[axis].position - output.setpoint[axis].position).abs();
        let way = steady.setpoint[axis].velocity.abs() * 0.008;
        assert!(apart < 0.2 * way + 5e-5, "axis {axis}: {apart} m apart, {way} m were covered meanwhile");
    }
    // Beyond its validity it is not used at all.
    let mut lost = Writer::writing();
    lost.bench.now = lost.bench.now + 60_000_000;
    assert!(matches!(lost.write(None, SHED).rung, Rung::Stop | Rung::Hold));
}

#[test]
fn stop_is_left_while_moving_and_hold_from_rest() {
    let mut writer = Writer::writing();
    let usual = writer.rms(500);
    writer.until(Rung::Stop, SHED);
    assert!(writer.speed() > 1e-3, "not moving any more");
    assert_eq!(writer.write(None, Budget::default()).rung, Rung::FreshPlan);
    writer.rms(250);
    assert!(writer.rms(500) < 1.05 * usual);

    writer.until(Rung::Hold, SHED);
    assert_eq!(writer.speed(), 0.0);
    let output = writer.write(None, Budget::default());
    assert_eq!((output.mode, output.rung), (Mode::Following, Rung::FreshPlan));
    writer.rms(250);
    assert!(writer.rms(500) < 1.05 * usual);
}

#[test]
fn stop_changes_acceleration_gradually_without_a_jerk_limit_in_the_settings() {
    let period_s = PERIOD_NS as f64 * 1e-9;
    // From several moments of the writing: while accelerating, decelerating, turning.
    for more in (0..300).step_by(7) {
        let mut writer = Writer::writing();
        let mut before: Option<[f64; 6]> = None;
        let mut qdd = [0.0; 6];
        let limits = settings(PredictorKind::CONSTANT_VELOCITY).limits;
        assert_eq!(limits.jerk(), None);
        let jerk = stop_jerk(&limits);
        let mut moved = 0.0_f64;
        for tick in 0..more + 200 {
            let request = (tick == more).then_some(Request::Stop);
            let qd = writer.write(request, Budget::default()).command.unwrap().qd;
            if let Some(before) = before {
                for joint in 0..6 {
                    let now = (qd[joint] - before[joint]) / period_s;
                    let change = (now - qdd[joint]).abs();
                    // The first difference of three has no acceleration before it.
                    if tick >= more && tick > 1 {
                        moved = moved.max(qd[joint].abs());
                        let most = jerk[joint] * period_s;
                        assert!(change <= most * (1.0 + 1e-6) + 1e-6, "tick {tick}, joint {joint}: {change}");
                    }
                    qdd[joint] = now;
                }
            }
            before = Some(qd);
        }
        assert!(before == Some([0.0; 6]) && (moved > 0.01 || more < 2), "{more}: {moved}");
    }
}

#[test]
fn latched_stop_goes_down_from_every_rung_and_up_only_by_arming() {
    type Case = (Rung, fn(&mut Writer));
    let prepare: [Case; 4] = [
        (Rung::FreshPlan, |_| {}),
        (Rung::PreviousPlan, |writer| assert_eq!(writer.until(Rung::PreviousPlan, SHED), 1)),
        (Rung::Stop, |writer| assert!(writer.until(Rung::Stop, SHED) > 1)),
        (Rung::Hold, |writer| assert!(writer.until(Rung::Hold, SHED) > 1)),
    ];
    for (rung, prepare) in prepare {
        let mut writer = Writer::writing();
        prepare(&mut writer);
        let mut output = writer.write(Some(Request::Stop), Budget::default());
        let mut ticks = 0;
        while output.rung != Rung::Hold {
            assert_eq!((output.mode, output.rung), (Mode::Stopped, Rung::Stop), "from {rung:?}");
            output = writer.write(None, Budget::default());
            ticks += 1;
            assert!(ticks < 300, "from {rung:?}: no rest");
        }
        assert_eq!(ticks == 0, rung == Rung::Hold, "from {rung:?}");
        // Whatever the input now, it stays at rest; the command says that the arm may not move.
        for tick in 0..200 {
            let output = writer.write(None, if tick % 3 == 0 { SHED } else { Budget::default() });
            assert_eq!((output.mode, output.rung), (Mode::Stopped, Rung::Hold), "from {rung:?}");
            assert!(output.command.is_some_and(|command| !command.enabled && command.qd == [0.0; 6]));
        }
        assert_eq!(writer.write(Some(Request::Arm), Budget::default()).answer, Some(Ok(())), "from {rung:?}");
        assert_eq!(writer.write(None, Budget::default()).rung, Rung::FreshPlan, "from {rung:?}");
    }
}

#[test]
fn all_ways_that_there_are_and_no_other() {
    use Rung::{FreshPlan as F, Hold as H, PreviousPlan as P, Stop as S};
    // A stop clears the plan, so that nothing returns to it; nothing at rest begins a stop.
    let ways = [(F, P), (P, F), (F, S), (P, S), (S, F), (F, H), (P, H), (S, H), (H, F)];
    let allowed: BTreeSet<String> = ways.iter().map(|(from, to)| format!("{from:?} to {to:?}")).collect();
    let mut seen = BTreeSet::new();
    let mut random = Pcg64::seed_from_u64(5);
    let mut writer = Writer::writing();
    let mut before = writer.write(None, Budget::default());
    let mut shed_for = 0;
    for _ in 0..150_000 {
        if random.random_bool(0.02) {
            shed_for = [1, 1, 5, 40, 120][random.random_range(0..5)];
        }
        let budget = if shed_for > 0 { SHED } else { Budget::default() };
        shed_for = i32::max(shed_for - 1, 0);
        if random.random_bool(0.003) {
            writer.bench.now = writer.bench.now + random.random_range(1..80) * 1_000_000;
        }
        let latched = matches!(before.mode, Mode::Stopped | Mode::Fault);
        let request = match random.random_range(0..400) {
            0 => Some(Request::Stop),
            _ if latched && random.random_bool(0.05) => Some(Request::Arm),
            _ => None,
        };
        let output = if random.random_bool(0.9) {
            writer.write(request, budget)
        } else {
            let input = StepInput { request, ..StepInput::nothing(writer.bench.now) };
            writer.bench.step(&input, budget)
        };
        let armed = request == Some(Request::Arm) && output.answer == Some(Ok(()));
        if latched && !armed {
            let down = matches!((before.rung, output.rung), (S, S | H) | (H, H));
            assert!(down, "latched, and {:?} to {:?}", before.rung, output.rung);
        }
        if output.rung != before.rung {
            seen.insert(format!("{:?} to {:?}", before.rung, output.rung));
        }
        let fallback = output.health.has(Health::FALLBACK);
        assert!(fallback || output.rung != P, "the previous plan without a word");
        before = output;
    }
    assert_eq!(seen, allowed);
}

#[test]
fn the_way_home_stands_on_the_first_rung_and_its_end_on_the_last_two() {
    for stopped in [false, true] {
        let mut bench = Bench::new(settings(PredictorKind::HOLD));
        bench.joints.q[0] += 0.2;
        let mut rungs = Vec::new();
        for tick in 0..3000 {
            let request = match tick {
                0 => Some(Request::MoveHome),
                700 if stopped => Some(Request::Stop),
                _ => None,
            };
            let before = bench.joints.q;
            let output = bench.tick_with(&[], request, Budget::default());
            let moves = bench.joints.q != before;
            if rungs.last() != Some(&(output.rung, moves)) {
                rungs.push((output.rung, moves));
            }
        }
        rungs.retain(|(_, moves)| *moves);
        let expected: &[_] = if stopped { &[Rung::FreshPlan, Rung::Stop] } else { &[Rung::FreshPlan] };
        assert!(rungs.iter().map(|(rung, _)| rung).eq(expected), "{stopped}: {rungs:?}");
    }
}
