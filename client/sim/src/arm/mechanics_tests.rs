//! Claims about arms that are not ideal, against closed forms; and that ideal ones keep their bits.

use std::f64::consts::{PI, TAU};

use super::*;

/// A servo alone, without limits.
fn servo(cycle_s: f64, look_ahead_s: f64, damping: f64) -> ArmSettings {
    ArmSettings { look_ahead_s, damping, ..ArmSettings::delayed(cycle_s, cycle_s) }
}

/// A joint loop of 2 ms alone, with `mechanics`.
fn with(mechanics: Mechanics) -> ArmModel {
    let settings = ArmSettings { joint_loop_s: 0.002, mechanics, ..ArmSettings::delayed(0.001, 0.001) };
    ArmModel::at_rest(settings, [0.0; JOINTS])
}

#[test]
fn a_step_overshoots_by_what_the_damping_ratio_says() {
    for damping in [0.3, 0.45, 0.5, 0.52, 0.6, 0.7, 0.9] {
        let mut arm = ArmModel::at_rest(servo(0.001, 0.03, damping), [0.0; JOINTS]);
        let highest = (0..6000).map(|_| arm.cycle([0.01; JOINTS]).q[0]).fold(0.0, f64::max);
        let closed = (-PI * damping / f64::sqrt(1.0 - damping * damping)).exp();
        assert!((highest / 0.01 - 1.0 - closed).abs() < 2e-3, "{damping}: {highest}, {closed}");
        assert!((arm.joints().q[0] - 0.01).abs() < 1e-9);
    }
    for damping in [1.0, 1.5, 4.0] {
        let mut arm = ArmModel::at_rest(servo(0.001, 0.03, damping), [0.0; JOINTS]);
        let highest = (0..20_000).map(|_| arm.cycle([0.01; JOINTS]).q[0]).fold(0.0, f64::max);
        assert!(highest <= 0.01 + 1e-12, "{damping}: {highest}");
    }
}

#[test]
fn a_ramp_lags_by_the_look_ahead_at_every_damping_ratio() {
    for damping in [0.3, 0.5, 0.9, 1.0, 1.1, 3.0] {
        for look_ahead_s in [0.008, 0.030, 0.100] {
            let mut arm = ArmModel::at_rest(servo(0.002, look_ahead_s, damping), [0.0; JOINTS]);
            let mut last = Joints::default();
            for k in 0..15_000 {
                last = arm.cycle([0.5 * f64::from(k) * 0.002; JOINTS]);
            }
            // A cycle of delay beside 2ζ/w.
            let lag = (0.5 * 30.0 - last.q[0]) / 0.5;
            assert!((lag - 0.002 - look_ahead_s).abs() < 1e-9, "{damping} {look_ahead_s}: {lag}");
        }
    }
}

#[test]
fn the_discretisation_is_exact_at_every_damping_ratio() {
    // The same straight lines, sampled every 2 and every 8 ms, lead the servo along the same way.
    for damping in [0.2, 0.5, 1.0, 1.0 + 1e-9, 1.7, 12.0] {
        let mut arms =
            [0.002, 0.008].map(|cycle_s| ArmModel::at_rest(servo(cycle_s, 0.03, damping), [0.0; JOINTS]));
        let path = |t_s: f64| if t_s < 0.2 { t_s } else { 0.4 - t_s };
        for coarse in 0..100 {
            arms[1].cycle([path(f64::from(coarse) * 0.008); JOINTS]);
            for fine in (4 * coarse - 3..=4 * coarse).filter(|fine| *fine >= 0) {
                arms[0].cycle([path(f64::from(fine) * 0.002); JOINTS]);
            }
            let [fast, slow] = arms.each_ref().map(ArmModel::servo);
            assert!((slow.q[0] - fast.q[0]).abs() < 1e-12, "{damping}: {slow:?} {fast:?}");
            assert!((slow.qd[0] - fast.qd[0]).abs() < 1e-10, "{damping}: {slow:?} {fast:?}");
        }
    }
}

