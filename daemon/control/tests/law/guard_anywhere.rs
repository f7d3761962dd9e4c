//! The guard from states that it would never reach itself: outside the limits, too fast to stop inside them,
//! or absurd.

use crate::support::limited;

use limited::*;

use foretrace_control::arm::{JointLimits, JointMotion};
use foretrace_control::guard::{Commanded, Guard, Reasons, StopProfile};
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Outside, too fast, or where braking no longer helps.
fn anywhere(rng: &mut Pcg64, limits: &JointLimits<6>) -> JointMotion<6> {
    let mut motion = JointMotion::at_rest([0.0; 6]);
    for i in 0..6 {
        let [low, high] = limits.position()[i].map(|x| x.clamp(-20.0, 20.0));
        let beyond = (high - low) * [0.0, 1e-12, 1e-6, 0.01, 1.0][rng.random_range(0..5usize)];
        motion.q[i] = rng.random_range(low - beyond..=high + beyond);
        motion.qd[i] = rng.random_range(-2.0..2.0) * limits.velocity()[i];
        motion.qdd[i] = rng.random_range(-2.0..2.0) * limits.acceleration()[i];
    }
    motion
}

/// Acceleration is kept whatever the state, and under proposals that lead further out every joint comes back
/// and can stop.
#[test]
fn acceleration_is_kept_and_the_way_leads_back_from_anywhere() {
    let mut rng = Pcg64::seed_from_u64(11);
    for limits in [limits(), with_jerk()] {
        let guard = Guard::new(limits);
        for _ in 0..400 {
            let mut last = Commanded::new(Stamp(1 << 40), anywhere(&mut rng, &limits)).unwrap();
            let mut returned = false;
            for tick in 0.. {
                let q: [f64; 6] = std::array::from_fn(|i| {
                    let outward = 10f64.copysign(last.q()[i] - limits.position()[i][0].clamp(-20.0, 20.0));
                    if rng.random_bool(0.2) { hostile(&mut rng, last.q()[i]) } else { last.q()[i] + outward }
                });
                let elapsed =
                    if rng.random_bool(0.2) { rng.random_range(100_000..20_000_000) } else { TICK_NS };
                let next = guard.clamp(&last, &q, last.stamp() + elapsed).command;
                let h = elapsed as f64 * 1e-9;
                for i in 0..6 {
                    let change = (next.qd()[i] - last.qd()[i]).abs();
                    let allowed = limits.acceleration()[i] * h;
                    assert!(change <= allowed * (1.0 + 1e-7) + 1e-10, "joint {i}: {last:?} {next:?}");
                    let [low, high] = limits.position()[i];
                    // A joint that is outside and not moving outwards fast goes no farther.
                    let outside = if last.q()[i] > high {
                        1.0
                    } else if last.q()[i] < low {
                        -1.0
                    } else {
                        0.0
                    };
                    let racing = last.qd()[i] * outside > 0.0;
                    let further = (next.q()[i] - last.q()[i]) * outside;
                    assert!(racing || further <= 0.0, "joint {i}: {last:?} {next:?}");
                }
                last = next;
                if returned {
                    assert_viable(&limits, last.motion());
                }
                returned |= limits.is_viable(last.motion());
                if returned && tick > 500 {
                    break;
                }
                assert!(tick < 100_000, "never came back: {last:?}");
            }
        }
    }
}

/// A state that is merely finite: answers stay finite.
#[test]
fn absurd_states_have_finite_answers() {
    let mut rng = Pcg64::seed_from_u64(12);
    let numbers = [0.0, 1e-310, 1.0, -6.2, 1e17, -1e160, f64::MAX, f64::MIN, 1e300, -1e307];
    for limits in [limits(), with_jerk()] {
        let (guard, profile) = (Guard::new(limits), StopProfile::new(limits));
        for _ in 0..20_000 {
            let mut some = || std::array::from_fn(|_| numbers[rng.random_range(0..numbers.len())]);
            let motion = JointMotion { q: some(), qd: some(), qdd: some() };
            let mut last = Commanded::new(Stamp(5), motion).unwrap();
            for k in 0..6 {
                let stamp = last.stamp() + [1, 100_000, TICK_NS, 500_000_000, u64::MAX >> 3][k % 5];
                assert!(profile.next(&last, stamp).iter().all(|v| v.is_finite()), "{last:?}");
                let q = std::array::from_fn(|_| numbers[rng.random_range(0..numbers.len())]);
                last = guard.clamp(&last, &q, stamp).command;
                assert!(last.motion().is_finite(), "{motion:?} {last:?}");
                let back = guard.clamp(&last, &q, Stamp(last.stamp().0 - 1));
                assert_eq!((back.command, back.reasons), (last, Reasons::STAMP));
            }
        }
    }
}
