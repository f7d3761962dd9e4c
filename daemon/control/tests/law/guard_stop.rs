//! The jerk-limited stop, the consumer's rule and the checker of commands.

use crate::support::limited;

use limited::*;

use foretrace_control::arm::limits::braking_straight;
use foretrace_control::arm::{JointLimits, JointMotion};
use foretrace_control::guard::{CommandChecker, Commanded, StopProfile, Violations, consumer_state};
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// By hand: q = 1, q̇ = 2 at stamp 1 s, valid for 10 ms, braking at 4: glides 0.02, brakes 0.5 s over 0.5
/// rad.
#[test]
fn consumer_follows_the_rule_worked_by_hand() {
    let motion = JointMotion { q: [1.0, 1.0], qd: [2.0, -2.0], qdd: [7.0, 7.0] };
    let command = Commanded::new(Stamp(1_000_000_000), motion).unwrap();
    let until = Stamp(1_010_000_000);
    let at = |ns: u64| consumer_state(&command, until, &[4.0, 4.0], Stamp(ns));
    let is = |state: JointMotion<2>, q: f64, qd: f64| {
        assert!((state.q[0] - q).abs() < 1e-12 && (state.qd[0] - qd).abs() < 1e-12, "{state:?}");
        assert!((state.q[1] - (2.0 - q)).abs() < 1e-12 && (state.qd[1] + qd).abs() < 1e-12, "{state:?}");
    };
    is(at(999_000_000), 0.998, 2.0);
    is(at(1_000_000_000), 1.0, 2.0);
    is(at(1_010_000_000), 1.02, 2.0);
    is(at(1_260_000_000), 1.02 + 0.375, 1.0);
    is(at(1_510_000_000), 1.52, 0.0);
    is(at(u64::MAX), 1.52, 0.0);
    is(at(0), 0.98, 2.0);
    assert_eq!(at(1_260_000_000).qdd, [-4.0, 4.0]);
    assert_eq!(at(1_600_000_000).qdd, [0.0, 0.0]);
}

#[test]
fn consumer_motion_is_continuous() {
    let mut rng = Pcg64::seed_from_u64(5);
    let limits = limits();
    for _ in 0..200 {
        let command = Commanded::new(Stamp(1 << 40), viable(&mut rng, &limits)).unwrap();
        let until = command.stamp() + 5 * TICK_NS;
        let mut last = consumer_state(&command, until, limits.deceleration(), command.stamp());
        assert_eq!(last.q, *command.q());
        for k in 1..3_000u64 {
            let state = consumer_state(&command, until, limits.deceleration(), command.stamp() + k * 500_000);
            for i in 0..6 {
                let step = state.q[i] - last.q[i];
                let (low, high) = (state.qd[i].min(last.qd[i]), state.qd[i].max(last.qd[i]));
                assert!(step >= low * 5e-4 - 1e-12 && step <= high * 5e-4 + 1e-12);
                let change = (state.qd[i] - last.qd[i]).abs();
                assert!(change <= limits.deceleration()[i] * 5e-4 + 1e-12);
            }
            last = state;
        }
    }
}

/// Steps through a stop and returns the number of ticks.
fn stop(
    limits: &JointLimits<6>,
    motion: JointMotion<6>,
    mut each: impl FnMut(&JointMotion<6>, &JointMotion<6>),
) -> u32 {
    let profile = StopProfile::new(*limits);
    let mut last = Commanded::new(Stamp(7), motion).unwrap();
    let mut ticks = 0;
    while !StopProfile::is_done(&last) {
        let stamp = last.stamp() + TICK_NS;
        let qd = profile.next(&last, stamp);
        let next = JointMotion {
            q: std::array::from_fn(|i| last.q()[i] + qd[i] * TICK_S),
            qd,
            qdd: std::array::from_fn(|i| (qd[i] - last.qd()[i]) / TICK_S),
        };
        each(last.motion(), &next);
        last = Commanded::new(stamp, next).unwrap();
        ticks += 1;
        assert!(ticks < 20_000, "never stops: {motion:?}");
    }
    ticks
}

