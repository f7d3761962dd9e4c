//! The guard as a unit: millions of (state, proposal, elapsed), judged by independently written rules.

use crate::support::own_rules;

use own_rules::{Joint, State, joint};

use foretrace_control::arm::{Chain, JointLimits, JointMotion, velocity_box};
use foretrace_control::guard::{
    CommandChecker, Commanded, Guard, Reasons, StopProfile, Verdict, consumer_state,
};
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Commands judged per set of limits, six joints each.
const COMMANDS: usize = 500_000;
/// One command in this many is followed by a stop, and by a check of the consumer.
const STOPS: usize = 100;
/// Allowed excess of a stop \[rad\], for the rounding of velocities.
const ROUNDING_RAD: f64 = 2e-8;

/// The limits that the daemon gives its guard with a preset.
fn preset(urdf: &str, toml: &str) -> JointLimits<6> {
    let numbers = |key: &str| -> Vec<f64> {
        let line = toml.lines().find(|line| line.trim_start_matches("# ").starts_with(&format!("{key} = ")));
        let list = line.unwrap().split_once(" = ").unwrap().1.trim_matches(['[', ']']);
        list.split(", ").map(|number| number.parse().unwrap()).collect()
    };
    let array = |key: &str| <[f64; 6]>::try_from(numbers(key)).unwrap();
    let ends = Chain::<6>::from_urdf(urdf, None, None).unwrap().limits().clone();
    let velocity = array("velocity_radps");
    let velocity = std::array::from_fn(|i| velocity[i].min(ends.velocity[i]));
    JointLimits::new(ends.position, velocity, array("acceleration_radps2"))
        .unwrap()
        .with_stale_braking(
            numbers("valid_periods")[0] / numbers("rate_hz")[0],
            array("stale_deceleration_radps2"),
        )
        .unwrap()
}

fn ur5() -> JointLimits<6> {
    preset(
        include_str!("../../../../config/robots/ur5.urdf"),
        include_str!("../../../../config/presets/ur5.toml"),
    )
}

fn ur5e() -> JointLimits<6> {
    preset(
        include_str!("../../../../config/robots/ur5e.urdf"),
        concat!(
            include_str!("../../../../config/presets/ur5e.toml"),
            include_str!("../../../../config/presets/ur5.toml")
        ),
    )
}

/// Synthetic limits: narrow, one-sided, far from zero, continuous, slow to brake; `hold_s` of extrapolation.
fn made_up(hold_s: f64) -> JointLimits<6> {
    let infinite = f64::INFINITY;
    let position =
        [[-0.02, 0.001], [2.0, 2.5], [-6.3, 0.1], [-infinite, infinite], [-1.0, infinite], [-30.0, -29.0]];
    let acceleration = [8.0, 0.5, 40.0, 25.0, 100.0, 3.0];
    JointLimits::new(position, [3.1, 0.4, 6.0, 3.1, 0.01, 1.0], acceleration)
        .unwrap()
        .with_stale_braking(hold_s, [8.0, 0.5, 4.0, 20.0, 1.0, 2.9])
        .unwrap()
}

fn jerky(limits: JointLimits<6>) -> JointLimits<6> {
    limits.with_jerk([400.0, 5.0, 5000.0, 100.0, 900.0, 60.0]).unwrap()
}

/// The largest legal velocity at `q` toward the upper limit, to the last bit.
fn edge(joint: &Joint, q: f64) -> f64 {
    let (mut low, mut high) = (0.0, joint.velocity);
    if joint.excess(q, high) <= 0.0 {
        return high;
    }
    for _ in 0..64 {
        let middle = 0.5 * (low + high);
        if middle == low || middle == high {
            break;
        }
        if joint.excess(q, middle) <= 0.0 { low = middle } else { high = middle }
    }
    low
}

fn neighbour(rng: &mut Pcg64, x: f64) -> f64 {
    [x.next_down(), x, x.next_up()][rng.random_range(0..3)]
}

/// A legal state, most often on a boundary or one bit beside it.
fn start(rng: &mut Pcg64, joint: &Joint) -> State {
    let near = |x: f64, other: f64| if x.is_finite() { x } else { other };
    let (low, high) = (near(joint.low, -20.0), near(joint.high, 20.0));
    let q = match rng.random_range(0..6) {
        0 => neighbour(rng, low),
        1 => neighbour(rng, high),
        _ => low + (high - low) * rng.random_range(0.0..=1.0),
    };
    let mirrored = Joint { low: -joint.high, high: -joint.low, ..*joint };
    let up = edge(joint, q);
    let down = edge(&mirrored, -q);
    let qd = match rng.random_range(0..6) {
        0 => neighbour(rng, up),
        1 => -neighbour(rng, down),
        2 => 0.0,
        3 => 1e-310,
        _ => rng.random_range(-down..=up),
    };
    let a = joint.acceleration;
    State { q, qd, qdd: [0.0, a, -a, rng.random_range(-a..=a)][rng.random_range(0..4)] }
}

