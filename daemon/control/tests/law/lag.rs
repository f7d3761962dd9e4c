//! The lag estimator against arms whose lag is known, alone and in the loop.

use crate::support;

use std::collections::VecDeque;

use crate::support::Bench;
use crate::support::lagging::{Arm, Kind, TICK_S, Writing, servo};
use foretrace_control::arm::lag::{Following, LagEstimate, LagEstimator};
use foretrace_control::follower::{Budget, FollowerSettings, StepInput};
use foretrace_control::predict::PredictorKind;
use foretrace_control::units::Stamp;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const TICK_NS: u64 = 2_000_000;

/// How joint states reach the estimator.
#[derive(Debug, Clone, Copy)]
struct Receipt {
    /// One joint state every this many ticks.
    every: u64,
    /// Noise \[rad\], approximate standard deviation.
    noise: f64,
    /// Constant distance between commanded and measured joints \[rad\].
    offset: f64,
    /// Stamps are late by 0 to this \[s\].
    jitter: f64,
}

const CLEAN: Receipt = Receipt { every: 1, noise: 0.0, offset: 0.0, jitter: 0.0 };
const ROUGH: Receipt = Receipt { every: 4, noise: 1e-4, offset: 0.02, jitter: 0.0 };

/// A loop of commands, an arm and the estimator.
struct Rig {
    rng: Pcg64,
    writing: Writing,
    arm: Arm<6>,
    estimator: LagEstimator<6>,
    receipt: Receipt,
    tick: u64,
    joints: [f64; 6],
    q: [f64; 6],
}

impl Rig {
    fn new(kind: Kind, receipt: Receipt, seed: u64) -> Self {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut writing = Writing::new(&mut rng);
        let q = writing.after(0.0);
        let arm = Arm::at_rest(kind, q);
        Self { rng, writing, arm, estimator: LagEstimator::new(), receipt, tick: 5_000, joints: q, q }
    }

    /// Writes on for `seconds`.
    fn write(&mut self, seconds: f64) -> Option<LagEstimate> {
        self.run(seconds, true)
    }

    fn run(&mut self, seconds: f64, moving: bool) -> Option<LagEstimate> {
        for _ in 0..(seconds / TICK_S) as u64 {
            let now = self.tick * TICK_NS;
            if self.tick.is_multiple_of(self.receipt.every) {
                let jitter = self.rng.random_range(0.0..=self.receipt.jitter);
                let noise = 1.7 * self.receipt.noise;
                let mut noisy = |q: f64| q + self.receipt.offset + self.rng.random_range(-noise..=noise);
                let measured = self.joints.map(&mut noisy);
                self.estimator.measured(Stamp(now + (jitter * 1e9) as u64), &measured);
            }
            if moving {
                self.q = self.writing.after(TICK_S);
            }
            self.tick += 1;
            self.estimator.commanded(Stamp(self.tick * TICK_NS), &self.q);
            self.joints = self.arm.obey(self.q);
        }
        self.estimator.estimate()
    }

    fn error_ms(&self) -> f64 {
        let estimate = self.estimator.estimate().expect("there was motion");
        (estimate.lag_s - self.arm.kind.group_delay_s() - 0.5 * self.receipt.jitter) * 1e3
    }
}

fn kinds() -> Vec<Kind> {
    let delays = [0.0, 0.004, 0.0335, 0.075, 0.1, 0.15].map(Kind::Delay);
    let servos = [0.03, 0.06, 0.1, 0.148].map(servo);
    let mixed = [
        Kind::Servo { delay: 0.05, filter: 0.05, damping: 1.0 },
        Kind::Servo { delay: 0.004, filter: 0.06, damping: 0.5 },
        Kind::First(0.05),
    ];
    delays.into_iter().chain(servos).chain(mixed).collect()
}

#[test]
fn lag_is_found_within_two_milliseconds_in_five_seconds_of_writing() {
    let jittered = Receipt { jitter: 0.004, ..ROUGH };
    for kind in kinds() {
        for receipt in [CLEAN, ROUGH, jittered] {
            let mut worst = 0.0_f64;
            for seed in 0..6 {
                let mut rig = Rig::new(kind, receipt, seed);
                rig.write(5.0);
                worst = worst.max(rig.error_ms().abs());
            }
            println!("{kind:?} every {} ticks, jitter {}: {worst:.2} ms", receipt.every, receipt.jitter);
            assert!(worst < 2.0, "{kind:?} {receipt:?}: {worst} ms");
        }
    }
}