#[test]
fn stop_ends_at_exactly_zero_inside_all_hard_limits() {
    let mut rng = Pcg64::seed_from_u64(6);
    let mut states = 0u64;
    for limits in [limits(), with_jerk()] {
        for _ in 0..4_200 {
            let motion = viable(&mut rng, &limits);
            states += u64::from(stop(&limits, motion, |last, next| {
                assert_viable(&limits, next);
                for i in 0..6 {
                    let [low, high] = limits.position()[i];
                    assert!(next.q[i] >= low - 1e-12 && next.q[i] <= high + 1e-12);
                    let change = (next.qd[i] - last.qd[i]).abs();
                    assert!(change <= limits.acceleration()[i] * TICK_S + 1e-12);
                    assert!(next.qd[i].abs() <= limits.velocity()[i]);
                }
            }));
        }
    }
    assert!(states > 1_000_000, "{states}");
}

#[test]
fn stop_keeps_the_jerk_limit_away_from_position_limits() {
    let mut rng = Pcg64::seed_from_u64(7);
    let jerk = [400.0, 2000.0, 500.0, 100.0, 5000.0, 900.0];
    let acceleration = [8.0, 40.0, 15.0, 3.0, 25.0, 60.0];
    let limits = JointLimits::new([[-1e3, 1e3]; 6], [3.0; 6], acceleration).unwrap().with_jerk(jerk).unwrap();
    for _ in 0..3_000 {
        let mut motion = JointMotion::at_rest([0.0; 6]);
        for i in 0..6 {
            motion.qd[i] = rng.random_range(-2.5..2.5);
            motion.qdd[i] = rng.random_range(-1.0..1.0) * acceleration[i];
        }
        let start = motion;
        stop(&limits, motion, |last, next| {
            for i in 0..6 {
                let change = (next.qdd[i] - last.qdd[i]).abs();
                // Where braking starts so late that the velocity limit is active, acceleration has priority.
                let fast = last.qd[i].abs() + last.qdd[i].abs() * last.qdd[i].abs() / (2.0 * jerk[i]) > 2.99;
                assert!(
                    fast || change <= jerk[i] * TICK_S * (1.0 + 1e-6) + 1e-6,
                    "joint {i} {last:?} {next:?}"
                );
                // One change of direction at most, and only for an acceleration that had to fade out first.
                if next.qd[i] * start.qd[i] < 0.0 {
                    let b = start.qdd[i].abs() + jerk[i] * TICK_S;
                    assert!(
                        start.qd[i] * start.qdd[i] < 0.0 && next.qd[i].abs() <= b * b / jerk[i],
                        "joint {i}: {start:?} {last:?} {next:?}"
                    );
                }
            }
        });
    }
}

/// Speed 1.2 at 10 rad/s², jerk 1000: ramps of 10 ms. v/a + a/j = 0.12 + 0.01 s = 65 ticks, and a tick or two
/// of grid.
#[test]
fn stop_takes_as_long_as_worked_by_hand() {
    let limits =
        JointLimits::new([[-1e3, 1e3]; 6], [3.0; 6], [10.0; 6]).unwrap().with_jerk([1000.0; 6]).unwrap();
    let ticks = stop(&limits, JointMotion { q: [0.0; 6], qd: [1.2; 6], qdd: [0.0; 6] }, |_, _| {});
    assert!((65..=68).contains(&ticks), "{ticks}");
}

