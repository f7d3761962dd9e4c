//! Claims about the identification, against simulated arms of known lag.

use std::f64::consts::TAU;

use super::*;
use crate::arm::{ArmModel, ArmSettings, DelayChange, DelaySettings};

/// A gentle motion of several joints for `seconds` with rest before and after, commanded every 2 ms.
fn motion(seconds: f64) -> impl Fn(f64) -> [f64; JOINTS] {
    move |t_s: f64| {
        let u = t_s - 0.5;
        let window = (u.min(seconds - u) / 0.5).clamp(0.0, 1.0);
        let window = window * window * (3.0 - 2.0 * window);
        let [a, b, c] = [0.6, 1.7, 3.1].map(|f| (TAU * f * u).sin() / f);
        [0.010 * a, 0.008 * b, 0.006 * (a + c), 0.012 * c, 0.0, 1e-5 * a].map(|q| -0.5 + q * window)
    }
}

struct Noise(u64);

impl Noise {
    /// Approximately normal, standard deviation 1.
    fn next(&mut self) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            sum += (self.0 >> 11) as f64 / (1_u64 << 53) as f64;
        }
        sum
    }
}

/// What is recorded while `settings`' arm follows `motion`; noise in rad.
fn recorded(settings: ArmSettings, seconds: f64, noise_rad: f64) -> (Vec<Sample>, Vec<Sample>) {
    let motion = motion(seconds);
    let end_s = seconds + 1.2;
    let commands =
        (0..(end_s / 0.002) as u32).map(|k| f64::from(k) * 0.002).map(|t_s| Sample { t_s, q: motion(t_s) });
    let commands: Vec<Sample> = commands.collect();
    let mut arm = ArmModel::at_rest(settings, motion(0.0));
    let mut noise = Noise(7);
    let states = (0..(end_s / settings.cycle_s) as u32).map(|k| {
        let t_s = f64::from(k) * settings.cycle_s;
        let q = arm.joints().q.map(|q| q + 0.01 + noise_rad * noise.next());
        arm.cycle(motion(t_s));
        Sample { t_s, q }
    });
    let states = states.collect();
    (commands, states)
}

fn found(settings: ArmSettings, noise_rad: f64) -> Identified {
    let (commands, states) = recorded(settings, 5.0, noise_rad);
    identify(&commands, &states).unwrap()
}

#[test]
fn pure_delays_from_0_to_150_ms_are_found_within_a_millisecond() {
    for cycle_s in [0.002, 0.008] {
        for noise_rad in [0.0, 1e-4] {
            for lag_s in [0.0, 0.0123, 0.034, 0.070, 0.100, 0.150] {
                let settings = ArmSettings::delayed(cycle_s, cycle_s + lag_s);
                let found = found(settings, noise_rad);
                let wrong_ms = (found.shift.delay_s - settings.group_delay_s()) * 1e3;
                assert!(wrong_ms.abs() < 0.1, "{cycle_s} {noise_rad} {lag_s}: {wrong_ms} ms");
                assert!((found.servo.lag_s() - found.shift.delay_s).abs() < 1e-4, "{found:?}");
                assert_eq!(found.verdict, LagModel::PureDelay, "{cycle_s} {noise_rad} {lag_s}: {found:?}");
                assert!(found.shift_spread.interquartile_s < 1e-3, "{:?}", found.shift_spread);
            }
        }
    }
}

#[test]
fn servos_are_told_apart_from_delays_and_found_within_two_milliseconds() {
    for cycle_s in [0.002, 0.008] {
        for (lag_s, filter_s) in
            [(0.0, 0.030), (0.066, 0.030), (0.0, 0.100), (0.050, 0.100), (0.1, 0.05), (0.01, 0.015)]
        {
            let delay = DelaySettings::constant(lag_s);
            let settings = ArmSettings { delay, ..ArmSettings::ur5(cycle_s, filter_s) };
            let found = found(settings, 1e-4);
            let case = format!("{cycle_s} {lag_s} {filter_s}: {found:?}");
            assert!((found.servo.lag_s() - settings.group_delay_s()).abs() < 0.5e-3, "{case}");
            assert!((found.servo.filter_s - filter_s).abs() < 2e-3, "{case}");
            assert_eq!(found.verdict, LagModel::Servo, "{case}");
            // A filter delays fast motion less, so a pure shift fits best with less.
            assert!(found.shift.delay_s < found.servo.lag_s() + 1e-5, "{case}");
            assert!(found.lag_spread.blocks_s.len() >= BLOCKS - 2, "{case}");
            assert!((found.lag_spread.median_s - found.servo.lag_s()).abs() < 0.5e-3, "{case}");
        }
    }
}

