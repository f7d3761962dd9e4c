//! The jerk-limited stop against an online trajectory generator (crate `rsruckig`): in the limit of short
//! ticks they agree.
//!
//! Both bring velocity and acceleration to zero under the same limits of acceleration and jerk; the
//! generator's answer is the time-optimal one in continuous time. In ticks the acceleration of a whole tick
//! is that at its end, so that from (v, a) to rest Σ a·h = ∫ a dt − a·h/2: the stop in ticks is the
//! continuous one from v − a·h/2, and that is what the generator is asked for. (Asked from v it is the same
//! in the limit, but where a stop is nearly one fading of the acceleration, duration depends on the square
//! root of velocity, and half a tick of it is many ticks of time.) The remaining difference: each of the at
//! most three pieces of constant jerk begins and ends on a tick. So duration and distance differ by a tick or
//! two, whatever the tick: tested at two, one a tenth of the other.

use foretrace_control::arm::{JointLimits, JointMotion};
use foretrace_control::guard::{Commanded, StopProfile};
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rsruckig::prelude::{
    ControlInterface, IgnoreErrorHandler, InputParameter, Ruckig, RuckigResult, Trajectory,
};

const STATES: usize = 3000;
/// Ticks by which a duration may differ: two edges that have to wait for theirs.
const DURATION_TICKS: f64 = 2.1;
/// Ticks at the greatest speed by which a distance may differ: half of one for the velocity, half for the
/// edges.
const DISTANCE_TICKS: f64 = 1.1;

/// Limits and motion of one joint.
#[derive(Debug, Clone, Copy)]
struct Case {
    velocity: f64,
    acceleration: f64,
    jerk: f64,
    v: f64,
    a: f64,
}

/// Duration \[s\] and distance \[rad\] of a stop.
#[derive(Debug, Clone, Copy)]
struct Stop {
    duration: f64,
    distance: f64,
}

fn case(rng: &mut Pcg64) -> Case {
    loop {
        let (velocity, acceleration): (f64, f64) = (rng.random_range(0.5..6.0), rng.random_range(2.0..60.0));
        let jerk = acceleration / rng.random_range(0.01..0.3);
        let v: f64 = rng.random_range(-velocity..velocity);
        let a: f64 = rng.random_range(-acceleration..acceleration);
        // The velocity limit must not interfere: it would let the stop break the jerk limit.
        if v.abs() + a * a / (2.0 * jerk) < 0.95 * velocity {
            return Case { velocity, acceleration, jerk, v, a };
        }
    }
}

/// The generator's stop, for ticks of `h` seconds.
fn generated(case: &Case, h: f64) -> Stop {
    let mut input = InputParameter::<1>::new(None);
    input.control_interface = ControlInterface::Velocity;
    input.max_velocity[0] = case.velocity;
    input.max_acceleration[0] = case.acceleration;
    input.max_jerk[0] = case.jerk;
    input.current_velocity[0] = case.v - 0.5 * case.a * h;
    input.current_acceleration[0] = case.a;
    let mut trajectory = Trajectory::new(None);
    let result = Ruckig::<1, IgnoreErrorHandler>::new(None, 0.001).calculate(&input, &mut trajectory);
    assert!(matches!(result, Ok(RuckigResult::Working | RuckigResult::Finished)), "{case:?}: {result:?}");
    let duration = trajectory.get_duration();
    let mut position = input.current_position.clone();
    trajectory.at_time(duration, &mut Some(&mut position), &mut None, &mut None, &mut None, &mut None);
    Stop { duration, distance: position[0] }
}

/// Mixture, in ticks of `tick_ns`; never harder than the limits.
fn ticked(case: &Case, tick_ns: u64) -> Stop {
    let infinite = [[f64::NEG_INFINITY, f64::INFINITY]];
    let limits = JointLimits::new(infinite, [case.velocity], [case.acceleration]).unwrap();
    let profile = StopProfile::new(limits.with_jerk([case.jerk]).unwrap());
    let h = tick_ns as f64 * 1e-9;
    let mut last = Commanded::new(Stamp(0), JointMotion { q: [0.0], qd: [case.v], qdd: [case.a] }).unwrap();
    let mut ticks = 0;
    while !StopProfile::is_done(&last) {
        let stamp = last.stamp() + tick_ns;
        let qd = profile.next(&last, stamp);
        let qdd = [(qd[0] - last.qd()[0]) / h];
        let rounding = 1e-9 / h;
        assert!(qdd[0].abs() <= case.acceleration + rounding, "{case:?}: {last:?} {qdd:?}");
        assert!(
            (qdd[0] - last.qdd()[0]).abs() <= case.jerk * h + 2.0 * rounding,
            "{case:?}: {last:?} {qdd:?}"
        );
        let q = [last.q()[0] + qd[0] * h];
        last = Commanded::new(stamp, JointMotion { q, qd, qdd }).unwrap();
        ticks += 1;
        assert!(ticks < 1_000_000, "{case:?} never stops");
    }
    Stop { duration: f64::from(ticks) * h, distance: last.q()[0] }
}

/// Largest differences over all cases: of durations in ticks, of distances in ticks at the greatest speed on
/// the way.
fn largest(cases: &[Case], tick_ns: u64) -> [f64; 2] {
    let h = tick_ns as f64 * 1e-9;
    cases.iter().fold([0.0; 2], |[duration, distance], case| {
        let (theirs, ours) = (generated(case, h), ticked(case, tick_ns));
        let fastest = case.v.abs() + case.a * case.a / (2.0 * case.jerk);
        let differ = [
            (theirs.duration - ours.duration).abs() / h,
            (theirs.distance - ours.distance).abs() / (h * fastest),
        ];
        assert!(differ[0] <= DURATION_TICKS, "{case:?}: {theirs:?} {ours:?} {differ:?} ticks");
        assert!(differ[1] <= DISTANCE_TICKS, "{case:?}: {theirs:?} {ours:?} {differ:?} ticks");
        [duration.max(differ[0]), distance.max(differ[1])]
    })
}

#[test]
fn stop_takes_as_long_and_goes_as_far_as_the_time_optimal_one() {
    let mut rng = Pcg64::seed_from_u64(1);
    let cases: Vec<Case> = (0..STATES).map(|_| case(&mut rng)).collect();
    for tick_ns in [1_000_000, 100_000] {
        let [duration, distance] = largest(&cases, tick_ns);
        println!("{} ms: duration within {duration:.2} ticks, distance {distance:.2}", tick_ns as f64 * 1e-6);
    }
}
