//! Through and into the singularities of a UR: every command legal and continuous (`Arm::tick` checks with
//! the guard), slow where the arm must be, never a halt, and exact again afterwards.

use crate::support::reaching;

use reaching::*;

use foretrace_control::clearance::{Clearance, ClearanceSettings};
use foretrace_control::ik::{Ik, IkSettings, IkSource, ToolTarget};
use nalgebra::Vector3;

/// Results of a run.
#[derive(Debug)]
struct Passage {
    nearest: f64,
    hardest: f64,
    left: f64,
}

/// Out along `direction` and back in `period` seconds, then 2 s of rest: the tool's axis leans by `lean`
/// meanwhile.
fn passage(q: [f64; 6], direction: Vector3<f64>, lean: Vector3<f64>, period: f64, keep: bool) -> Passage {
    let chain = chain(UR5);
    let mut arm = Arm::new(&chain, q, 40.0);
    if keep {
        let itself = ClearanceSettings { margin_m: 0.01, itself: true, obstacles: Vec::new() };
        let kept = Clearance::new(&chain, &limits(&chain, 40.0), TICK_S, &itself).unwrap();
        arm.ik = Ik::new(limits(&chain, 40.0), IkSettings::for_period(TICK_S, q)).keeping_clear(kept);
    }
    let (start, axis) = arm.tool();
    let share = |t: f64| 0.5 - 0.5 * (std::f64::consts::TAU * (t / period).min(1.0)).cos();
    let mut run = Passage { nearest: f64::INFINITY, hardest: 0.0, left: f64::INFINITY };
    let ticks = ((period + 2.0) / TICK_S) as u32;
    let mut last: Option<[f64; 6]> = None;
    let mut stood = 0;
    for tick in 0..ticks {
        let t = f64::from(tick) * TICK_S;
        let [now, next] = [t, t + TICK_S].map(|t| start + direction * share(t));
        let target = ToolTarget {
            velocity: (next - now) / TICK_S,
            ..ToolTarget::at_rest(now, (axis + lean * share(t)).normalize(), None)
        };
        let report = arm.tick(&target);
        assert_eq!(report.source, IkSource::Optimum, "{t}");
        run.nearest = run.nearest.min(report.singularity);
        let qd = *arm.last.qd();
        if let Some(before) = last {
            let change = qd.iter().zip(&before).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
            run.hardest = run.hardest.max(change / TICK_S);
        }
        last = Some(qd);
        // Standing for 0.2 s although the arm could make the wanted motion would be a halt.
        let wanted = target.velocity.norm() > 0.02;
        let stands = qd.iter().all(|v| v.abs() < 1e-4);
        stood = if wanted && stands { stood + 1 } else { 0 };
        assert!(stood < 100, "halted at {t}: {report:?}");
        run.left = (arm.tool().0 - start).norm();
    }
    run
}

#[test]
fn singularities_slow_the_arm_and_let_it_go_again() {
    // Wrist 2 begins near zero, and the wanted axis leads it across.
    let [mut beside, mut beyond] = [UR5_HOME; 2];
    (beside[4], beyond[4]) = (0.3, -0.9);
    let [from, to] = [beside, beyond].map(|q| chain(UR5).forward(&q).rotation.column(2).into_owned());
    for (name, q, direction, lean) in [
        ("wrist", beside, Vector3::new(0.0, 0.15, 0.0), to - from),
        ("elbow", UR5_HOME, Vector3::new(-0.6, 0.0, 0.1), Vector3::zeros()),
        ("shoulder", UR5_HOME, Vector3::new(0.55, 0.02, 0.35), Vector3::zeros()),
    ] {
        for keep in [false, true] {
            for period in [8.0, 1.5] {
                let run = passage(q, direction, lean, period, keep);
                println!("{name}, {period} s, keeping clear {keep}: {run:?}");
                assert!(run.nearest < 0.01, "{name}: never came near: {run:?}");
                assert!(run.hardest <= 40.0 + 1e-6, "{name}: {run:?}");
                assert!(run.left < 1e-4, "{name}: did not come back: {run:?}");
            }
        }
    }
}
