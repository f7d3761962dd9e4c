//! Times one IK step with and without clearance rows, on the same motion.
//!
//! `cargo run --release -p foretrace-control --example clearance_bench`: an arm writes at its home pose, and
//! presses on the table. Kinematics, motion and target of every tick are recorded and then given to both
//! solvers in turn, so that both see the same machine load. Forward kinematics are timed too, as part of a
//! tick. Medians over ticks of the smallest of a few repetitions; the clock's own cost is included in both.

use std::hint::black_box;
use std::time::Instant;

use foretrace_control::arm::{Chain, JointLimits, JointMotion};
use foretrace_control::clearance::{Clearance, ClearanceSettings, Obstacle};
use foretrace_control::ik::{Ik, IkSettings, ToolTarget};
use nalgebra::Vector3;

const TICK_S: f64 = 2e-3;
const TICKS: usize = 5_000;
const REPEATS: usize = 5;
const HOME: [f64; 6] = [0.0, -1.48188, 2.10901, -2.19792, -std::f64::consts::FRAC_PI_2, 0.0];

type Tick = (JointMotion<6>, ToolTarget);

fn main() {
    let urdf = include_str!("../../../config/robots/ur5.urdf");
    let chain = Chain::<6>::from_urdf(urdf, None, None).expect("the embedded arm");
    let limits = JointLimits::new(chain.limits().position, chain.limits().velocity, [40.0; 6])
        .and_then(|limits| limits.with_stale_braking(5.0 * TICK_S, [20.0; 6]))
        .expect("limits as in the preset");
    let table = Obstacle::plane([0.0; 3], [0.0, 0.0, 1.0]).expect("a plane");
    let wall = Obstacle::plane([0.0, -0.5, 0.0], [0.0, 1.0, 0.0]).expect("a plane");
    let crate_ = Obstacle::cuboid([-0.5, 0.5, 0.1], [0.2, 0.2, 0.2], [0.0; 3]).expect("a box");
    let scenes = [
        ("itself, as in the preset", vec![]),
        ("itself, table", vec![table]),
        ("itself, table, wall, box", vec![table, wall, crate_]),
    ];
    println!("median [ns] of forward kinematics + IK step, {TICKS} ticks: without, with, ratio");
    for (scene, obstacles) in scenes {
        let keep = ClearanceSettings { margin_m: 0.01, itself: true, obstacles };
        let clearance = Clearance::new(&chain, &limits, TICK_S, &keep).expect("a clearance");
        let plain = || Ik::new(limits, IkSettings::for_period(TICK_S, HOME));
        for (motion, depth, speed) in
            [("standing", 0.0, 0.0), ("writing", 0.0, 1.0), ("pressing down", 0.3, 1.0)]
        {
            let ticks = recorded(&chain, plain().keeping_clear(clearance.clone()), depth, speed);
            let mut rows = 0;
            let mut times = [vec![f64::INFINITY; TICKS], vec![f64::INFINITY; TICKS]];
            for _ in 0..REPEATS {
                let (mut without, mut with) = (plain(), plain().keeping_clear(clearance.clone()));
                rows = 0;
                for (at, tick) in ticks.iter().enumerate() {
                    let order = if at % 2 == 0 { [0, 1] } else { [1, 0] };
                    for which in order {
                        let ik = if which == 0 { &mut without } else { &mut with };
                        let begin = Instant::now();
                        let kinematics = chain.forward(black_box(&tick.0.q));
                        let step = black_box(ik.step(&kinematics, &tick.0, &tick.1, TICK_S));
                        let spent = begin.elapsed().as_nanos() as f64;
                        rows += usize::from(which == 1 && step.report.clearance.rows > 0);
                        if let Some(best) = times.get_mut(which).and_then(|times| times.get_mut(at)) {
                            *best = best.min(spent);
                        }
                    }
                }
            }
            let [without, with] = times.map(median);
            println!(
                "{scene:26} {motion:14} {without:7.0} {with:7.0}  {:.2}   ({rows} ticks with rows)",
                with / without
            );
        }
    }
}

/// Inputs of the IK of an arm at home whose tool draws letters, and is pulled down by `depth` \[m\]
/// meanwhile.
fn recorded(chain: &Chain<6>, mut ik: Ik<6>, depth: f64, speed: f64) -> Vec<Tick> {
    let start = chain.forward(&HOME).position;
    let path = |t: f64| {
        let letter = Vector3::new((11.0 * t).sin(), 1.0 - (7.0 * t).cos(), 0.0) * (0.02 * speed);
        start + letter - Vector3::z() * (depth * (0.5 * t).min(1.0))
    };
    let mut motion = JointMotion::at_rest(HOME);
    let mut ticks = Vec::with_capacity(TICKS);
    for tick in 0..TICKS {
        let t = tick as f64 * TICK_S;
        let velocity = (path(t + TICK_S) - path(t)) / TICK_S;
        let target = ToolTarget { position: path(t), velocity, axis: -Vector3::z(), spin: None };
        ticks.push((motion, target));
        let step = ik.step(&chain.forward(&motion.q), &motion, &target, TICK_S);
        for (((q, qd), qdd), next) in
            motion.q.iter_mut().zip(&mut motion.qd).zip(&mut motion.qdd).zip(&step.qd)
        {
            *q += next * TICK_S;
            *qdd = (next - *qd) / TICK_S;
            *qd = *next;
        }
    }
    ticks
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or(f64::NAN)
}