#[test]
fn a_joint_with_stiction_rests_until_its_setpoint_leads_by_the_threshold() {
    let stiction_rad = [0.02, 0.0, 0.0, 0.0, 0.0, 0.0];
    let mut arm = with(Mechanics { stiction_rad, ..Mechanics::default() });
    let (mut broke, mut rests) = (None, 0);
    for k in 0..20_000 {
        // 5 mrad/s: slower than a joint slips, so that it goes in steps.
        let target = 5e-6 * f64::from(k);
        let joints = arm.cycle([target; JOINTS]);
        assert!((joints.q[1] - target).abs() < 2e-5);
        if joints.qd[0] == 0.0 {
            rests += 1;
            assert!(target - joints.q[0] <= 0.02 + 2e-5, "{k}: {joints:?}");
        } else if broke.is_none() {
            broke = Some(target);
        }
    }
    assert!(broke.is_some_and(|lead| (0.02..0.02 + 2e-5).contains(&lead)), "{broke:?}");
    assert!((19_000..19_990).contains(&rests), "{rests}");
    assert_eq!(with(Mechanics { stiction_rad, ..Mechanics::default() }).cycle([0.019; JOINTS]).q[0], 0.0);
}

#[test]
fn a_joint_that_slips_stays_behind_by_its_coulomb_threshold_both_ways() {
    let off = Mechanics::default();
    let coulomb_rad = [0.01; JOINTS];
    let mut arm = with(Mechanics { stiction_rad: [0.03; JOINTS], coulomb_rad, ..off });
    let (mut t, mut behind) = (0.0, [0.0; 2]);
    for (way, behind) in [1.0, -1.0].into_iter().zip(&mut behind) {
        for _ in 0..1000 {
            t += way * 1e-3;
            let joints = arm.cycle([t; JOINTS]);
            *behind = t - joints.q[3];
        }
    }
    // 1 rad/s: the joint loop is 2 ms behind as well.
    assert!((behind[0] - 0.012).abs() < 1e-6 && (behind[1] + 0.012).abs() < 1e-6, "{behind:?}");
    // Less stiction than Coulomb friction makes no sense: the greater is taken.
    assert_eq!(with(Mechanics { coulomb_rad, ..off }).cycle([0.009; JOINTS]).q[0], 0.0);
}

#[test]
fn backlash_is_a_dead_band_of_its_width() {
    let mut arm = with(Mechanics { backlash_rad: [0.004; JOINTS], ..Mechanics::default() });
    let mut there = Vec::new();
    for target in [0.1, 0.098, 0.097, 0.1, 0.05] {
        for _ in 0..200 {
            arm.cycle([target; JOINTS]);
        }
        there.push(arm.joints().q[4]);
        assert!(arm.joints().qd[4].abs() < 1e-9);
    }
    let expected = [0.098, 0.098, 0.098, 0.098, 0.052];
    assert!(there.iter().zip(expected).all(|(is, to)| (is - to).abs() < 1e-9), "{there:?}");
}

#[test]
fn a_joint_with_a_gain_goes_its_share_of_the_way() {
    let mut gain = [1.0; JOINTS];
    gain[2] = 0.4;
    let settings = ArmSettings {
        mechanics: Mechanics { gain, ..Mechanics::default() },
        ..ArmSettings::ur5(0.002, 0.03)
    };
    let mut arm = ArmModel::at_rest(settings, [0.5; JOINTS]);
    for _ in 0..1000 {
        arm.cycle([0.7; JOINTS]);
    }
    assert!((arm.joints().q[2] - 0.58).abs() < 1e-9 && (arm.joints().q[1] - 0.7).abs() < 1e-9);
}

#[test]
fn reports_are_whole_encoder_steps_and_the_arm_itself_is_not() {
    let step = TAU / 8192.0;
    let mut arm = with(Mechanics { encoder_step_rad: [step; JOINTS], ..Mechanics::default() });
    for k in 0..500 {
        let q = arm.cycle([1e-3 * f64::from(k); JOINTS]).q[0];
        assert!((q / step - (q / step).round()).abs() < 1e-9);
        assert!((q - arm.really().q[0]).abs() <= 0.5 * step + 1e-12);
    }
    assert!((arm.really().q[0] - arm.joints().q[0]).abs() > 1e-6);
}

