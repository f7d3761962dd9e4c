//! Times `Mpc::plan` (three axes, N = 10) on a closed loop of synthetic handwriting, by number of active
//! limits.
//!
//! `cargo run --release -p foretrace-control --example mpc_bench`: instances come in pseudo-random order,
//! every backend once per instance, so caches are about as cold as in a real tick. The clock's own cost is
//! measured and printed, not subtracted.

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Instant;

use foretrace_clarabel::ClarabelProfile;
use foretrace_control::mpc::{AxisLimits, Gains, Mpc, MpcSettings, Plan, SoftPenalty};
use foretrace_control::qp::backend::Backend;
use foretrace_control::units::{AxisState, Trust};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const N: usize = 10;
const STEP_S: f64 = 0.01;
const TICK_S: f64 = 0.002;

/// Inputs of the plan of one tick.
#[derive(Clone, Copy)]
struct Instance {
    start: [AxisState; 3],
    held: [AxisState; 3],
    preview: [[AxisState; N]; 3],
}

/// A pen that oscillates at 1.5-5.5 Hz about a point that jumps every 0.6 s.
struct Pen {
    parts: [[(f64, f64, f64); 2]; 3],
    jumps: Vec<(f64, [f64; 3])>,
}

impl Pen {
    fn new(rng: &mut Pcg64Mcg, seconds: f64) -> Self {
        let mut part = |largest: f64| {
            let hertz = rng.random_range(1.5..5.5);
            (rng.random_range(0.2..1.0) * largest / hertz, hertz * TAU, rng.random_range(0.0..TAU))
        };
        let parts = [[part(0.015), part(0.015)], [part(0.015), part(0.015)], [part(0.002), part(0.002)]];
        let mut jumps = vec![(0.0, [0.0; 3])];
        let mut time = 0.0;
        while time < seconds {
            time += rng.random_range(0.2..1.0);
            jumps.push((time, [0, 1, 2].map(|_| rng.random_range(-0.006..0.006))));
        }
        Self { parts, jumps }
    }

    fn at(&self, axis: usize, time: f64) -> AxisState {
        let centre = self.jumps.iter().rev().find(|jump| jump.0 <= time).map_or(0.0, |jump| jump.1[axis]);
        let mut state = AxisState::at_rest(centre);
        for (amplitude, omega, phase) in self.parts[axis] {
            let (sin, cos) = (omega * time + phase).sin_cos();
            state.position += amplitude * sin;
            state.velocity += amplitude * omega * cos;
            state.acceleration -= amplitude * omega * omega * sin;
        }
        state
    }
}

fn settings(backend: Backend) -> MpcSettings {
    let limits =
        AxisLimits { jerk_mps3: 400.0, acceleration_mps2: 8.0, velocity_mps: 0.5, position_m: [-0.1, 0.1] };
    MpcSettings {
        step_s: STEP_S,
        gains_feedback: [Gains::FEEDBACK; 3],
        gains_feedforward: [Gains::FEEDFORWARD; 3],
        effort: Gains::EFFORT,
        axes: [limits; 3],
        soft_penalty: SoftPenalty::DEFAULT,
        backend,
        max_iterations: 200,
        servo_s: 0.0,
        unlimited: false,
    }
}

/// Closed-loop instances with the number of active limits of each.
fn workload(trust: Trust) -> Vec<(Instance, u32)> {
    let mut rng = Pcg64Mcg::seed_from_u64(7);
    let seconds = 60.0;
    let pen = Pen::new(&mut rng, seconds);
    let mut mpc = Mpc::<N>::new(&settings(Backend::Exact)).expect("legal settings");
    let mut plan = Plan::resting(STEP_S);
    let mut start = [0, 1, 2].map(|axis| pen.at(axis, 0.0));
    let mut instances = Vec::new();
    let mut time = 0.0;
    while time < seconds {
        let preview =
            [0, 1, 2].map(|axis| std::array::from_fn(|i| pen.at(axis, time + (i + 1) as f64 * STEP_S)));
        let held = [0, 1, 2].map(|axis| AxisState::at_rest(pen.at(axis, time).position));
        let instance = Instance { start, held, preview };
        let report = mpc.plan(&start, &held, &preview, trust, 200, &mut plan);
        assert!(report.usable(), "{report:?}");
        instances.push((instance, report.active()));
        start = plan.state_at(TICK_S).expect("inside the horizon");
        time += TICK_S;
    }
    instances
}

