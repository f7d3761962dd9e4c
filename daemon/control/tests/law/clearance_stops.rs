//! Guarantees on distances where the IK did not decide the motion: stops, and altered commands.

use crate::support::reaching;

use reaching::*;

use foretrace_control::clearance::{Clearance, ClearanceSettings, Obstacle};
use foretrace_control::guard::StopProfile;
use foretrace_control::ik::{Ik, IkSettings, ToolTarget};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const MARGIN_M: f64 = 0.01;

fn everything() -> ClearanceSettings {
    ClearanceSettings {
        margin_m: MARGIN_M,
        itself: true,
        obstacles: vec![
            Obstacle::plane([0.0; 3], [0.0, 0.0, 1.0]).unwrap(),
            Obstacle::plane([0.0, -0.5, 0.0], [0.0, 1.0, 0.0]).unwrap(),
            Obstacle::cuboid([-0.55, 0.2, 0.1], [0.2, 0.2, 0.3], [0.0, 0.2, 0.5]).unwrap(),
        ],
    }
}

fn scene(chain: &foretrace_control::arm::Chain<6>) -> (Arm<'_>, Clearance<6>) {
    let mut arm = Arm::new(chain, UR5_HOME, 40.0);
    let kept = Clearance::new(chain, &limits(chain, 40.0), TICK_S, &everything()).unwrap();
    arm.ik =
        Ik::new(limits(chain, 40.0), IkSettings::for_period(TICK_S, UR5_HOME)).keeping_clear(kept.clone());
    (arm, kept)
}

fn wild(rng: &mut Pcg64) -> ToolTarget {
    let mut around = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
    let (position, axis, speed) = (around(0.9), around(1.0).normalize(), around(3.0));
    ToolTarget { velocity: speed, ..ToolTarget::at_rest(position, axis, None) }
}

/// One tick of a stop; returns whether the arm is at rest.
fn stop(arm: &mut Arm<'_>, profile: &StopProfile<6>) -> bool {
    let wanted = profile.next(&arm.last, arm.last.stamp() + TICK_NS);
    let k = arm.chain.forward(arm.last.q());
    let qd = arm.ik.stopping(&k, arm.last.motion(), &wanted, TICK_S, None, true).qd;
    let q: [f64; 6] = std::array::from_fn(|i| arm.last.q()[i] + qd[i] * TICK_S);
    let verdict = arm.guard.clamp(&arm.last, &q, arm.last.stamp() + TICK_NS);
    assert_eq!(verdict.altered, 0);
    arm.last = verdict.command;
    StopProfile::is_done(&arm.last)
}

/// Stops from full motion into everything end soon, and use the margin only as far as stated.
#[test]
fn stops_end_and_keep_the_distance() {
    let chain = chain(UR5);
    let (mut arm, judge) = scene(&chain);
    let profile = StopProfile::new(limits(&chain, 40.0));
    let mut rng = Pcg64::seed_from_u64(5);
    let (mut longest, mut smallest, mut bent_away) = (0, f64::INFINITY, f64::INFINITY);
    for _ in 0..1_500 {
        let target = wild(&mut rng);
        for _ in 0..rng.random_range(5..150) {
            arm.tick(&target);
        }
        // The same stop with independent joints: its smallest distance.
        let mut apart = arm.last;
        let mut ticks = 0;
        while !StopProfile::is_done(&apart) {
            let qd = profile.next(&apart, apart.stamp() + TICK_NS);
            let q: [f64; 6] = std::array::from_fn(|i| apart.q()[i] + qd[i] * TICK_S);
            apart = arm.guard.clamp(&apart, &q, apart.stamp() + TICK_NS).command;
            bent_away = bent_away.min(judge.nearest(&chain.forward(apart.q())).unwrap().distance_m);
            ticks += 1;
        }
        let mut kept = 0;
        while !stop(&mut arm, &profile) {
            smallest = smallest.min(judge.nearest(&chain.forward(arm.last.q())).unwrap().distance_m);
            kept += 1;
            assert!(kept < 400, "a stop that does not end: {:?}", arm.last);
        }
        longest = longest.max(kept - ticks);
    }
    println!("at most {longest} ticks longer; nearest {smallest} m, joint by joint {bent_away} m");
    assert!(smallest > 0.9 * MARGIN_M, "{smallest}");
    assert!(bent_away < smallest, "stops joint by joint would have done: {bent_away} {smallest}");
    assert!(longest < 100, "{longest}");
}

/// Alterations behind the IK (a clamp per joint, another source) may lead inside. The guarantee is then that
/// the IK moves the arm out from wherever it is, going deeper only while it brakes.
#[test]
fn after_altered_commands_the_arm_comes_out_again() {
    let chain = chain(UR5);
    let (mut arm, judge) = scene(&chain);
    let mut rng = Pcg64::seed_from_u64(6);
    let (mut left_inside, mut worst) = (0, 0.0f64);
    let mut target = wild(&mut rng);
    for round in 0..300 {
        // Joint velocities that were not checked by the IK, legal one by one.
        let push: [f64; 6] = std::array::from_fn(|_| rng.random_range(-1.5..1.5));
        for _ in 0..rng.random_range(10..120) {
            let q: [f64; 6] = std::array::from_fn(|i| arm.last.q()[i] + push[i] * TICK_S);
            arm.last = arm.guard.clamp(&arm.last, &q, arm.last.stamp() + TICK_NS).command;
        }
        let at = |arm: &Arm<'_>| judge.nearest(&chain.forward(arm.last.q())).unwrap().distance_m;
        let left = at(&arm);
        let inside = left < MARGIN_M;
        left_inside += u32::from(inside);
        if rng.random_bool(0.5) {
            target = wild(&mut rng);
        }
        let speed = arm.last.qd().iter().fold(0.0f64, |most, v| most.max(v.abs()));
        // Braking at 40 rad/s² with every joint at its lever of a metre or so.
        let braking = 6.0 * speed * speed / 80.0 + 6.0 * speed * TICK_S;
        let mut deepest = left;
        // RETREAT_MPS, and twice that time for obstacles on the way.
        let ticks = 500 + ((MARGIN_M - left).max(0.0) / 0.05 / TICK_S * 2.0) as u32;
        for tick in 0..ticks {
            arm.tick(&target);
            let now = at(&arm);
            deepest = deepest.min(now);
            assert!(
                now > left.min(MARGIN_M) - braking - 5e-3,
                "{round}, {tick}: {now} after {left} at {speed} rad/s"
            );
        }
        worst = worst.max(left.min(MARGIN_M) - deepest);
        // Out, or held between obstacles that leave no room for the margin on every side: never far inside.
        assert!(at(&arm) > 0.5 * MARGIN_M, "{round}: still at {} from {left}", at(&arm));
    }
    println!("{left_inside} times left inside; at most {worst} m deeper while braking");
    assert!(left_inside > 50, "{left_inside}");
}