#[test]
fn uncertainty_is_honest() {
    for kind in kinds() {
        let (mut inside, mut count, mut largest) = (0, 0, 0.0_f64);
        for seed in 20..26 {
            let mut rig = Rig::new(kind, Receipt { noise: 5e-4, ..ROUGH }, seed);
            rig.write(3.0);
            for _ in 0..20 {
                let std_ms = rig.write(0.5).unwrap().std_s * 1e3;
                inside += u32::from(rig.error_ms().abs() <= 2.0 * std_ms);
                count += 1;
                largest = largest.max(std_ms);
            }
        }
        println!("{kind:?}: {inside} of {count} within two standard deviations, the largest {largest:.2} ms");
        assert!(f64::from(inside) >= 0.9 * f64::from(count), "{kind:?}: {inside} of {count}");
        assert!(largest < 3.0, "{kind:?}: {largest} ms would move no dead time");
    }
}

#[test]
fn a_change_is_found_within_five_seconds() {
    let pairs = [
        (Kind::Delay(0.03), Kind::Delay(0.1)),
        (Kind::Delay(0.15), Kind::Delay(0.0)),
        (servo(0.03), servo(0.1)),
        (servo(0.1), servo(0.03)),
        (servo(0.03), Kind::Delay(0.15)),
    ];
    for (before, after) in pairs {
        for seed in 40..44 {
            let mut rig = Rig::new(before, ROUGH, seed);
            rig.write(6.0);
            rig.arm.kind = after;
            rig.write(5.0);
            assert!(rig.error_ms().abs() < 2.0, "{before:?} to {after:?}: {} ms", rig.error_ms());
        }
    }
}

#[test]
fn standing_still_neither_helps_nor_hurts() {
    let mut rig = Rig::new(servo(0.03), ROUGH, 3);
    assert_eq!(rig.run(10.0, false), None, "an arm that never moved");
    let before = rig.write(5.0).unwrap();
    let after = rig.run(60.0, false).unwrap();
    // The last motion is still pending when the command stops.
    assert!((after.lag_s - before.lag_s).abs() < 1e-3, "{before:?} {after:?}");
    assert!(after.std_s < 1e-3, "{after:?}");
}

#[test]
fn a_pure_delay_is_a_shift_and_a_filter_is_less() {
    for seed in 60..64 {
        let mut rig = Rig::new(Kind::Delay(0.06), CLEAN, seed);
        let estimate = rig.write(5.0).unwrap();
        assert!((estimate.shift_s - 0.06).abs() < 5e-4, "{estimate:?}");
        let mut rig = Rig::new(servo(0.1), CLEAN, seed);
        let estimate = rig.write(5.0).unwrap();
        assert!(estimate.shift_s < estimate.lag_s - 2e-3, "{estimate:?}");
        assert!(estimate.shift_s > 0.04, "{estimate:?}");
    }
}

#[test]
fn an_arm_that_does_not_follow_raises_doubt_and_is_forgotten_soon() {
    let mut rig = Rig::new(Kind::Delay(0.04), ROUGH, 9);
    let good = rig.write(5.0).unwrap();
    // Slowed down: it continues to where the commands were long ago.
    rig.arm.kind = Kind::Servo { delay: 0.3, filter: 0.4, damping: 1.0 };
    let doubtful = rig.write(3.0);
    assert!(doubtful.is_none_or(|estimate| estimate.std_s > 3e-3), "{good:?} then {doubtful:?}");
    rig.arm = Arm::at_rest(Kind::Delay(0.04), rig.q);
    rig.write(5.0);
    assert!(rig.error_ms().abs() < 2.0, "{} ms", rig.error_ms());
}

#[test]
fn a_stall_and_an_arming_anew_do_not_bias() {
    let mut rig = Rig::new(servo(0.06), ROUGH, 11);
    rig.write(4.0);
    for lost in [20, 400, 5_000] {
        rig.tick += lost;
        rig.arm = Arm::at_rest(rig.arm.kind, rig.q);
        rig.joints = rig.q;
        rig.write(3.0);
        assert!(rig.error_ms().abs() < 2.0, "{lost} ticks lost: {} ms", rig.error_ms());
    }
    rig.estimator.released();
    rig.write(3.0);
    assert!(rig.error_ms().abs() < 2.0, "{} ms", rig.error_ms());
}

