//! Limits and guard under seeded random and hostile input, millions of states.

use crate::support::limited;

use limited::*;

use foretrace_control::arm::{JointLimits, JointMotion, LimitError, velocity_box};
use foretrace_control::guard::{CommandChecker, Commanded, Guard, Reasons, consumer_state};
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

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
    use foretrace_control::arm::limits::viable_velocity;
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
            // From here on nothing of the bad start remains.
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
                    // Fast motion to a random goal, the hardest case for velocity and position limits.
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

#[test]
fn reasons_are_one_bit_each_as_on_the_wire_and_sets_add_up() {
    let all = [
        Reasons::NOT_FINITE,
        Reasons::POSITION,
        Reasons::VELOCITY,
        Reasons::ACCELERATION,
        Reasons::JERK,
        Reasons::STAMP,
        Reasons::GAP,
    ];
    assert_eq!(all.map(Reasons::bits), [1, 2, 4, 8, 16, 32, 64]);
    assert!(Reasons::NONE.is_empty() && Reasons::NONE == Reasons::default());
    for one in all {
        assert!(!one.is_empty() && one.with(Reasons::NONE) == one);
        for other in all {
            let both = one.with(other);
            assert_eq!(both.bits(), one.bits() | other.bits());
            assert!(both.contains(one) && both.contains(other) && both.contains(Reasons::NONE));
            assert_eq!((one.contains(other), one.contains(both)), (one == other, one == other));
        }
    }
}
