//! The path of a stop, for an arm that was led anywhere: beside obstacles, stretched out, through
//! singularities, at any period, with and without limits of jerk.

use crate::support::reaching;

use reaching::*;

use foretrace_control::arm::limits::stop_jerk;
use foretrace_control::arm::{Chain, JointLimits, JointMotion, velocity_box};
use foretrace_control::clearance::{Clearance, ClearanceSettings, Obstacle};
use foretrace_control::guard::{CommandChecker, Commanded, Guard, StopProfile};
use foretrace_control::ik::{Ik, IkSettings, PathKept, StopPath, ToolTarget};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const MARGIN_M: f64 = 0.01;

fn kept(chain: &Chain<6>, limits: &JointLimits<6>, period_s: f64) -> Clearance<6> {
    let obstacles = vec![
        Obstacle::plane([0.0; 3], [0.0, 0.0, 1.0]).unwrap(),
        Obstacle::cuboid([-0.55, 0.2, 0.1], [0.2, 0.2, 0.3], [0.0, 0.2, 0.5]).unwrap(),
    ];
    Clearance::new(
        chain,
        limits,
        period_s,
        &ClearanceSettings { margin_m: MARGIN_M, itself: true, obstacles },
    )
    .unwrap()
}

fn wild(rng: &mut Pcg64) -> ToolTarget {
    let mut around = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
    let (position, axis, speed) = (around(0.9), around(1.0).normalize(), around(1.5));
    ToolTarget { velocity: speed, ..ToolTarget::at_rest(position, axis, None) }
}

/// A stop, with or without its path.
struct Rested {
    ticks: u32,
    /// Depth below the floor \[m\].
    below: f64,
    /// Nearest to anything \[m\].
    nearest: f64,
    lost: u32,
}

/// Where the path lies: heights along the base's z, the line along the tool's motion.
#[derive(Clone, Copy)]
struct Line {
    floor: f64,
    across: Option<Vector3<f64>>,
}

fn stop(
    (ik, guard, judge): (&mut Ik<6>, &Guard<6>, &Clearance<6>),
    chain: &Chain<6>,
    mut last: Commanded<6>,
    period_ns: u64,
    line: Line,
    keeps: bool,
) -> Rested {
    let h = period_ns as f64 * 1e-9;
    let profile = StopProfile::new(*guard.limits());
    let mut checker = CommandChecker::new(*guard.limits());
    let valid_ns = (guard.limits().hold_s() * 1e9).round() as u64;
    checker.observe(last.stamp(), last.stamp() + valid_ns, last.q(), last.qd());
    let mut rested = Rested { ticks: 0, below: 0.0, nearest: f64::INFINITY, lost: 0 };
    while !StopProfile::is_done(&last) {
        let stamp = last.stamp() + period_ns;
        let k = chain.forward(last.q());
        let path = StopPath { normal: Vector3::z(), room_m: k.position.z - line.floor, across: line.across };
        let wanted = profile.next(&last, stamp);
        let step = ik.stopping(&k, last.motion(), &wanted, h, keeps.then_some(&path), true);
        rested.lost += u32::from(step.path == PathKept::Lost);
        let q: [f64; 6] = std::array::from_fn(|i| last.q()[i] + step.qd[i] * h);
        let verdict = guard.clamp(&last, &q, stamp);
        assert_eq!(verdict.altered, 0, "{:?}", verdict.reasons);
        last = verdict.command;
        assert!(checker.observe(stamp, stamp + valid_ns, last.q(), last.qd()), "{last:?}");
        let k = chain.forward(last.q());
        rested.below = rested.below.max(line.floor - k.position.z);
        rested.nearest = rested.nearest.min(judge.nearest(&k).unwrap().distance_m);
        rested.ticks += 1;
        assert!(f64::from(rested.ticks) * h < 1.5, "a stop that does not end: {last:?}");
    }
    rested
}