#[test]
fn checker_counts_what_is_wrong_and_nothing_else() {
    let limits = JointLimits::new([[-1.0, 1.0]; 1], [2.0], [100.0]).unwrap();
    let start = || {
        let mut checker = CommandChecker::new(limits);
        assert!(checker.observe(Stamp(TICK_NS), Stamp(6 * TICK_NS), &[0.0], &[0.0]));
        checker
    };
    let second = |stamp: u64, q: f64, qd: f64| {
        let mut checker = start();
        let legal = checker.observe(Stamp(stamp), Stamp(stamp + 5 * TICK_NS), &[q], &[qd]);
        assert_eq!(checker.statistics().limit_violations, u64::from(!legal));
        checker.statistics().violations
    };
    let tick = 2 * TICK_NS;
    assert_eq!(second(tick, 0.0004, 0.2), Default::default());
    assert_eq!(second(tick, 0.00041, 0.205).acceleration, 1);
    assert_eq!(second(tick, 0.0003, 0.1).continuity, 1);
    let jumped = second(tick, 0.5, 0.1);
    assert_eq!((jumped.velocity, jumped.continuity, jumped.position), (1, 1, 0));
    assert_eq!(second(tick, 0.0, f64::NAN).not_finite, 1);
    assert_eq!(second(TICK_NS, 0.0, 0.0).stamp, 1);
    assert_eq!(second(tick, 1.5, 0.0).position, 1);
    assert_eq!(second(100 * TICK_NS, 0.1, 2.1).velocity, 1);
    // 2 rad/s glides 0.02 rad and brakes at 100 rad/s² over another 0.02: 0.04 rad are enough and a bit less
    // is not.
    let ends_at = |q: f64, qd: f64| {
        let mut checker = CommandChecker::new(limits);
        checker.observe(Stamp(TICK_NS), Stamp(6 * TICK_NS), &[q], &[qd]);
        checker.statistics().violations
    };
    assert_eq!(ends_at(0.96, 2.0), Default::default());
    assert_eq!(ends_at(-0.96, -2.0), Default::default());
    assert_eq!(ends_at(0.96001, 2.0), Violations { viability: 1, ..Default::default() });
    assert_eq!(ends_at(-0.96001, -2.0), Violations { viability: 1, ..Default::default() });
    assert_eq!(ends_at(1.0, 1e-9), Default::default());
    assert_eq!(ends_at(1.0, 1e-6), Violations { viability: 1, ..Default::default() });
    // A joint outside its limits is counted once for its position, whether it comes back or not; only the
    // other side is new.
    for (q, qd) in [(1.1, -1.0), (1.1, 1.0), (1.1, 0.0), (-1.1, 1.0), (-1.1, -1.0)] {
        assert_eq!(ends_at(q, qd), Violations { position: 1, ..Default::default() }, "{q} {qd}");
    }
    let mut narrow = CommandChecker::new(JointLimits::new([[-0.01, 0.01]], [2.0], [100.0]).unwrap());
    narrow.observe(Stamp(0), Stamp(TICK_NS), &[0.02], &[-2.0]);
    let across = Violations { position: 1, viability: 0, ..Default::default() };
    assert_eq!(narrow.statistics().violations, across, "0.024 rad to rest from 0.02 end inside");
    narrow.restart();
    narrow.observe(Stamp(0), Stamp(6 * TICK_NS), &[0.02], &[-2.0]);
    assert_eq!(narrow.statistics().violations, Violations { position: 2, viability: 1, ..across });
    // A command after a stall may start from anywhere the consumer may have braked to.
    let mut checker = start();
    assert!(checker.observe(Stamp(tick), Stamp(7 * TICK_NS), &[0.0004], &[0.2]));
    assert!(checker.observe(Stamp(52 * TICK_NS), Stamp(57 * TICK_NS), &[0.005], &[0.0]));
    assert!((checker.statistics().max_step_rad - 0.0046).abs() < 1e-12);
    assert!((checker.statistics().max_acceleration_radps2 - 100.0).abs() < 1e-6);
}

/// The tool keeps its path while all joints slow down in proportion; the one that needs longest brakes as
/// hard as it may.
#[test]
fn braking_straight_keeps_the_direction_and_every_deceleration() {
    // 0.5 s and 1 s are needed: after 0.25 s three quarters are left.
    assert_eq!(braking_straight(&[2.0, -1.0], &[4.0, 1.0], 0.25), [1.5, -0.75]);
    assert_eq!(braking_straight(&[2.0, -1.0], &[4.0, 1.0], 1.0), [0.0, 0.0]);
    assert_eq!(braking_straight(&[0.0; 2], &[4.0, 1.0], 0.25), [0.0; 2]);
    let mut rng = Pcg64::seed_from_u64(17);
    let decel = *limits().deceleration();
    for _ in 0..1000 {
        let qd: [f64; 6] = std::array::from_fn(|_| rng.random_range(-3.0..3.0));
        let h = rng.random_range(0.001..0.1);
        let slower = braking_straight(&qd, &decel, h);
        let used = (0..6).map(|i| (qd[i] - slower[i]).abs() / (decel[i] * h)).fold(0.0, f64::max);
        assert!((used - 1.0).abs() < 1e-9, "{used} of the deceleration");
        let left = slower[0] / qd[0];
        assert!((0.0..1.0).contains(&left));
        assert!((0..6).all(|i| (slower[i] - left * qd[i]).abs() < 1e-12), "{qd:?} {slower:?}");
    }
}
