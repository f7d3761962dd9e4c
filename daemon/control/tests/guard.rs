//! Limits, guard, stop and the consumer's rule under seeded random and hostile input, millions of states.

use foretrace_control::guard::{CommandChecker, Commanded, Guard, Reasons, StopProfile, consumer_state};
use foretrace_control::ik::{JointLimits, JointMotion, LimitError, velocity_box};
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const TICK_NS: u64 = 2_000_000;
const TICK_S: f64 = 2e-3;
/// Rounding of (q' − q)/2 ms with q up to 6 rad: 1e-15·6/2e-3 = 4e-13 rad/s; over another 2 ms 2e-10 rad/s².
const ROUNDING_RADPS: f64 = 2e-9;

/// Uneven limits: a narrow joint, a continuous one, weak and strong ones; consumers brake at half the acceleration.
fn limits() -> JointLimits<6> {
    let acceleration = [8.0, 40.0, 15.0, 3.0, 25.0, 60.0];
    let position =
        [[-6.3, 6.3], [-0.02, 0.03], [-3.1, 3.1], [-1.0, 0.5], [-f64::INFINITY, f64::INFINITY], [-2.0, 2.0]];
    JointLimits::new(position, [3.1, 2.0, 3.1, 0.5, 6.0, 3.1], acceleration)
        .unwrap()
        .with_stale_braking(5.0 * TICK_S, acceleration.map(|a| 0.5 * a))
        .unwrap()
}

fn with_jerk() -> JointLimits<6> {
    limits().with_jerk([400.0, 2000.0, 500.0, 100.0, 5000.0, 900.0]).unwrap()
}

/// A viable random motion, often close to limits.
fn viable(rng: &mut Pcg64, limits: &JointLimits<6>) -> JointMotion<6> {
    loop {
        let mut motion = JointMotion::at_rest([0.0; 6]);
        for i in 0..6 {
            let [low, high] = limits.position()[i].map(|x| x.clamp(-20.0, 20.0));
            let share: f64 = rng.random_range(-0.1..1.1);
            motion.q[i] = low + (high - low) * share.clamp(0.0, 1.0);
            let v = limits.velocity()[i];
            motion.qd[i] =
                (v * rng.random_range(-1.2..1.2)).clamp(-v, v) * rng.random_range(0.0..1.0f64).powi(2);
            let a = limits.acceleration()[i];
            motion.qdd[i] = rng.random_range(-a..a);
        }
        if limits.is_viable(&motion) {
            return motion;
        }
    }
}

fn hostile(rng: &mut Pcg64, q: f64) -> f64 {
    match rng.random_range(0..12) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => -f64::INFINITY,
        3 => f64::MAX,
        4 => q,
        5 => q + rng.random_range(-10.0..10.0),
        6 => -q,
        7 => 1e-310,
        _ => q + rng.random_range(-0.01..0.01),
    }
}

fn assert_legal(limits: &JointLimits<6>, last: &JointMotion<6>, next: &JointMotion<6>, elapsed: f64) {
    assert!(next.is_finite());
    for i in 0..6 {
        let [low, high] = limits.position()[i];
        assert!(next.q[i] >= low && next.q[i] <= high, "joint {i} position {}", next.q[i]);
        let v = (next.q[i] - last.q[i]) / elapsed;
        assert!((v - next.qd[i]).abs() <= ROUNDING_RADPS, "joint {i} claims {} but covers {v}", next.qd[i]);
        assert!(v.abs() <= limits.velocity()[i] + ROUNDING_RADPS, "joint {i} velocity {v}");
        let change = (v - last.qd[i]).abs();
        let allowed = limits.acceleration()[i] * elapsed + ROUNDING_RADPS;
        assert!(change <= allowed, "joint {i} change of velocity {change} above {allowed}");
    }
}

/// Viable up to rounding: the same state, slower by the tolerance.
fn assert_viable(limits: &JointLimits<6>, motion: &JointMotion<6>) {
    let slower = |v: f64| if v.abs() <= 1e-8 { 0.0 } else { v * (1.0 - 1e-9) - 1e-8 * v.signum() };
    let slower = JointMotion { qd: motion.qd.map(slower), ..*motion };
    assert!(limits.is_viable(&slower), "{motion:?}");
}