/// From any motion: legal, at rest soon, no nearer to anything than the margin, and nowhere deeper than where
/// every joint brakes by itself.
#[test]
fn stops_from_anywhere_are_legal_end_soon_and_keep_their_distance_and_their_floor() {
    let chain = chain(UR5);
    for (period_ns, jerk) in [(2_000_000, None), (8_000_000, None), (2_000_000, Some(1500.0))] {
        let h = period_ns as f64 * 1e-9;
        let plain = JointLimits::new(chain.limits().position, chain.limits().velocity, [40.0; 6])
            .unwrap()
            .with_stale_braking(5.0 * h, [20.0; 6])
            .unwrap();
        let limits = jerk.map_or(plain, |jerk| plain.with_jerk([jerk; 6]).unwrap());
        let judge = kept(&chain, &limits, h);
        let mut ik = Ik::new(limits, IkSettings::for_period(h, UR5_HOME)).keeping_clear(judge.clone());
        let guard = Guard::new(limits);
        let mut rng = Pcg64::seed_from_u64(8);
        let (mut stops, mut later, mut worst, mut apart_worst, mut lost, mut ticks) =
            (0, 0.0_f64, 0.0_f64, 0.0_f64, 0, 0);
        let (mut nearest, mut without_nearest) = (f64::INFINITY, f64::INFINITY);
        let mut last = Commanded::at_rest(foretrace_control::units::Stamp(period_ns), UR5_HOME).unwrap();
        for _ in 0..400 {
            let target = wild(&mut rng);
            for _ in 0..rng.random_range(5..(0.3 / h) as u32) {
                let k = chain.forward(last.q());
                let step = ik.step(&k, last.motion(), &target, h);
                let q: [f64; 6] = std::array::from_fn(|i| last.q()[i] + step.qd[i] * h);
                last = guard.clamp(&last, &q, last.stamp() + period_ns).command;
            }
            let k = chain.forward(last.q());
            let motion = k.tool_motion(last.qd(), last.qdd());
            let along = Vector3::new(motion.velocity.x, motion.velocity.y, 0.0);
            let across = (along.norm() > 0.01).then(|| Vector3::new(-along.y, along.x, 0.0).normalize());
            let line = Line { floor: k.position.z - rng.random_range(0.0..0.01), across };
            let with = stop((&mut ik, &guard, &judge), &chain, last, period_ns, line, true);
            let without = stop((&mut ik, &guard, &judge), &chain, last, period_ns, line, false);
            later = later.max((f64::from(with.ticks) - f64::from(without.ticks)) * h);
            worst = worst.max(with.below - without.below);
            apart_worst = apart_worst.max(without.below - with.below);
            nearest = nearest.min(with.nearest);
            without_nearest = without_nearest.min(without.nearest);
            (stops, lost, ticks) = (stops + 1, lost + with.lost, ticks + with.ticks);
        }
        println!(
            "{period_ns} ns, jerk {jerk:?}: {stops} stops, {:.0} ms later at most; {:.2} mm deeper at most, \
             {:.1} mm less deep at most; nearest {:.2} mm, without the path {:.2}; {lost} of {ticks} lost",
            later * 1e3,
            worst * 1e3,
            apart_worst * 1e3,
            nearest * 1e3,
            without_nearest * 1e3
        );
        // What the motion left of the margin, the path leaves: of a tick of 8 ms 8.7 of 10 mm.
        assert!(nearest > (0.9 * MARGIN_M).min(without_nearest - 1e-4), "{nearest} {without_nearest}");
        assert!(nearest > 0.8 * MARGIN_M, "{nearest}");
        assert!(worst < 1e-4 && apart_worst > 0.1, "{worst} {apart_worst}");
        // From anything that an arm may do, and without letting go of the path as the law does.
        assert!(later < 0.15, "{later}");
        assert!(1000 * lost < ticks, "{lost} of {ticks}");
    }
}

/// A step for the path changes accelerations by no more than the stop's own jerk.
#[test]
fn rows_of_the_path_keep_the_jerk_of_a_stop() {
    let chain = chain(UR5E);
    let limits = limits(&chain, 40.0);
    let eased = limits.with_jerk(stop_jerk(&limits)).unwrap();
    let mut ik = Ik::new(limits, IkSettings::for_period(TICK_S, UR5E_HOME));
    let profile = StopProfile::new(limits);
    let mut rng = Pcg64::seed_from_u64(9);
    let (mut changed, mut lost) = (0, 0);
    for _ in 0..3000 {
        let motion = JointMotion {
            q: UR5E_HOME.map(|q| q + rng.random_range(-0.3..0.3)),
            qd: std::array::from_fn(|_| rng.random_range(-2.0..2.0)),
            qdd: std::array::from_fn(|_| rng.random_range(-20.0..20.0)),
        };
        let last = Commanded::new(foretrace_control::units::Stamp(TICK_NS), motion).unwrap();
        let k = chain.forward(&motion.q);
        let wanted = profile.next(&last, last.stamp() + TICK_NS);
        let path = StopPath { normal: Vector3::z(), room_m: 0.0, across: Some(Vector3::x()) };
        let step = ik.stopping(&k, &motion, &wanted, TICK_S, Some(&path), true);
        let inside = velocity_box(&motion, &eased, TICK_S);
        if step.path == PathKept::Kept {
            assert_eq!(step.qd, inside.nearest(&step.qd), "{motion:?}");
            changed += usize::from(step.qd != wanted);
        }
        lost += usize::from(step.path == PathKept::Lost);
        let unsolved = ik.stopping(&k, &motion, &wanted, TICK_S, Some(&path), false);
        assert_eq!(unsolved.qd, wanted);
        assert_eq!(unsolved.path == PathKept::Lost, step.path != PathKept::Free);
    }
    println!("{changed} of 3000 changed, {lost} lost");
    assert!(changed > 2000, "{changed}");
}
