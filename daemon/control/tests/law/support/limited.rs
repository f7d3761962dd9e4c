//! Joint limits and random states, shared by the tests of guard and stop.

use foretrace_control::arm::{JointLimits, JointMotion};
use rand::RngExt;
use rand_pcg::Pcg64;

pub(crate) const TICK_NS: u64 = 2_000_000;
pub(crate) const TICK_S: f64 = 2e-3;
/// Rounding of (q' − q)/2 ms with q up to 6 rad: 1e-15·6/2e-3 = 4e-13 rad/s; over another 2 ms 2e-10 rad/s².
pub(crate) const ROUNDING_RADPS: f64 = 2e-9;

/// Uneven limits: a narrow joint, a continuous one, weak and strong ones; consumers brake at half the
/// acceleration.
pub(crate) fn limits() -> JointLimits<6> {
    let acceleration = [8.0, 40.0, 15.0, 3.0, 25.0, 60.0];
    let position =
        [[-6.3, 6.3], [-0.02, 0.03], [-3.1, 3.1], [-1.0, 0.5], [-f64::INFINITY, f64::INFINITY], [-2.0, 2.0]];
    JointLimits::new(position, [3.1, 2.0, 3.1, 0.5, 6.0, 3.1], acceleration)
        .unwrap()
        .with_stale_braking(5.0 * TICK_S, acceleration.map(|a| 0.5 * a))
        .unwrap()
}

pub(crate) fn with_jerk() -> JointLimits<6> {
    limits().with_jerk([400.0, 2000.0, 500.0, 100.0, 5000.0, 900.0]).unwrap()
}

/// A viable random motion, often close to limits.
pub(crate) fn viable(rng: &mut Pcg64, limits: &JointLimits<6>) -> JointMotion<6> {
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

pub(crate) fn hostile(rng: &mut Pcg64, q: f64) -> f64 {
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

pub(crate) fn assert_legal(
    limits: &JointLimits<6>,
    last: &JointMotion<6>,
    next: &JointMotion<6>,
    elapsed: f64,
) {
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
pub(crate) fn assert_viable(limits: &JointLimits<6>, motion: &JointMotion<6>) {
    let slower = |v: f64| if v.abs() <= 1e-8 { 0.0 } else { v * (1.0 - 1e-9) - 1e-8 * v.signum() };
    let slower = JointMotion { qd: motion.qd.map(slower), ..*motion };
    assert!(limits.is_viable(&slower), "{motion:?}");
}
