//! Duration of the way home, its progress report, and the effect of lost time.

use crate::support::{Bench, HOME, PERIOD_NS, settings};
use foretrace_control::follower::{Budget, FollowerSettings, HomeProgress, Mode, Request, Rung};
use foretrace_control::predict::PredictorKind;

const PERIOD_S: f64 = PERIOD_NS as f64 * 1e-9;

fn start() -> [f64; 6] {
    let [first, rest @ ..] = HOME;
    let [b, c, d, e, f] = rest;
    [first + 0.4, b, c, d, e, f]
}

/// The loop on its way, in the tick in which it begins to move, and how long the whole way takes \[s\].
fn underway(settings: FollowerSettings<6>) -> (Bench, HomeProgress, f64) {
    let (_, _, seconds) = settings.way_home(&start()).unwrap();
    let mut bench = Bench::new(settings);
    bench.joints.q = start();
    let mut output = bench.tick_with(&[], Some(Request::MoveHome), Budget::default());
    for _ in 0..300 {
        let progress = output.home.expect("on its way");
        if progress.moving {
            return (bench, progress, seconds);
        }
        assert_eq!(progress.share, 0.0);
        assert!((progress.left_s - seconds).abs() < 1e-9, "{progress:?} of {seconds} s");
        output = bench.tick(&[]);
    }
    panic!("the way is never known");
}

#[test]
fn what_is_left_of_the_way_is_told_to_the_tick() {
    let (mut bench, mut told, seconds) = underway(settings(PredictorKind::HOLD));
    assert!((told.left_s - seconds).abs() <= 2.0 * PERIOD_S, "{told:?} of {seconds} s");
    let mut shares = 0;
    while told.left_s > 2.0 * PERIOD_S {
        let output = bench.tick(&[]);
        let now = output.home.unwrap();
        assert!((told.left_s - now.left_s - PERIOD_S).abs() < 1e-9, "{told:?} {now:?}");
        let gone = (start()[0] - output.command.unwrap().q[0]) / (start()[0] - HOME[0]);
        assert!((now.share - gone).abs() < 1e-6, "{now:?} {gone}");
        shares += u32::from(gone > 0.1 && gone < 0.9);
        told = now;
    }
    assert!(shares > 100, "{shares}");
    let last = (0..4).map(|_| bench.tick(&[])).last().unwrap();
    assert_eq!(last.home.map(|home| (home.share, home.left_s)), Some((1.0, 0.0)));
}

/// Seconds by the stamps until it arrives, and whether it stood on the way, if `lost` periods are lost in the
/// middle.
fn arrives(lost: u64) -> (f64, bool) {
    let (mut bench, ..) = underway(settings(PredictorKind::HOLD));
    let begin = bench.now;
    let mut stood = false;
    for tick in 0..5000 {
        if tick == 600 {
            bench.now = bench.now + lost * PERIOD_NS;
        }
        let output = bench.tick(&[]);
        if output.mode == Mode::Idle {
            return (bench.now.seconds_since(begin), stood);
        }
        let left_s = output.home.map_or(0.0, |home| home.left_s);
        stood |= output.rung != Rung::FreshPlan && left_s > 0.1;
    }
    panic!("it never arrives")
}

/// A consumer continues for 5 periods without commands.
#[test]
fn a_moment_lost_on_the_way_is_gone_along_and_a_longer_one_stops_it() {
    let (usual, stood) = arrives(0);
    assert!(!stood);
    for lost in [1, 3] {
        let (took, stood) = arrives(lost);
        assert!(!stood && (took - usual).abs() < 0.01, "{lost} periods: {took} s, {usual} s without");
    }
    let (took, stood) = arrives(30);
    assert!(stood && took > usual + 0.2, "{took} s, {usual} s without");
}