#[test]
fn the_box_is_never_empty_and_keeps_a_viable_state_viable() {
    let mut rng = Pcg64::seed_from_u64(1);
    for limits in [limits(), with_jerk()] {
        for _ in 0..200_000 {
            let motion = viable(&mut rng, &limits);
            let h = TICK_S * [0.1, 0.5, 1.0, 1.0, 3.0, 20.0, 50.0][rng.random_range(0..7usize)];
            let allowed = velocity_box(&motion, &limits, h);
            // Anything in the box may be chosen; the ends are the worst.
            let pick: f64 = [0.0, 1.0, rng.random_range(0.0..1.0)][rng.random_range(0..3usize)];
            let mut next = motion;
            for i in 0..6 {
                let (low, high) = (allowed.lower[i], allowed.upper[i]);
                assert!(low <= high, "joint {i}: [{low}, {high}]");
                let a = limits.acceleration()[i] * h;
                assert!(low >= motion.qd[i] - a && high <= motion.qd[i] + a);
                assert!(high <= limits.velocity()[i] && low >= -limits.velocity()[i]);
                if limits.jerk().is_none() {
                    let braking = motion.qd[i] - motion.qd[i].clamp(-a, a);
                    assert!(
                        low <= braking && braking <= high,
                        "joint {i} cannot brake: [{low}, {high}], {braking}"
                    );
                }
                next.qd[i] = low + pick * (high - low);
                next.q[i] += next.qd[i] * h;
            }
            assert_viable(&limits, &next);
        }
    }
}

/// v(h + hold) + v²/(2a) = room with a = 2, h + hold = 0.5: room 3 gives v = 2 (2·0.5 + 4/4 = 2 for room 2).
#[test]
fn viable_velocity_is_the_one_worked_by_hand() {
    use foretrace_control::ik::limit::viable_velocity;
    assert!((viable_velocity(2.0, 0.25, 0.25, 2.0, 100.0) - 2.0).abs() < 1e-15);
    assert_eq!(viable_velocity(0.0, 0.25, 0.25, 2.0, 100.0), 0.0);
    assert_eq!(viable_velocity(f64::INFINITY, 0.25, 0.25, 2.0, 100.0), 100.0);
    // Beyond the limit it leads back, to the limit or at a tenth of full speed.
    assert_eq!(viable_velocity(-0.5, 0.25, 0.25, 2.0, 100.0), -2.0);
    assert_eq!(viable_velocity(-50.0, 0.25, 0.25, 2.0, 100.0), -10.0);
}

#[test]
fn outside_the_limits_the_box_leads_back() {
    let mut rng = Pcg64::seed_from_u64(2);
    let limits = limits();
    for _ in 0..200 {
        let mut motion = JointMotion::at_rest(std::array::from_fn(|_| rng.random_range(-9.0..9.0)));
        for i in 0..6 {
            motion.qd[i] = rng.random_range(-1.5..1.5) * limits.velocity()[i];
        }
        let mut last_excess = [f64::INFINITY; 6];
        for tick in 0..100_000 {
            let allowed = velocity_box(&motion, &limits, TICK_S);
            for i in 0..6 {
                assert!(allowed.lower[i] <= allowed.upper[i]);
                let a = limits.acceleration()[i] * TICK_S;
                assert!(
                    allowed.lower[i] >= motion.qd[i] - a - 1e-12
                        && allowed.upper[i] <= motion.qd[i] + a + 1e-12
                );
                // The most reluctant choice.
                let outward = if motion.q[i] > 0.0 { allowed.upper[i] } else { allowed.lower[i] };
                motion.qd[i] = outward;
                motion.q[i] += outward * TICK_S;
                let [low, high] = limits.position()[i];
                let excess = (motion.q[i] - high).max(low - motion.q[i]);
                let overshooting = motion.qd[i] * motion.q[i] > 0.0;
                assert!(
                    overshooting || excess <= last_excess[i].max(0.0) + 1e-12,
                    "joint {i} moves on outward"
                );
                last_excess[i] = excess;
            }
            // From here on nothing is left of the bad start.
            if last_excess.iter().all(|e| *e <= 1e-9) {
                break;
            }
            assert!(tick < 99_999, "never came back: {motion:?}");
        }
    }
}

