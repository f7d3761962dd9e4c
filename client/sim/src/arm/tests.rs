//! Claims about the simulated arm: its lag, its smoothness, and its limits.

use super::*;
use std::f64::consts::TAU;

fn arm(rate_hz: f64) -> ArmModel {
    ArmModel::at_rest(ArmSettings::ur5(1.0 / rate_hz, 0.030), [0.0; JOINTS])
}

fn lag_of_sine(rate_hz: f64, look_ahead_s: f64, frequency_hz: f64) -> f64 {
    lag_of(ArmSettings::ur5(1.0 / rate_hz, look_ahead_s), frequency_hz)
}

/// Phase lag \[s\] of joint 0 behind 0.02 rad·sin(2πft), by correlation over whole periods after settling.
fn lag_of(settings: ArmSettings, frequency_hz: f64) -> f64 {
    let rate_hz = 1.0 / settings.cycle_s;
    let mut arm = ArmModel::at_rest(settings, [0.0; JOINTS]);
    let w = TAU * frequency_hz;
    let (settling, periods) = (2.0, 4.0);
    let cycles = ((settling + periods / frequency_hz) * rate_hz).round() as usize;
    let (mut in_phase, mut quadrature) = (0.0, 0.0);
    for k in 0..cycles {
        let t = k as f64 / rate_hz;
        let after = t + 1.0 / rate_hz;
        let q = arm.cycle([0.02 * (w * t).sin(); JOINTS]).q[0];
        if t >= settling {
            in_phase += q * (w * after).sin();
            quadrature += q * (w * after).cos();
        }
    }
    -quadrature.atan2(in_phase) / w
}

#[test]
fn arm_is_still_when_the_target_is_where_it_is() {
    let mut arm = ArmModel::at_rest(ArmSettings::ur5(0.002, 0.03), [0.3, -1.0, 1.2, 0.0, 2.0, -0.1]);
    for _ in 0..100 {
        let joints = arm.cycle([0.3, -1.0, 1.2, 0.0, 2.0, -0.1]);
        assert!(joints.qd.iter().all(|qd| qd.abs() < 1e-12));
    }
    assert!((arm.joints().q[2] - 1.2).abs() < 1e-12);
}

#[test]
fn target_moves_nothing_in_its_own_cycle() {
    // One cycle of delay: the step enters as a ramp over the cycle, of which the servo sees the first half
    // late.
    let mut arm = arm(500.0);
    let first = arm.cycle([0.01; JOINTS]).q[0];
    assert!(first < 0.01 * 0.01, "{first}");
}

#[test]
fn small_step_is_answered_without_overshoot_and_settles() {
    let mut arm = arm(500.0);
    let mut highest = 0.0_f64;
    for _ in 0..250 {
        highest = highest.max(arm.cycle([0.01; JOINTS]).q[0]);
    }
    assert!(highest <= 0.01 + 1e-12, "{highest}");
    assert!((arm.joints().q[0] - 0.01).abs() < 1e-9);
    assert!(arm.joints().qd[0].abs() < 1e-7);
}

#[test]
fn half_hertz_sine_lags_by_thirty_to_forty_milliseconds() {
    // Cycle 2 ms + look-ahead 30 ms + joint loop 2 ms = 34 ms at low frequency (measured on a UR10e: 34 ms).
    let lag = lag_of_sine(500.0, 0.030, 0.5);
    assert!((0.0335..0.0345).contains(&lag), "{lag}");
    // CB3: cycle 8 ms.
    let lag = lag_of_sine(125.0, 0.030, 0.5);
    assert!((0.039..0.041).contains(&lag), "{lag}");
}

#[test]
fn longer_look_ahead_lags_longer() {
    let lag = lag_of_sine(500.0, 0.1, 0.5);
    assert!((0.100..0.106).contains(&lag), "{lag}");
}

