//! Arms driven hard into table, wall, box and themselves: nothing is touched, every command is legal, and
//! they slide.

use crate::support::reaching;

use reaching::*;

use foretrace_control::clearance::{Clearance, ClearanceSettings, Obstacle};
use foretrace_control::guard::{Commanded, Guard};
use foretrace_control::ik::{Ik, IkSettings, IkSource, ToolTarget};
use foretrace_control::units::Stamp;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const MARGIN_M: f64 = 0.01;
/// Share of the margin that the first-order approximation may use \[m\].
const STATED_M: f64 = 1e-3;

fn settings(itself: bool, obstacles: Vec<Obstacle>) -> ClearanceSettings {
    ClearanceSettings { margin_m: MARGIN_M, itself, obstacles }
}

fn arm<'a>(
    chain: &'a foretrace_control::arm::Chain<6>,
    home: [f64; 6],
    wanted: &ClearanceSettings,
) -> Arm<'a> {
    let mut arm = Arm::new(chain, home, 40.0);
    let kept = Clearance::new(chain, &limits(chain, 40.0), TICK_S, wanted).unwrap();
    let settings = *arm.ik.settings();
    arm.ik = Ik::new(limits(chain, 40.0), settings).keeping_clear(kept);
    arm
}

fn wall(point: [f64; 3], normal: [f64; 3]) -> Obstacle {
    Obstacle::plane(point, normal).unwrap()
}

/// `Arm::tick` asserts that the guard finds nothing to alter: every command is legal.
#[test]
fn random_motion_into_everything_never_comes_nearer_than_stated() {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut smallest = f64::INFINITY;
    let (mut held, mut yielded, mut braked, mut travelled) = (0u32, 0u32, 0u32, 0.0);
    for (text, home) in [(UR5, UR5_HOME), (UR5E, UR5E_HOME)] {
        let chain = chain(text);
        let everything = settings(
            true,
            vec![
                wall([0.0; 3], [0.0, 0.0, 1.0]),
                wall([0.0, -0.5, 0.0], [0.0, 1.0, 0.0]),
                Obstacle::cuboid([-0.55, 0.2, 0.1], [0.2, 0.2, 0.3], [0.0, 0.2, 0.5]).unwrap(),
            ],
        );
        let judge = Clearance::new(&chain, &limits(&chain, 40.0), TICK_S, &everything).unwrap();
        let mut arm = arm(&chain, home, &everything);
        let start = judge.nearest(&chain.forward(&home)).unwrap();
        assert!(start.distance_m > MARGIN_M, "{start:?}");
        let mut target = ToolTarget::at_rest(arm.tool().0, -Vector3::z(), None);
        for tick in 0..100_000 {
            if tick % 250 == 0 {
                let mut around = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
                target.position = around(0.9);
                target.axis = around(1.0).normalize();
                let speed = [0.0, 0.3, 1.5, 3.0][(tick / 250) % 4];
                target.velocity = around(1.0).normalize() * speed;
            }
            let before = *arm.last.q();
            let report = arm.tick(&target);
            travelled += before.iter().zip(arm.last.q()).map(|(a, b)| (a - b).abs()).sum::<f64>();
            held += u32::from(report.clearance.held > 0);
            yielded += u32::from(report.clearance.yielded > 0);
            braked += u32::from(report.source == IkSource::Brake);
            let nearest = judge.nearest(&chain.forward(arm.last.q())).unwrap();
            smallest = smallest.min(nearest.distance_m);
            assert!(nearest.distance_m > MARGIN_M - STATED_M, "{tick}: {nearest:?} {report:?}");
        }
    }
    println!(
        "smallest {smallest} m; held {held}, yielded {yielded}, braked {braked}, travelled {travelled} rad"
    );
    assert!(held > 20_000 && travelled > 100.0, "{held} {travelled}");
    assert_eq!(braked, 0, "a certified answer in every tick");
}

/// Smallest distance of each of 1200 motions at the joints' own limits, towards targets anywhere, in a loop
/// of `period_s` \[m\].
fn anywhere(period_s: f64, jerk: Option<f64>) -> Vec<f64> {
    let chain = chain(UR5);
    let plain = limits(&chain, 40.0).with_stale_braking(5.0 * period_s, [20.0; 6]).unwrap();
    let limits = jerk.map_or(plain, |jerk| plain.with_jerk([jerk; 6]).unwrap());
    let everything = settings(
        true,
        vec![
            wall([0.0; 3], [0.0, 0.0, 1.0]),
            Obstacle::cuboid([-0.55, 0.2, 0.1], [0.2, 0.2, 0.3], [0.0, 0.2, 0.5]).unwrap(),
        ],
    );
    let kept = Clearance::new(&chain, &limits, period_s, &everything).unwrap();
    let (judge, guard) = (kept.clone(), Guard::new(limits));
    let mut ik = Ik::new(limits, IkSettings::for_period(period_s, UR5_HOME)).keeping_clear(kept);
    let period_ns = (period_s * 1e9) as u64;
    let mut last = Commanded::at_rest(Stamp(period_ns), UR5_HOME).unwrap();
    let mut rng = Pcg64::seed_from_u64(20);
    let mut motion = |_| {
        let mut around = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
        let (position, axis, velocity) = (around(0.9), around(1.0).normalize(), around(1.5));
        let target = ToolTarget { velocity, ..ToolTarget::at_rest(position, axis, None) };
        let mut nearest = f64::INFINITY;
        for _ in 0..rng.random_range(5..(0.6 / period_s) as u32) {
            let step = ik.step(&chain.forward(last.q()), last.motion(), &target, period_s);
            let q = std::array::from_fn(|joint| last.q()[joint] + step.qd[joint] * period_s);
            last = guard.clamp(&last, &q, last.stamp() + period_ns).command;
            nearest = nearest.min(judge.nearest(&chain.forward(last.q())).unwrap().distance_m);
        }
        nearest
    };
    (0..1200).map(&mut motion).collect()
}