#[test]
fn bad_limits_are_refused_with_the_number() {
    let bad = |p: [f64; 2], v: f64, a: f64| JointLimits::new([p], [v], [a]).unwrap_err().to_string();
    assert!(bad([1.0, -2.0], 1.0, 1.0).contains("-2"));
    assert!(bad([-1.0, f64::NAN], 1.0, 1.0).contains("NaN"));
    assert!(bad([-1.0, 1.0], -3.0, 1.0).contains("velocity limit -3 rad/s"));
    assert!(bad([-1.0, 1.0], 1.0, f64::INFINITY).contains("acceleration limit inf"));
    let good = JointLimits::new([[-1.0, 1.0]], [1.0], [1.0]).unwrap();
    assert_eq!(good.with_stale_braking(2.0, [1.0]), Err(LimitError::Hold { hold_s: 2.0 }));
    assert!(matches!(good.with_stale_braking(0.0, [2.0]), Err(LimitError::Deceleration { joint: 0, .. })));
    assert!(matches!(good.with_jerk([0.0]), Err(LimitError::NotPositive { quantity: "jerk", .. })));
}

#[test]
fn a_legal_proposal_passes_bit_for_bit() {
    let mut rng = Pcg64::seed_from_u64(3);
    for limits in [limits(), with_jerk()] {
        let guard = Guard::new(limits);
        for _ in 0..100_000 {
            let motion = viable(&mut rng, &limits);
            let last = Commanded::new(Stamp(5), motion).unwrap();
            let allowed = velocity_box(&motion, &limits, TICK_S);
            let q: [f64; 6] = std::array::from_fn(|i| {
                let v =
                    allowed.lower[i] + rng.random_range(0.0..=1.0) * (allowed.upper[i] - allowed.lower[i]);
                (motion.q[i] + v * TICK_S).clamp(limits.position()[i][0], limits.position()[i][1])
            });
            let verdict = guard.clamp(&last, &q, Stamp(5 + TICK_NS));
            assert_eq!((verdict.altered, verdict.reasons), (0, Reasons::NONE));
            assert_eq!(*verdict.command.q(), q);
        }
    }
}

#[test]
fn whatever_is_proposed_what_leaves_is_legal_and_viable() {
    let mut rng = Pcg64::seed_from_u64(4);
    for limits in [limits(), with_jerk()] {
        let guard = Guard::new(limits);
        let mut checker = CommandChecker::new(limits);
        for _ in 0..20 {
            let mut last = Commanded::new(Stamp(1_000_000_000), viable(&mut rng, &limits)).unwrap();
            checker.restart();
            let mut target = *last.q();
            for _ in 0..10_000 {
                let elapsed = TICK_NS * [1, 1, 1, 1, 2, 7, 40][rng.random_range(0..7usize)];
                let stamp = last.stamp() + elapsed;
                let q: [f64; 6] = if rng.random_bool(0.2) {
                    std::array::from_fn(|i| hostile(&mut rng, last.q()[i]))
                } else {
                    // Race to a wild goal, the hardest for velocity and position limits.
                    if rng.random_bool(0.02) {
                        target = std::array::from_fn(|_| rng.random_range(-8.0..8.0));
                    }
                    target
                };
                let verdict = guard.clamp(&last, &q, stamp);
                let h = elapsed as f64 * 1e-9;
                assert_legal(&limits, last.motion(), verdict.command.motion(), h);
                assert_viable(&limits, verdict.command.motion());
                for i in 0..6 {
                    assert_eq!(verdict.altered >> i & 1 == 1, verdict.command.q()[i] != q[i]);
                }
                if verdict.altered != 0 {
                    assert!(
                        !verdict.reasons.is_empty()
                            || q.iter().zip(verdict.command.q()).all(|(a, b)| (a - b).abs() < 1e-9)
                    );
                }
                assert_eq!(verdict.reasons.contains(Reasons::NOT_FINITE), q.iter().any(|x| !x.is_finite()));
                let (next, until) = (verdict.command, stamp + 5 * TICK_NS);
                assert!(
                    checker.observe(next.stamp(), until, next.q(), next.qd()),
                    "{:?}",
                    checker.statistics()
                );
                // Silence after any command must end at rest inside the limits.
                let rest = consumer_state(&next, until, limits.deceleration(), until + 60_000_000_000);
                let slack = 1e-9;
                for (q, [low, high]) in rest.q.iter().zip(limits.position()) {
                    assert!(*q >= low - slack && *q <= high + slack);
                }
                assert_eq!(rest.qd, [0.0; 6]);
                last = next;
            }
        }
        assert_eq!(checker.statistics().limit_violations, 0);
        assert_eq!(checker.statistics().count, 200_000);
    }
}