/// 0.1 ms to 0.5 s, most often about a tick.
fn elapsed_ns(rng: &mut Pcg64) -> u64 {
    match rng.random_range(0..8) {
        0..4 => 2_000_000,
        4 => rng.random_range(1_000_000..4_000_000),
        5 => 100_000,
        6 => 500_000_000,
        _ => (1e5 * 5000f64.powf(rng.random_range(0.0..=1.0))) as u64,
    }
}

fn proposal(rng: &mut Pcg64, joint: &Joint, q: f64, span: [f64; 2]) -> f64 {
    match rng.random_range(0..24) {
        0 => f64::INFINITY,
        1 => f64::MAX * rng.random_range(-1.0..=1.0),
        2 => q,
        3 => joint.low,
        4 => joint.high,
        5 => -1e-310,
        6 => neighbour(rng, q),
        7 | 8 => neighbour(rng, span[0]),
        9 => neighbour(rng, span[1]),
        10 => span[0] - 1e-13 * rng.random_range(0.0..=1.0),
        11..13 => span[0] + (span[1] - span[0]) * rng.random_range(0.0..=1.0),
        13..16 => q + rng.random_range(-10.0..10.0),
        _ => q + rng.random_range(-0.02..0.02),
    }
}

/// One joint of one answer; the state before was legal up to rounding.
fn judge(joint: &Joint, from: &State, proposed: f64, finite: bool, answer: &State, h: f64, altered: bool) {
    let told = || format!("{joint:?}\n{from:?}\nproposed {proposed:e} after {h} s\n{answer:?}");
    let v = (answer.q - from.q) / h;
    assert!(v == answer.qd && answer.qdd == (v - from.qd) / h, "claims something else: {}", told());
    let (low, high) = (joint.low.min(from.q), joint.high.max(from.q));
    assert!(answer.q >= low && answer.q <= high, "position: {}", told());
    let grain = 4.0 * f64::EPSILON * answer.q.abs().max(1.0) / h;
    assert!(v.abs() <= joint.velocity * (1.0 + 1e-7) + grain, "velocity: {}", told());
    let slack = 1e-7 * joint.acceleration * h + grain;
    assert!((v - from.qd).abs() <= joint.acceleration * h + slack, "acceleration: {}", told());
    assert!(joint.excess(answer.q, v) <= ROUNDING_RAD, "cannot stop any more: {}", told());
    let change = v - from.qd - from.qdd * h;
    let jerk = joint.jerk * h * h + slack + 1e-9;
    let probe = 3e-8 + 2.0 * slack;
    // Only a limit that must never be broken may break the jerk limit; the velocity limit does only if it
    // comes too late.
    let needed = |v: f64| {
        if joint.can_fade(from, probe) {
            joint.cannot_stop(from, v, h, probe)
        } else {
            joint.breaks_hard(from, v, h, probe)
        }
    };
    assert!(change <= jerk || needed(v - probe), "jerk up: {}", told());
    assert!(change >= -jerk || needed(v + probe), "jerk down: {}", told());
    if joint.can_fade(from, 0.0) && change.abs() <= jerk {
        let slack = probe * (1.0 + answer.qdd.abs() / (joint.jerk * h));
        assert!(joint.can_fade(answer, -slack), "too late for the velocity limit: {}", told());
    }
    let wanted = if finite { (proposed - from.q) / h } else { joint.braked(from.qd, h) };
    let further = v + probe.copysign(wanted - v);
    let is_nearest = (wanted - v).abs() <= 2.0 * probe
        || joint.breaks_hard(from, further, h, 2.0 * probe)
        || joint.breaks_jerk(from, further, h, 2.0 * probe);
    assert!(is_nearest, "not the nearest: {}", told());
    assert!(altered || answer.q == proposed, "altered unsaid: {}", told());
    if finite && altered {
        let illegal = joint.breaks_hard(from, wanted, h, probe) || joint.breaks_jerk(from, wanted, h, probe);
        assert!(illegal, "legal, but altered: {}", told());
    }
}

fn state(motion: &JointMotion<6>, i: usize) -> State {
    State { q: motion.q[i], qd: motion.qd[i], qdd: motion.qdd[i] }
}

/// A consumer without further commands ends at rest inside the limits, by its own rule and in between.
fn silence(joints: &[Joint; 6], command: &Commanded<6>) {
    let decel = joints.map(|joint| joint.deceleration);
    let until = command.stamp() + (joints[0].hold_s * 1e9).round() as u64;
    for at in [until, until + 50_000_000, until + 60_000_000_000] {
        let motion = consumer_state(command, until, &decel, at);
        for (q, joint) in motion.q.iter().zip(joints) {
            assert!(*q >= joint.low - ROUNDING_RAD && *q <= joint.high + ROUNDING_RAD, "{q} {joint:?}");
        }
    }
    let rest = consumer_state(command, until, &decel, until + 60_000_000_000);
    assert_eq!(rest.qd, [0.0; 6]);
}