#[test]
fn only_joints_that_move_count_and_the_curve_has_its_foot_at_the_shift() {
    let found = found(ArmSettings::delayed(0.002, 0.04), 0.0);
    assert_eq!(found.joints.len(), 4);
    assert_eq!(found.joints[0], 0, "{:?}", found.moved_rad);
    let foot = found.curve.iter().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    assert!((foot.0 - 0.04).abs() <= 0.001 && found.curve.len() > 100);
}

#[test]
fn jitter_and_a_change_in_mid_run_show_in_the_spread() {
    let calm = found(ArmSettings::delayed(0.002, 0.04), 0.0).shift_spread.interquartile_s;
    let delay = DelaySettings {
        change: Some(DelayChange { at_s: 3.0, delay_s: 0.06 }),
        ..DelaySettings::constant(0.03)
    };
    let changed = found(ArmSettings { delay, ..ArmSettings::ur5(0.002, 0.0) }, 0.0).shift_spread;
    assert!(calm < 1e-4 && changed.interquartile_s > 0.02, "{calm} {changed:?}");
    assert!((changed.blocks_s[1] - 0.034).abs() < 1e-3 && (changed.blocks_s[8] - 0.064).abs() < 1e-3);
    let delay = DelaySettings { jitter_s: 0.01, seed: 3, ..DelaySettings::constant(0.04) };
    let settings = ArmSettings { delay, ..ArmSettings::delayed(0.002, 0.0) };
    // The newest target that arrived counts, so that the mean lies below the middle of the jitter.
    let mut arm = ArmModel::at_rest(settings, [0.0; JOINTS]);
    let ages: Vec<f64> = (0..3000).map(|_| (arm.cycle([0.0; JOINTS]), arm.delay_s()).1).collect();
    let mean_s = ages.iter().sum::<f64>() / ages.len() as f64;
    let jittery = found(settings, 0.0);
    assert!((jittery.shift.delay_s - mean_s - 0.002).abs() < 0.5e-3, "{mean_s} {:?}", jittery.shift);
}

#[test]
fn standstill_is_refused_and_reported() {
    let settings = ArmSettings::ur5(0.002, 0.03);
    let (commands, states) = recorded(settings, 5.0, 1e-4);
    let still = |samples: &[Sample]| -> Vec<Sample> {
        samples.iter().map(|sample| Sample { q: [0.3; JOINTS], ..*sample }).collect()
    };
    let refused = identify(&still(&commands), &states).unwrap_err();
    assert!(matches!(refused, LagError::NotCommanded { largest_rad } if largest_rad == 0.0), "{refused}");
    assert!(refused.to_string().contains("0.00 mrad") && refused.to_string().contains("armed"), "{refused}");
    let noisy: Vec<Sample> = recorded(settings, 5.0, 1e-4)
        .1
        .iter()
        .zip(&states)
        .map(|(a, b)| Sample { q: std::array::from_fn(|j| 0.3 + 0.5 * (a.q[j] - b.q[j])), ..*a })
        .collect();
    for stuck in [still(&states), noisy] {
        let refused = identify(&commands, &stuck).unwrap_err();
        assert!(
            matches!(refused, LagError::NotMoved { measured_rad, .. } if measured_rad < 1e-3),
            "{refused}"
        );
        assert!(refused.to_string().contains("brakes"), "{refused}");
    }
}

#[test]
fn an_arm_that_does_something_else_is_refused() {
    let (commands, states) = recorded(ArmSettings::ur5(0.002, 0.03), 5.0, 0.0);
    let other: Vec<Sample> = states
        .iter()
        .map(|s| Sample { q: std::array::from_fn(|j| 0.02 * (2.3 * s.t_s + j as f64).sin()), ..*s })
        .collect();
    let refused = identify(&commands, &other).unwrap_err();
    assert!(matches!(refused, LagError::NotFollowed { .. }), "{refused}");
}

#[test]
fn holes_and_too_little_are_refused_and_disorder_is_left_out() {
    let settings = ArmSettings::ur5(0.002, 0.03);
    let (commands, states) = recorded(settings, 5.0, 0.0);
    let hole = |samples: &[Sample]| {
        let mut kept = samples.to_vec();
        kept.retain(|s| !(2.0..2.2).contains(&s.t_s));
        kept
    };
    assert!(matches!(identify(&hole(&commands), &states), Err(LagError::Gap { what: "commands", .. })));
    assert!(matches!(identify(&commands, &hole(&states)), Err(LagError::Gap { what: "joint states", .. })));
    assert!(matches!(identify(&commands[..10], &states), Err(LagError::TooFew { .. })));
    assert!(matches!(identify(&commands, &[]), Err(LagError::TooFew { .. })));
    let mut messy = states.clone();
    messy.insert(1000, states[10]);
    messy.insert(500, Sample { q: [f64::NAN; JOINTS], ..states[500] });
    messy.insert(200, Sample { t_s: f64::NAN, ..states[3] });
    let found = identify(&commands, &messy).unwrap();
    assert!((found.servo.lag_s() - 0.034).abs() < 0.5e-3);
}