#[test]
fn every_reason_is_named() {
    let limits = JointLimits::new([[-1.0, 1.0]; 6], [2.0; 6], [100.0; 6]).unwrap();
    let guard = Guard::new(limits);
    let last = Commanded::at_rest(Stamp(0), [0.999; 6]).unwrap();
    let tick = Stamp(TICK_NS);
    let mut q = [0.999; 6];
    let why = |q: &[f64; 6], stamp| guard.clamp(&last, q, stamp);
    assert_eq!(why(&q, tick).reasons, Reasons::NONE);
    q[2] = 0.9995;
    let accelerated = why(&q, tick);
    assert_eq!((accelerated.reasons, accelerated.altered), (Reasons::ACCELERATION, 0b100));
    q[2] = 0.99;
    assert_eq!(why(&q, tick).reasons, Reasons::ACCELERATION.with(Reasons::VELOCITY));
    q[2] = 1.5;
    let far = why(&q, tick).reasons;
    assert!(far.contains(Reasons::POSITION) && far.contains(Reasons::VELOCITY));
    q[2] = f64::NAN;
    let broken = why(&q, tick);
    assert_eq!((broken.reasons, *broken.command.q()), (Reasons::NOT_FINITE, [0.999; 6]));
    q[2] = 0.9;
    let repeated = why(&q, Stamp(0));
    assert_eq!((repeated.reasons, repeated.command, repeated.altered), (Reasons::STAMP, last, 0b100));
    assert!(why(&[0.999; 6], Stamp(10_000_000_000)).reasons.contains(Reasons::GAP));
    let jerky = Guard::new(limits.with_jerk([1000.0; 6]).unwrap());
    q[2] = 0.999 - 0.0001;
    let verdict = jerky.clamp(&last, &q, tick);
    assert_eq!((verdict.reasons, verdict.altered), (Reasons::JERK, 0b100));
    assert!((verdict.command.qdd()[2] + 2.0).abs() < 1e-9, "{:?}", verdict.command.qdd());
}

#[test]
fn commands_that_are_not_finite_cannot_be_made() {
    assert!(Commanded::at_rest(Stamp(0), [0.0, f64::NAN]).is_none());
    assert!(Commanded::new(Stamp(0), JointMotion { q: [0.0], qd: [f64::INFINITY], qdd: [0.0] }).is_none());
}

/// By hand: q = 1, q̇ = 2 at stamp 1 s, valid for 10 ms, braking at 4: glides 0.02, brakes 0.5 s over 0.5 rad.
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

/// Steps through a stop and returns how many ticks it took.
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
                // Where braking starts so late that the velocity limit bites, acceleration wins.
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

/// Speed 1.2 at 10 rad/s², jerk 1000: ramps of 10 ms. v/a + a/j = 0.12 + 0.01 s = 65 ticks, and a tick or two of grid.
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
    // A command after a stall may start from anywhere the consumer may have braked to.
    let mut checker = start();
    assert!(checker.observe(Stamp(tick), Stamp(7 * TICK_NS), &[0.0004], &[0.2]));
    assert!(checker.observe(Stamp(52 * TICK_NS), Stamp(57 * TICK_NS), &[0.005], &[0.0]));
    assert!((checker.statistics().max_step_rad - 0.0046).abs() < 1e-12);
    assert!((checker.statistics().max_acceleration_radps2 - 100.0).abs() < 1e-6);
}