#[test]
fn sag_grows_with_the_gravity_torque_of_the_wrist_and_is_gone_upright() {
    let sagging = |lift: f64, elbow: f64| {
        let mechanics = Mechanics { sag_rad: 0.01, ..Mechanics::default() };
        let settings = ArmSettings { mechanics, ..ArmSettings::ur5(0.002, 0.03) };
        let q = [0.0, lift, elbow, 0.0, 0.0, 0.0];
        let really = ArmModel::at_rest(settings, q).joints().q;
        [really[1] - lift, really[2] - elbow, really[0], really[3]]
    };
    let [lift, elbow, base, wrist] = sagging(0.0, 0.0);
    assert!((lift - 0.01).abs() < 1e-12 && base == 0.0 && wrist == 0.0);
    assert!((elbow - 0.01 * 0.392_25 / (0.425 + 0.392_25)).abs() < 1e-12, "{elbow}");
    let [lift, elbow, ..] = sagging(-PI / 2.0, 0.0);
    assert!(lift.abs() < 1e-12 && elbow.abs() < 1e-12);
    // The forearm level behind an upright upper arm: what it weighs alone.
    let [lift, elbow, ..] = sagging(-PI / 2.0, PI / 2.0);
    assert!((lift - elbow).abs() < 1e-12 && (lift - 0.0048).abs() < 1e-4, "{lift}");
}

#[test]
fn with_all_of_it_off_the_arm_keeps_its_bits() {
    let plain = ArmSettings::ur5(0.002, 0.03);
    let off = ArmSettings { damping: 1.0, mechanics: Mechanics::default(), ..plain };
    let nonsense = Mechanics {
        stiction_rad: [f64::NAN; JOINTS],
        coulomb_rad: [-1.0; JOINTS],
        backlash_rad: [f64::NEG_INFINITY; JOINTS],
        gain: [f64::NAN; JOINTS],
        encoder_step_rad: [f64::NAN; JOINTS],
        sag_rad: f64::NAN,
    };
    let nonsense = ArmSettings { damping: f64::NAN, mechanics: nonsense, ..plain };
    let mut arms = [plain, off, nonsense].map(|settings| ArmModel::at_rest(settings, [0.1; JOINTS]));
    for k in 0..2000 {
        let t = f64::from(k) * 0.002;
        let step = if k > 900 { 1.0 } else { 0.0 };
        let target = 0.1 + 0.2 * (7.0 * t).sin() + step;
        let [first, second, third] = arms.each_mut().map(|arm| arm.cycle([target; JOINTS]));
        assert_eq!((first, first), (second, third), "{k}");
    }
}

#[test]
fn everything_at_once_stays_finite_and_inside_the_speed_limit() {
    let mechanics = Mechanics {
        stiction_rad: [0.01; JOINTS],
        coulomb_rad: [0.004; JOINTS],
        backlash_rad: [0.002; JOINTS],
        gain: [0.9; JOINTS],
        encoder_step_rad: [1e-4; JOINTS],
        sag_rad: 0.01,
    };
    let settings = ArmSettings { damping: 0.4, mechanics, ..ArmSettings::ur5(0.002, 0.03) };
    let mut arm = ArmModel::at_rest(settings, [0.0; JOINTS]);
    let before = arm.joints().q;
    arm.stand();
    assert_eq!(arm.joints().q, before, "a standstill moves nothing");
    for k in 0..5000 {
        let joints = arm.cycle([(9.0 * f64::from(k) * 0.002).sin(); JOINTS]);
        assert!(joints.q.iter().chain(&joints.qd).all(|x| x.is_finite() && x.abs() < 3.5), "{joints:?}");
    }
    arm.break_now(FaultKind::Stiction(1, 0.1));
    for _ in 0..100 {
        arm.cycle([0.0; JOINTS]);
    }
    arm.mend();
    for _ in 0..2000 {
        arm.cycle([0.0; JOINTS]);
    }
    // What is left: friction, half the backlash, and the sag.
    assert!(arm.joints().q[5].abs() < 0.011, "{:?}", arm.joints());
}
