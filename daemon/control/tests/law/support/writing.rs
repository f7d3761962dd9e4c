//! Writing with a known future, shared by the tests of trust and record.

use foretrace_control::follower::StepOutput;
use foretrace_control::predict::Oracle;
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{Bench, STEP_NS};

/// Writing with turns: accelerations up to 6 m/s².
pub(crate) fn curve(t: f64) -> [f64; 2] {
    [0.015 * (14.0 * t).sin(), 0.012 * (22.0 * t + 0.4).sin()]
}

/// Straight strokes of 60 ms between unpredictable points, starting and ending at rest.
pub(crate) fn scribble(t: f64) -> [f64; 2] {
    const STROKE_S: f64 = 0.06;
    const HALF_M: f64 = 0.01;
    let number = (t / STROKE_S).floor();
    let point = |number: f64| {
        let mut rng = Pcg64::seed_from_u64(number as u64);
        [0, 1].map(|_| rng.random_range(-HALF_M..HALF_M))
    };
    let s = t / STROKE_S - number;
    let part = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
    let ([x0, y0], [x1, y1]) = (point(number), point(number + 1.0));
    [x0 + part * (x1 - x0), y0 + part * (y1 - y0)]
}

/// The curve, in pieces of three seconds with rests of more than a second between them.
pub(crate) fn halting(t: f64) -> [f64; 2] {
    const MOVES_S: f64 = 3.0;
    const EVERY_S: f64 = 4.5;
    let pieces = (t / EVERY_S).floor();
    let s = ((t - pieces * EVERY_S) / MOVES_S).min(1.0);
    // Slow at its beginning and its end.
    let part = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
    curve(MOVES_S * 0.5 * (pieces + part))
}

/// Runs `ticks` of `path` at 200 Hz, and passes on every tick's output.
pub(crate) fn write(
    bench: &mut Bench,
    start: Stamp,
    ticks: u64,
    path: fn(f64) -> [f64; 2],
    mut seen: impl FnMut(&Bench, &StepOutput<6>),
) {
    for tick in 0..ticks {
        // 200 Hz, half of it between grid points.
        let due = tick % 5 == 0 || tick % 5 == 3;
        let samples = [bench.pen(path(bench.now.seconds_since(start)))];
        let output = bench.tick(if due { &samples } else { &[] });
        seen(bench, &output);
    }
}

pub(crate) fn oracle(start: Stamp, steps: u64, path: fn(f64) -> [f64; 2]) -> Oracle {
    let first = start.0 / STEP_NS;
    let at = |index: u64| path(((index * STEP_NS) as f64 - start.0 as f64) * 1e-9);
    let step = |i: u64| {
        let ([x0, y0], [x1, y1]) = (at(first + i), at(first + i + 1));
        [x1 - x0, y1 - y0]
    };
    Oracle::new(first + 1, (0..steps).map(step).collect())
}