/// Rows are of the first order, and do not know that a jerk delays braking: what that costs in loops of each
/// rate, and with joints that limit their jerk.
#[test]
fn what_slow_loops_and_limits_of_jerk_take_of_the_margin() {
    for (period_s, jerk, kept_m, touching) in [
        (0.002, None, 0.8 * MARGIN_M, 0.0),
        (0.004, None, 0.8 * MARGIN_M, 0.0),
        (0.008, None, f64::NEG_INFINITY, 0.005),
        (0.002, Some(1500.0), f64::NEG_INFINITY, 0.005),
    ] {
        let nearest = anywhere(period_s, jerk);
        let smallest = nearest.iter().copied().fold(f64::INFINITY, f64::min);
        let share = |below: f64| {
            nearest.iter().filter(|distance| **distance < below).count() as f64 / nearest.len() as f64
        };
        println!(
            "{period_s} s, jerk {jerk:?}: at least {:.1} mm; {:.2} % below half of the margin, {:.2} % touching",
            smallest * 1e3,
            100.0 * share(0.5 * MARGIN_M),
            100.0 * share(0.0)
        );
        assert!(smallest > kept_m && share(0.0) <= touching, "{period_s} s, jerk {jerk:?}: {smallest} m");
    }
}

/// Pressed against a wall while commanded along it: the tool keeps moving along.
#[test]
fn the_arm_slides_along_a_plane() {
    let chain = chain(UR5);
    let table = settings(true, vec![wall([0.0; 3], [0.0, 0.0, 1.0])]);
    let mut arm = arm(&chain, UR5_HOME, &table);
    let start = arm.tool().0;
    let (mut slowest, mut lowest) = (f64::INFINITY, f64::INFINITY);
    for tick in 0..4_000 {
        let t = f64::from(tick) * TICK_S;
        let path =
            |t: f64| start + Vector3::new(0.0, 0.1 * (1.0 - (t * 1.5).cos()), -0.3 * (t / 2.0).min(1.0));
        let (before, _) = arm.tool();
        arm.tick(&along(path, t));
        let (after, axis) = arm.tool();
        let wanted = (path(t + TICK_S) - path(t)).y;
        if t > 3.0 && wanted.abs() > 1e-4 {
            slowest = slowest.min((after - before).y / wanted);
        }
        lowest = lowest.min(after.z);
        assert!((after.y - path(t + TICK_S).y).abs() < 0.02 && axis.z < -0.7, "{t}: {after} {axis}");
    }
    assert!(slowest > 0.5, "{slowest}");
    assert!(lowest < 0.2 - 0.05, "it went down as far as it may: {lowest}");
}

/// Rows that are not violated change nothing: the same bits with and without them.
#[test]
fn far_from_everything_the_answers_are_the_same_bits() {
    let chain = chain(UR5);
    let far = settings(true, vec![wall([0.0, 0.0, -0.5], [0.0, 0.0, 1.0])]);
    let (mut with, mut without) = (arm(&chain, UR5_HOME, &far), Arm::new(&chain, UR5_HOME, 40.0));
    let start = with.tool().0;
    let path = |t: f64| start + Vector3::new((7.0 * t).sin(), 1.0 - (5.0 * t).cos(), 0.0) * 0.06;
    for tick in 0..5_000 {
        let target = along(path, f64::from(tick) * TICK_S);
        let (mut a, b) = (with.tick(&target), without.tick(&target));
        a.clearance = b.clearance;
        assert_eq!((with.last, a), (without.last, b));
    }
}

/// The price of a broken row counts beside the heaviest task that settings may ask for.
#[test]
fn no_weight_of_the_task_pushes_the_tool_through_a_table() {
    let chain = chain(UR5);
    let table = settings(false, vec![wall([0.0; 3], [0.0, 0.0, 1.0])]);
    let judge = Clearance::new(&chain, &limits(&chain, 40.0), TICK_S, &table).unwrap();
    for normal_weight in [1.0, 10.0, 100.0] {
        let mut arm = arm(&chain, UR5_HOME, &table);
        let kept = Clearance::new(&chain, &limits(&chain, 40.0), TICK_S, &table).unwrap();
        let heavy = IkSettings { normal_weight, ..*arm.ik.settings() };
        arm.ik = foretrace_control::ik::Ik::new(limits(&chain, 40.0), heavy).keeping_clear(kept);
        let below = arm.tool().0 - Vector3::z();
        let mut nearest = f64::INFINITY;
        for _ in 0..2_000 {
            arm.tick(&ToolTarget::at_rest(below, -Vector3::z(), None));
            let k = chain.forward(arm.last.q());
            nearest = nearest.min(judge.nearest(&k).map_or(f64::INFINITY, |gap| gap.distance_m));
        }
        assert!(nearest > MARGIN_M - STATED_M, "weight {normal_weight}: {nearest}");
        assert!(nearest < MARGIN_M + 0.01, "weight {normal_weight}: it never got there, {nearest}");
    }
}