#[test]
fn clamps_hold_against_a_large_step_and_it_still_arrives_without_overshoot() {
    for rate in [500.0, 125.0] {
        let mut arm = arm(rate);
        let mut before = arm.joints();
        let mut highest = 0.0_f64;
        for _ in 0..(2.0 * rate) as usize {
            let now = arm.cycle([2.0; JOINTS]);
            assert!(now.qd[0].abs() <= 3.342 + 1e-9);
            assert!((now.qd[0] - before.qd[0]).abs() <= 40.0 / rate + 1e-9);
            assert!((now.q[0] - before.q[0]).abs() <= 3.342 / rate + 1e-9);
            highest = highest.max(now.q[0]);
            before = now;
        }
        assert!((before.q[0] - 2.0).abs() < 1e-3, "{}", before.q[0]);
        assert!(highest < 2.01, "{highest}");
    }
}

#[test]
fn ramp_is_followed_with_the_steady_lag() {
    let mut arm = arm(500.0);
    let (speed, mut last) = (0.5, Joints::default());
    for k in 0..1000 {
        last = arm.cycle([speed * k as f64 * 0.002; JOINTS]);
    }
    // `last` is the state at t = 2 s; the target would be 1.0 rad there.
    assert!((1.0 - last.q[0] - speed * 0.034).abs() < 1e-6, "{}", last.q[0]);
    assert!((last.qd[0] - speed).abs() < 1e-6);
}

#[test]
fn target_that_is_not_a_number_moves_nothing() {
    let mut arm = arm(500.0);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let joints = arm.cycle([bad; JOINTS]);
        assert_eq!(joints, Joints::default());
    }
}

#[test]
fn pure_delay_of_any_fraction_of_a_cycle_is_added_to_the_millisecond() {
    for rate in [500.0, 125.0] {
        for delay_s in [0.0, 0.0007, 0.010, 0.0333, 0.100, 0.150] {
            let settings =
                ArmSettings { delay: DelaySettings::constant(delay_s), ..ArmSettings::ur5(1.0 / rate, 0.0) };
            let lag = lag_of(settings, 0.5);
            assert!((lag - settings.group_delay_s()).abs() < 2e-5, "{rate} {delay_s}: {lag}");
            assert!((settings.group_delay_s() - (1.0 / rate + delay_s + 0.002)).abs() < 1e-12);
        }
    }
}

#[test]
fn arm_without_limits_and_filters_repeats_its_targets_exactly() {
    let settings = ArmSettings::delayed(0.002, 0.030);
    assert!((settings.group_delay_s() - 0.030).abs() < 1e-12);
    let target = |k: i32| [f64::from(k * k) * 1e-3; JOINTS];
    let mut arm = ArmModel::at_rest(settings, target(0));
    for k in 0..100 {
        let q = arm.cycle(target(k)).q[0];
        // After the cycle it is k + 1; 15 cycles before that the target was k - 14.
        assert!((q - target((k - 14).max(0))[0]).abs() < 1e-12, "{k}: {q}");
    }
    // A lag shorter than the arm's own cycle is the cycle.
    assert_eq!(ArmSettings::delayed(0.002, 0.0).group_delay_s(), 0.002);
}

#[test]
fn jitter_is_bounded_never_reads_backwards_and_repeats_with_its_seed() {
    let settings = |seed| ArmSettings {
        delay: DelaySettings { delay_s: 0.040, jitter_s: 0.015, seed, change: None },
        ..ArmSettings::delayed(0.002, 0.0)
    };
    let read = |seed| {
        let mut arm = ArmModel::at_rest(settings(seed), [0.0; JOINTS]);
        (0..2000).map(|k| (arm.cycle([f64::from(k); JOINTS]).q[0], arm.delay_s())).collect::<Vec<_>>()
    };
    let first = read(1);
    assert_eq!(first, read(1));
    assert_ne!(first, read(2));
    assert!(first.windows(2).all(|pair| pair[1].0 > pair[0].0 - 1e-9));
    let (low, high) =
        first.iter().fold((1.0_f64, 0.0_f64), |(low, high), (_, d)| (low.min(*d), high.max(*d)));
    assert!((0.025..0.0255).contains(&low) && high <= 0.055 + 1e-12 && high > 0.03, "{low} {high}");
}