fn median_and_p99(times: &mut [f64]) -> (f64, f64) {
    times.sort_by(f64::total_cmp);
    (times[times.len() / 2], times[times.len() * 99 / 100])
}

fn main() {
    let backends = [
        ("exact", Backend::Exact, 40),
        ("clarabel tuned", Backend::Other(&ClarabelProfile::Tuned), 1),
        ("clarabel default", Backend::Other(&ClarabelProfile::Default), 1),
    ];
    let mut clock: Vec<f64> = (0..10_000)
        .map(|_| {
            let begin = Instant::now();
            begin.elapsed().as_nanos() as f64 * 1e-3
        })
        .collect();
    println!("clock alone: {:.3} us", median_and_p99(&mut clock).0);
    let instances = workload(Trust::FULL);
    let bins: [(&str, std::ops::RangeInclusive<u32>); 4] =
        [("0", 0..=0), ("1-2", 1..=2), ("3-8", 3..=8), ("9+", 9..=1000)];
    println!(
        "{:>6} {:>7} {:>18} {:>9} {:>9} {:>8}",
        "active", "share", "backend", "p50 us", "p99 us", "steps"
    );
    for (name, range) in bins {
        let chosen: Vec<&Instance> = instances
            .iter()
            .filter(|(_, active)| range.contains(active))
            .map(|(instance, _)| instance)
            .collect();
        if chosen.is_empty() {
            continue;
        }
        let share = chosen.len() as f64 / instances.len() as f64 * 100.0;
        for (label, backend, repeats) in backends {
            let mut rng = Pcg64Mcg::seed_from_u64(11);
            let mut mpc = Mpc::<N>::new(&settings(backend)).expect("legal settings");
            let mut plan = Plan::resting(STEP_S);
            let mut times = Vec::new();
            let mut steps = 0;
            for _ in 0..500 * repeats {
                // Copied beforehand: in a tick the preview has just been computed.
                let instance = black_box(*chosen[rng.random_range(0..chosen.len())]);
                let begin = Instant::now();
                let report = mpc.plan(
                    black_box(&instance.start),
                    &instance.held,
                    &instance.preview,
                    Trust::FULL,
                    200,
                    &mut plan,
                );
                times.push(begin.elapsed().as_nanos() as f64 * 1e-3);
                steps += black_box(report).iterations();
            }
            let mean_steps = f64::from(steps) / times.len() as f64;
            let (p50, p99) = median_and_p99(&mut times);
            println!("{name:>6} {share:>6.1}% {label:>18} {p50:>9.3} {p99:>9.3} {mean_steps:>8.1}");
        }
    }

    // α moves at every plan: H is factored anew each time.
    let mut mpc = Mpc::<N>::new(&settings(Backend::Exact)).expect("legal settings");
    let mut plan = Plan::resting(STEP_S);
    let mut times = Vec::new();
    for (k, (instance, _)) in instances.iter().enumerate().filter(|(_, (_, active))| *active == 0) {
        let trust = Trust::new(0.5 + (k % 7) as f64 * 0.01);
        let begin = Instant::now();
        black_box(mpc.plan(&instance.start, &instance.held, &instance.preview, trust, 200, &mut plan));
        times.push(begin.elapsed().as_nanos() as f64 * 1e-3);
    }
    let (p50, p99) = median_and_p99(&mut times);
    println!("ramping trust, mostly 0 active: {p50:.3} us, p99 {p99:.3} us");
}