/// A stop from `command` with ticks of `tick_ns` (varying if `uneven`) stays inside and ends at rest.
fn stop(rng: &mut Pcg64, limits: &JointLimits<6>, joints: &[Joint; 6], from: &Commanded<6>, uneven: bool) {
    let profile = StopProfile::new(*limits);
    let mut last = *from;
    for tick in 0.. {
        if StopProfile::is_done(&last) {
            break;
        }
        assert!(tick < 40_000, "never at rest: {from:?} {last:?}");
        let stamp = last.stamp() + if uneven { rng.random_range(100_000..20_000_000) } else { 2_000_000 };
        let h = stamp.seconds_since(last.stamp());
        let qd = profile.next(&last, stamp);
        let motion = JointMotion {
            q: std::array::from_fn(|i| last.q()[i] + qd[i] * h),
            qd,
            qdd: std::array::from_fn(|i| (qd[i] - last.qd()[i]) / h),
        };
        for (i, joint) in joints.iter().enumerate() {
            let (q, v) = (motion.q[i], motion.qd[i]);
            assert!(q >= joint.low - ROUNDING_RAD && q <= joint.high + ROUNDING_RAD, "{i} {motion:?}");
            let slack = 1e-7 * joint.acceleration * h + 1e-12;
            assert!((v - last.qd()[i]).abs() <= joint.acceleration * h + slack, "{i} {last:?} {motion:?}");
        }
        last = Commanded::new(stamp, motion).unwrap();
    }
}

fn millions_of_states(seed: u64, limits: &JointLimits<6>) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let guard = Guard::new(*limits);
    let joints: [Joint; 6] = std::array::from_fn(|i| joint(limits, i));
    let longest_s = limits.hold_s().max(0.1);
    let hold_ns = (limits.hold_s() * 1e9).round() as u64;
    let mut checker = CommandChecker::new(*limits);
    let mut goal = [1e3; 6];
    let mut last = Commanded::at_rest(Stamp(0), [0.0; 6]).unwrap();
    for k in 0..COMMANDS {
        // Long chains, often restarted on a boundary.
        if k % 20_000 < 10_000 && k % 8 == 0 || k % 20_000 == 0 {
            let states: [State; 6] = std::array::from_fn(|i| start(&mut rng, &joints[i]));
            let motion =
                JointMotion { q: states.map(|s| s.q), qd: states.map(|s| s.qd), qdd: states.map(|s| s.qdd) };
            last = Commanded::new(Stamp(1 << 40), motion).unwrap();
            checker.restart();
            checker.observe(last.stamp(), last.stamp() + hold_ns, last.q(), last.qd());
        }
        // In some of the chains every joint moves fast from one far goal to another, so that limits are
        // reached at full speed.
        let racing = k % 20_000 >= 15_000;
        let elapsed_ns = if racing { 2_000_000 } else { elapsed_ns(&mut rng) };
        if racing && rng.random_bool(0.01) {
            goal = std::array::from_fn(|_| rng.random_range(-1e3..1e3));
        }
        let h = (elapsed_ns as f64 * 1e-9).min(longest_s);
        let allowed = velocity_box(last.motion(), limits, h);
        let mut q: [f64; 6] = std::array::from_fn(|i| {
            if racing {
                return goal[i];
            }
            let ends = [allowed.lower[i], allowed.upper[i]].map(|v| last.q()[i] + v * h);
            proposal(&mut rng, &joints[i], last.q()[i], ends)
        });
        if !racing && rng.random_bool(0.02) {
            q[rng.random_range(0..6usize)] = f64::NAN;
        }
        let finite = q.iter().all(|x| x.is_finite());
        let stamp = last.stamp() + elapsed_ns;
        let Verdict { command, altered, reasons } = guard.clamp(&last, &q, stamp);
        assert_eq!(command.stamp(), stamp);
        assert_eq!(reasons.contains(Reasons::NOT_FINITE), !finite);
        assert_eq!(reasons.contains(Reasons::GAP), (elapsed_ns as f64 * 1e-9) > longest_s);
        for (i, joint) in joints.iter().enumerate() {
            let answer = state(command.motion(), i);
            let bit = altered >> i & 1 == 1;
            judge(joint, &state(last.motion(), i), q[i], finite, &answer, h, bit);
        }
        let legal = checker.observe(stamp, stamp + hold_ns, command.q(), command.qd());
        assert!(legal, "{last:?} {q:?} {command:?} {:?}", checker.statistics());
        if k % STOPS == 0 {
            silence(&joints, &command);
            stop(&mut rng, limits, &joints, &command, k % (2 * STOPS) == 0);
        }
        last = command;
    }
}

#[test]
fn ur5_of_the_preset() {
    millions_of_states(1, &ur5());
}

#[test]
fn ur5e_of_the_preset_with_a_jerk_limit() {
    millions_of_states(2, &ur5e().with_jerk([2000.0; 6]).unwrap());
}

#[test]
fn uneven_limits_and_a_consumer_that_brakes_at_once() {
    millions_of_states(3, &made_up(0.0));
}

#[test]
fn uneven_limits_with_jerk() {
    millions_of_states(4, &jerky(made_up(0.01)));
}

#[test]
fn consumers_that_go_on_for_longer_than_the_longest_step() {
    millions_of_states(5, &made_up(0.3));
}