#[test]
fn delay_changes_when_it_should_and_stays_in_order() {
    let change = |from: f64, to: f64| ArmSettings {
        delay: DelaySettings {
            delay_s: from,
            change: Some(DelayChange { at_s: 1.0, delay_s: to }),
            ..DelaySettings::default()
        },
        ..ArmSettings::delayed(0.002, 0.0)
    };
    for (from, to) in [(0.020, 0.100), (0.100, 0.020)] {
        let settings = change(from, to);
        assert!((settings.group_delay_at(0.9) - from - 0.002).abs() < 1e-12);
        assert!((settings.group_delay_at(1.1) - to - 0.002).abs() < 1e-12);
        let mut arm = ArmModel::at_rest(settings, [0.0; JOINTS]);
        let q: Vec<f64> = (0..1000).map(|k| arm.cycle([f64::from(k); JOINTS]).q[0]).collect();
        assert!(q.windows(2).all(|pair| pair[1] > pair[0] - 1e-9));
        assert!((q[499] - (499.0 - from / 0.002)).abs() < 1e-6, "{}", q[499]);
        assert!((q[999] - (999.0 - to / 0.002)).abs() < 1e-6, "{}", q[999]);
    }
}

#[test]
fn speed_scaling_lags_by_what_it_skips_and_slows_what_is_fast() {
    for (rate, scaling) in [(500.0, 0.5), (125.0, 0.25)] {
        let settings = ArmSettings { speed_scaling: scaling, ..ArmSettings::ur5(1.0 / rate, 0.030) };
        let lag = lag_of(settings, 0.25);
        assert!((lag - settings.group_delay_s()).abs() < 1e-3, "{rate} {scaling}: {lag}");
        assert!(settings.group_delay_s() > ArmSettings::ur5(1.0 / rate, 0.030).group_delay_s());
        let mut arm = ArmModel::at_rest(settings, [0.0; JOINTS]);
        let fastest = (0..2000).map(|_| arm.cycle([2.0; JOINTS]).qd[0]).fold(0.0, f64::max);
        assert!((fastest - 3.342 * scaling).abs() < 1e-6, "{fastest}");
        assert!((arm.joints().q[0] - 2.0).abs() < 1e-3);
    }
    let paused = ArmSettings { speed_scaling: 0.0, ..ArmSettings::delayed(0.002, 0.0) };
    let mut arm = ArmModel::at_rest(paused, [0.5; JOINTS]);
    assert_eq!(arm.cycle([1.0; JOINTS]), Joints { q: [0.5; JOINTS], qd: [0.0; JOINTS] });
}

#[test]
fn without_a_servo_clamps_hold_against_a_large_step_and_it_still_arrives() {
    for rate in [500.0, 125.0] {
        for delay_s in [0.0, 0.0501] {
            let delay = DelaySettings::constant(delay_s);
            let settings = ArmSettings { delay, ..ArmSettings::ur5(1.0 / rate, 0.0) };
            let mut arm = ArmModel::at_rest(settings, [0.0; JOINTS]);
            let (mut before, mut highest) = (arm.joints(), 0.0_f64);
            for _ in 0..(2.0 * rate) as usize {
                let now = arm.cycle([2.0; JOINTS]);
                assert!(now.qd[0].abs() <= 3.342 + 1e-9);
                assert!((now.qd[0] - before.qd[0]).abs() <= 40.0 / rate + 1e-9);
                highest = highest.max(now.q[0]);
                before = now;
            }
            assert!((before.q[0] - 2.0).abs() < 1e-3 && highest < 2.01, "{rate}: {} {highest}", before.q[0]);
        }
    }
}

#[test]
fn numbers_that_make_no_sense_do_no_harm() {
    let wild = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 1e300];
    for wrong in wild {
        let settings = ArmSettings {
            delay: DelaySettings {
                delay_s: wrong,
                jitter_s: wrong,
                seed: 0,
                change: Some(DelayChange { at_s: wrong, delay_s: wrong }),
            },
            speed_scaling: wrong,
            ..ArmSettings::ur5(0.002, 0.03)
        };
        let mut arm = ArmModel::at_rest(settings, [0.0; JOINTS]);
        for _ in 0..1000 {
            let joints = arm.cycle([0.01; JOINTS]);
            assert!(joints.q.iter().all(|q| (0.0..0.011).contains(q)), "{wrong}: {joints:?}");
        }
    }
}