#[test]
fn poisoned_and_random_inputs_leave_a_finite_estimate_in_bounds() {
    let poison = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, -1e300, 1e3, -999.0, 5e-324];
    for seed in 0..40 {
        let mut rng = Pcg64::seed_from_u64(900 + seed);
        let mut rig = Rig::new(Kind::Delay(0.05), ROUGH, seed);
        for _ in 0..400 {
            let any = |rng: &mut Pcg64| match rng.random_range(0..4) {
                0 => poison[rng.random_range(0..poison.len())],
                1 => rng.random_range(-1e3..1e3),
                _ => rng.random_range(-0.1..0.1),
            };
            let q: [f64; 6] = std::array::from_fn(|_| any(&mut rng));
            let stamp = match rng.random_range(0..6) {
                0 => Stamp(rng.random()),
                1 => Stamp(u64::MAX),
                2 => Stamp(0),
                _ => Stamp(
                    (rig.tick * TICK_NS).wrapping_add_signed(rng.random_range(-100_000_000..100_000_000)),
                ),
            };
            match rng.random_range(0..8) {
                0 => rig.estimator.released(),
                1 | 2 => rig.estimator.measured(stamp, &q),
                3 => rig.estimator.commanded(stamp, &q),
                _ => drop(rig.write(rng.random_range(0.0..0.1))),
            }
            if let Some(LagEstimate { lag_s, std_s, shift_s }) = rig.estimator.estimate() {
                assert!(
                    (-0.01..=0.3).contains(&lag_s) && (-0.02..=0.21).contains(&shift_s),
                    "{lag_s} {shift_s}"
                );
                assert!(std_s.is_finite() && std_s > 0.0, "{std_s}");
            }
        }
        // And it recovers.
        rig.tick += 1_000;
        rig.write(8.0);
        assert!(rig.error_ms().abs() < 2.0, "seed {seed}: {} ms", rig.error_ms());
    }
}

#[test]
fn the_same_inputs_give_the_same_estimate_bit_for_bit() {
    let run = || Rig::new(servo(0.03), ROUGH, 5).write(4.0).unwrap();
    let (a, b) = (run(), run());
    assert_eq!(
        [a.lag_s, a.std_s, a.shift_s].map(f64::to_bits),
        [b.lag_s, b.std_s, b.shift_s].map(f64::to_bits)
    );
}

/// Writes for `seconds` with an arm that lags by `late` ticks; calls `see` with τ \[ns\] and the estimate of
/// every tick.
fn follow(
    settings: FollowerSettings<6>,
    late: usize,
    seconds: f64,
    mut see: impl FnMut(u64, Option<LagEstimate>),
) {
    let mut bench = Bench::armed(settings);
    let mut behind = VecDeque::from(vec![bench.joints; late]);
    for tick in 0..(seconds / TICK_S) as u32 {
        let t = f64::from(tick) * TICK_S;
        let pen = bench.pen([0.03 * (7.0 * t).sin() * (0.9 * t).cos(), 0.025 * (11.0 * t).cos() - 0.025]);
        behind.push_back(bench.joints);
        let mut joints = behind.pop_front().unwrap();
        joints.stamp = bench.now;
        let input = StepInput { pen: &[pen], joints: Some(&joints), ..StepInput::nothing(bench.now) };
        let output = bench.step(&input, Budget::default());
        see(output.dead_time_ns, output.lag);
    }
}

fn settings(start_ns: u64, following: Following) -> FollowerSettings<6> {
    FollowerSettings {
        dead_time_ns: start_ns,
        following,
        ..support::settings(PredictorKind::CONSTANT_VELOCITY)
    }
}

#[test]
fn the_dead_time_of_the_loop_follows_the_arm_slowly() {
    let following = Following::Measured { max_ns: 80_000_000, rate: 0.02 };
    for (start_ms, late) in [(10, 25), (70, 10), (34, 0)] {
        let (mut before, mut last) = (start_ms * 1_000_000, (0, None));
        follow(settings(before, following), late, 8.0, |dead_time_ns, lag| {
            assert!(dead_time_ns.abs_diff(before) <= 40_001, "{before} to {dead_time_ns} in one tick");
            (before, last) = (dead_time_ns, (dead_time_ns, lag));
        });
        let (dead_time_ns, lag) = last;
        let error_ms = dead_time_ns as f64 * 1e-6 - late as f64 * 2.0;
        assert!(error_ms.abs() < 1.0, "{late} ticks late: {error_ms} ms; {lag:?}");
    }
}

#[test]
fn a_fixed_dead_time_stays_and_the_lag_is_known_all_the_same() {
    let mut newest = None;
    follow(settings(34_000_000, Following::Fixed), 30, 5.0, |dead_time_ns, lag| {
        assert_eq!(dead_time_ns, 34_000_000);
        newest = lag;
    });
    assert!((newest.unwrap().lag_s - 0.06).abs() < 1e-3, "{newest:?}");
}

#[test]
fn the_preview_has_room_for_the_longest_dead_time() {
    let at = |max_ns| settings(0, Following::Measured { max_ns, rate: 0.02 }).preview_steps(10).unwrap();
    assert_eq!(at(200_000_000) - at(0), 20);
    let refused = settings(0, Following::Measured { max_ns: 600_000_000, rate: 0.02 }).preview_steps(10);
    assert!(refused.unwrap_err().to_string().contains("600000000"));
    // A lag beyond the longest dead time is followed up to that.
    let mut newest = 0;
    let following = Following::Measured { max_ns: 40_000_000, rate: 0.1 };
    follow(settings(20_000_000, following), 40, 5.0, |dead_time_ns, _| newest = dead_time_ns);
    assert!((39_900_000..=40_000_000).contains(&newest), "{newest}");
}
