//! Cost of the tracking monitor per tick: `cargo run --release -p foretrace-control --example monitor_bench`.
//!
//! Six joints write, 34 ms late; one command and one joint state every 2 ms. Without the forward kinematics
//! of the measured tool, which the loop adds.

use std::hint::black_box;
use std::time::Instant;

use foretrace_control::arm::lag::LagEstimate;
use foretrace_control::monitor::{ArmKnowledge, Monitor, TrackingSettings};
use foretrace_control::units::Stamp;

const TICKS: u64 = 500_000;
const TICK_NS: u64 = 2_000_000;
const BEGIN_NS: u64 = 10_000_000_000;

fn joints(t_s: f64) -> [f64; 6] {
    std::array::from_fn(|j| 0.1 * (2.0 + j as f64) * (3.0 * t_s + j as f64).sin())
}

fn main() {
    let path: Vec<[f64; 6]> = (0..TICKS).map(|tick| joints(tick as f64 * 2e-3)).collect();
    for (name, lag) in [
        ("lag not known", None),
        ("lag known", Some(LagEstimate { lag_s: 0.034, std_s: 3e-4, shift_s: 0.033 })),
    ] {
        let mut monitor = Monitor::<6>::new(TrackingSettings::default(), 200_000_000, [3.1; 6]);
        monitor.begin(Stamp(BEGIN_NS));
        let mut costs = Vec::with_capacity(path.len());
        for (tick, q) in (1..).zip(&path) {
            let late = path.get((tick as usize).saturating_sub(18)).unwrap_or(q);
            let then = Instant::now();
            let stamp = Stamp(BEGIN_NS + tick * TICK_NS);
            let known = ArmKnowledge { lag, response: None };
            let wrong = monitor.measured(stamp, black_box(late), &known, |q| [q[0], q[1], q[2]]);
            assert!(wrong.is_none(), "{wrong:?}");
            monitor.commanded(stamp.plus_ns(TICK_NS), black_box(q), &[q[0], q[1], q[2]]);
            costs.push(then.elapsed().as_nanos());
        }
        costs.sort_unstable();
        let [median, p90, p99] = [0.5, 0.9, 0.99].map(|share| costs[(share * costs.len() as f64) as usize]);
        // Time taken by the machine for other work is not a cost of the monitor.
        let usual: u128 = costs.iter().take(costs.len() * 99 / 100).sum();
        let mean = usual as f64 / (costs.len() * 99 / 100) as f64;
        println!(
            "{name:<14} [ns] median {median}, 90 % {p90}, 99 % {p99}; mean of the lower 99 % {mean:.0}, a \
             clock reading included"
        );
    }
}
