//! A tool far from its pen: its references, and whether it writes there.

use crate::support::writing::{oracle, write};
use crate::support::{Bench, PERIOD_NS, settings};
use foretrace_control::follower::{Budget, Rung};
use foretrace_control::predict::PredictorKind;
use foretrace_control::trust::TrustRequest;
use foretrace_control::units::Trust;

/// Round and round on 10 cm, after a rest, up to 0.9 m/s within a second.
fn circle(t: f64) -> [f64; 2] {
    let t = (t - 1.5).max(0.0);
    let angle = if t < 1.0 { 4.5 * t * t } else { 9.0 * t - 4.5 };
    [0.1 * angle.cos(), 0.1 * angle.sin()]
}

/// 80 ms ahead of its newest sample the pen is 7 cm farther, which must not count as a lost pen.
#[test]
fn a_tool_that_is_where_the_pen_is_foreseen_writes_there_however_far_that_is_from_the_sample() {
    let mut wanted = settings(PredictorKind::HOLD);
    wanted.dead_time_ns = 80_000_000;
    wanted.trust_request = TrustRequest::Manual(Trust::FULL);
    let mut bench = Bench::armed(wanted);
    let start = bench.now;
    bench.follower.use_oracle(oracle(start, 1000, circle));
    let (mut ticks, mut farthest) = (0, 0.0_f64);
    write(&mut bench, start, 5_000_000_000 / PERIOD_NS, circle, |_, output| {
        let t = output.command.unwrap().stamp.seconds_since(start);
        let [x, y] = output.pen_position;
        let off = (output.tool[0] - x).hypot(output.tool[1] - y);
        if t > 3.0 {
            assert!(output.tool[2].abs() < 1e-3, "{t} s: lifted to {} m", output.tool[2]);
            farthest = farthest.max(off);
            ticks += 1;
        }
    });
    assert!(farthest > 0.06 && ticks > 900, "{farthest} m, {ticks} ticks");
}

/// With few solver steps there is no plan for far targets: less is asked for, until there is one.
#[test]
fn a_starved_solver_is_asked_for_what_it_can_plan() {
    for max_iterations in [3, 6] {
        let mut bench = Bench::armed(settings(PredictorKind::CONSTANT_VELOCITY));
        let (mut planned, mut way) = (0, 0.0);
        let mut before = None;
        for tick in 0..5000_u64 {
            let corner = [[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]][(tick / 500 % 4) as usize];
            let pen = bench.pen(corner);
            let output = bench.tick_with(&[pen], None, Budget { max_iterations, ..Budget::default() });
            planned += u32::from(output.rung == Rung::FreshPlan);
            let [x, y, _] = output.tool;
            way += before.replace([x, y]).map_or(0.0, |[px, py]: [f64; 2]| (x - px).hypot(y - py));
        }
        println!("{max_iterations} steps: {planned} plans, {way} m");
        assert!(planned > 3500 && way > 0.5, "{max_iterations} steps: {planned} plans, {way} m");
    }
}