#[test]
fn arm_without_the_new_options_moves_as_it_always_did() {
    // Reference values of the model without delay, jitter and speed scaling.
    let mut arm = ArmModel::at_rest(ArmSettings::ur5(0.002, 0.03), [0.1; JOINTS]);
    let mut last = arm.joints();
    for k in 0..700 {
        let t = f64::from(k) * 0.002;
        let step = if k > 500 { 1.0 } else { 0.0 };
        last = arm.cycle([0.1 + 0.2 * (7.0 * t).sin() + step; JOINTS]);
    }
    // To the bit where it was computed; another machine's exp and sin may differ in the last digit.
    assert!((last.q[0] - 1.082_197_312_540_724_3).abs() < 1e-13, "{:?}", last.q[0]);
    assert!((last.qd[0] + 1.722_462_886_106_289_4).abs() < 1e-12, "{:?}", last.qd[0]);
}

/// Joint 0 is led at 1 rad/s for `cycles` from where `target` is, the scaling asked for again in each, as a
/// controller does.
fn lead(arm: &mut ArmModel, target: &mut f64, cycles: u32) -> f64 {
    for _ in 0..cycles {
        *target += 0.002;
        arm.set_speed_scaling(1.0);
        arm.cycle([*target; JOINTS]);
    }
    arm.joints().qd[0]
}

#[test]
fn a_slider_at_full_speed_takes_nothing_back_from_an_arm_that_is_slow_or_paused() {
    for (kind, most) in [(FaultKind::Slow(0.1), 0.3342), (FaultKind::Paused, 0.0)] {
        let (mut arm, mut target) = (arm(500.0), 0.0);
        assert!((lead(&mut arm, &mut target, 300) - 1.0).abs() < 1e-3);
        arm.break_now(kind);
        let speed = lead(&mut arm, &mut target, 100);
        assert!(speed <= most + 1e-3, "{kind:?}: {speed}");
        let behind = target - arm.joints().q[0];
        assert!(behind > 0.1, "{kind:?}: {behind}");
        arm.mend();
        assert!(lead(&mut arm, &mut target, 500) > 0.9, "{kind:?}");
    }
}

#[test]
fn a_mended_arm_goes_on_from_where_it_really_is_inside_its_limits() {
    for kind in [FaultKind::Stuck, FaultKind::Locked(0), FaultKind::Flipped(0), FaultKind::Runaway(-1.0)] {
        let (mut arm, mut target) = (arm(500.0), 0.0);
        lead(&mut arm, &mut target, 300);
        arm.break_now(kind);
        lead(&mut arm, &mut target, 100);
        let before = arm.really();
        arm.mend();
        assert_eq!(arm.joints(), before, "{kind:?}");
        for _ in 0..2000 {
            let (before, after) = (arm.joints(), arm.cycle([target; JOINTS]));
            assert!((after.qd[0] - before.qd[0]).abs() <= 40.0 * 0.002 + 1e-9, "{kind:?}");
        }
        assert!((arm.joints().q[0] - target).abs() < 1e-6, "{kind:?}: {:?}", arm.joints());
    }
}

#[test]
fn a_fault_replaces_the_one_before_and_outlasts_a_standstill() {
    let (mut arm, mut target) = (arm(500.0), 0.0);
    arm.break_now(FaultKind::Slow(0.5));
    lead(&mut arm, &mut target, 300);
    arm.break_now(FaultKind::Stuck);
    lead(&mut arm, &mut target, 10);
    let stuck = arm.joints().q;
    arm.stand();
    lead(&mut arm, &mut target, 3000);
    assert_eq!(arm.joints(), Joints { q: stuck, qd: [0.0; JOINTS] });
}
