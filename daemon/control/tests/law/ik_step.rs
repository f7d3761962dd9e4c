//! The inverse kinematics in motion: home poses, lines, letters, singularities.

use crate::support::reaching;

use reaching::*;

use foretrace_control::ik::{Ik, IkSettings, IkSource, ToolTarget, task};
use nalgebra::{SVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::PI;

#[test]
fn home_poses_stand_over_the_writing_plane() {
    for (text, home, expected) in [
        (UR5, UR5_HOME, Vector3::new(-0.45, -0.10915, 0.2)),
        (UR5E, UR5E_HOME, Vector3::new(-0.45, -0.1333, 0.2)),
    ] {
        let k = chain(text).forward(&home);
        assert!((k.position - expected).norm() < 1e-5, "{}", k.position);
        assert!((k.rotation.column(2) + Vector3::z()).norm() < 1e-4);
        assert!((k.rotation.column(0) - Vector3::y()).norm() < 1e-4);
    }
}

/// A line of 20 cm in 2 s with smooth ends, then back: the tool is where it should be at every tick.
#[test]
fn a_line_in_the_workspace_is_tracked_to_a_micrometre() {
    for (text, home) in [(UR5, UR5_HOME), (UR5E, UR5E_HOME)] {
        let chain = chain(text);
        let start = chain.forward(&home).position;
        let path = |t: f64| start + Vector3::new(0.06, 0.08, -0.02) * (1.0 - (PI * t / 2.0).cos());
        let mut arm = Arm::new(&chain, home, 20.0);
        for tick in 0..2000 {
            let t = f64::from(tick) * TICK_S;
            let report = arm.tick(&along(path, t));
            let (position, axis) = arm.tool();
            let error = (position - path(t + TICK_S)).norm();
            assert!(error < 1e-6, "{error} m at {t} s");
            assert!((axis + Vector3::z()).norm() < 1e-4, "{axis}");
            assert_eq!((report.source, report.active.count()), (IkSource::Optimum, 0));
            assert!(report.velocity_error.norm() < 1e-6 && report.kkt_residual <= 1e-9, "{report:?}");
        }
    }
}

/// Letters of 30 mm with peaks of 10 m/s² and 0.45 m/s: within 40 rad/s² nothing is altered.
#[test]
fn handwriting_peaks_fit_into_the_arms_acceleration() {
    for (text, home) in [(UR5, UR5_HOME), (UR5E, UR5E_HOME)] {
        let chain = chain(text);
        let start = chain.forward(&home).position;
        let omega = (10.0f64 / 0.015).sqrt();
        // Eased in over half a second: a circle of radius 15 mm has 10 m/s² all the time.
        let path = |t: f64| {
            let ease = (t / 0.5).min(1.0);
            let r = 0.015 * ease * ease * ease * (10.0 - 15.0 * ease + 6.0 * ease * ease);
            start + Vector3::new((omega * t).cos(), (omega * t).sin(), 0.0) * r
        };
        let mut arm = Arm::new(&chain, home, 40.0);
        let mut peak: f64 = 0.0;
        for tick in 0..1500 {
            let t = f64::from(tick) * TICK_S;
            let report = arm.tick(&along(path, t));
            assert_eq!(report.active.count(), 0);
            assert!((arm.tool().0 - path(t + TICK_S)).norm() < 5e-6);
            peak = arm.last.qdd().iter().fold(peak, |p, a| p.max(a.abs()));
        }
        assert!(peak > 20.0 && peak < 35.0, "{peak} rad/s²");
    }
}

/// Circles that the joints cannot follow: the error lies in the plane, and the report states its size.
#[test]
fn what_joints_cannot_do_is_missed_in_the_plane_rather_than_off_it() {
    let chain = chain(UR5);
    let start = chain.forward(&UR5_HOME).position;
    let omega = (10.0f64 / 0.015).sqrt();
    let path = |t: f64| start + Vector3::new((omega * t).cos() - 1.0, (omega * t).sin(), 0.0) * 0.015;
    let missed = |weight: f64| {
        let mut arm = Arm::new(&chain, UR5_HOME, 20.0);
        let settings = IkSettings { normal_weight: weight, ..*arm.ik.settings() };
        arm.ik = Ik::new(*arm.ik.limits(), settings);
        let unweighted = IkSettings { normal_weight: 1.0, tilt_weight: 1.0, ..settings };
        let (mut off, mut along_it, mut tilt, mut told) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
        for tick in 0..500 {
            let t = f64::from(tick) * TICK_S;
            let target = along(path, t);
            let before = arm.last;
            let (q, kinematics) = (before.q(), chain.forward(before.q()));
            let task = task::assemble(&kinematics, q, before.qd(), &target, &unweighted, TICK_S);
            let report = arm.tick(&target);
            // Weights decide where the error lies, not its units in the report: metres and radians per
            // second.
            let missed = task.wanted - task.rows * SVector::from(*arm.last.qd());
            let tilt_missed = missed.fixed_rows::<2>(3).norm() / settings.orientation_m;
            assert!((report.velocity_error - missed.fixed_rows::<3>(0)).norm() < 1e-9, "{report:?} {missed}");
            assert!((report.tilt_error - tilt_missed).abs() < 1e-9, "{report:?} {missed}");
            told = told.max(report.velocity_error.norm().min(report.tilt_error));
            let (position, axis) = arm.tool();
            tilt = tilt.max(axis.cross(&Vector3::z()).norm());
            let error = position - path(t + TICK_S);
            (off, along_it) = (off.max(error.z.abs()), along_it.max(error.xy().norm()));
        }
        println!(
            "weight {weight}: off the plane {:.2} mm, in it {:.2} mm, tilted {tilt:.3} rad",
            off * 1e3,
            along_it * 1e3
        );
        assert!(tilt < 0.2, "tilted by {tilt} rad");
        assert!(told > 0.02, "too little was missed at once: {told} m/s and rad/s");
        (off, along_it)
    };
    let ((alike, _), (kept, along_it)) = (missed(1.0), missed(10.0));
    assert!(along_it > 2e-3, "the joints could do it: {along_it} m");
    assert!(kept < 0.3 * alike && kept < 1e-3, "{kept} m off the plane, {alike} m without the weight");
}

/// The rotation about the tool axis is free, yet does not drift while writing.
#[test]
fn the_wrist_does_not_drift_over_many_letters() {
    let chain = chain(UR5);
    let start = chain.forward(&UR5_HOME).position;
    let path = |t: f64| start + Vector3::new((7.0 * t).sin(), 1.0 - (5.0 * t).cos(), 0.0) * 0.03;
    let mut arm = Arm::new(&chain, UR5_HOME, 20.0);
    for tick in 0..30_000 {
        arm.tick(&along(path, f64::from(tick) * TICK_S));
    }
    assert!((arm.last.q()[5] - UR5_HOME[5]).abs() < 0.2, "{:?}", arm.last.q());
}

#[test]
fn a_tilted_and_spun_tool_is_turned_upright() {
    let chain = chain(UR5);
    let mut q = UR5_HOME;
    (q[3], q[4], q[5]) = (q[3] + 0.4, q[4] - 0.3, 1.2);
    let position = chain.forward(&q).position;
    let mut arm = Arm::new(&chain, q, 20.0);
    let target = ToolTarget::at_rest(position, -Vector3::z(), Some(Vector3::y()));
    for _ in 0..3000 {
        arm.tick(&target);
    }
    let k = chain.forward(arm.last.q());
    assert!((k.position - position).norm() < 1e-9);
    assert!((k.rotation.column(2) + Vector3::z()).norm() < 1e-9);
    assert!((k.rotation.column(0) - Vector3::y()).norm() < 1e-6);
    assert!(arm.last.qd().iter().all(|v| v.abs() < 1e-9));
}

/// A distant target is approached by a braking profile: no overshoot in spite of weak joints.
#[test]
fn a_jump_of_the_target_is_approached_without_overshoot() {
    let chain = chain(UR5);
    let start = chain.forward(&UR5_HOME).position;
    let goal = start + Vector3::new(0.1, 0.05, 0.0);
    let mut arm = Arm::new(&chain, UR5_HOME, 10.0);
    let target = ToolTarget::at_rest(goal, -Vector3::z(), None);
    let mut altered = 0;
    for _ in 0..2000 {
        altered += u32::from(arm.tick(&target).velocity_error.norm() > 1e-3);
        let progress = (arm.tool().0 - start).dot(&(goal - start)) / (goal - start).norm_squared();
        assert!(progress < 1.001, "{progress}");
    }
    assert!((arm.tool().0 - goal).norm() < 1e-8);
    assert!(altered > 0, "the acceleration limit must have shown in the report");
}

/// Straight through the wrist singularity (q5 = 0), and into full stretch: finite, continuous, inside the
/// box.
#[test]
fn singularities_are_passed_without_stop_jump_or_nan() {
    let chain = chain(UR5);
    for (mut q, direction, tilt) in [
        (UR5_HOME, Vector3::new(0.0, 0.15, 0.0), 1.2),
        (UR5_HOME, Vector3::new(-0.6, 0.0, 0.1), 0.0),
        (UR5_HOME, Vector3::new(0.45, 0.1, 0.0), 0.0),
    ] {
        if tilt > 0.0 {
            // Wrist 2 starts beyond zero, and the wanted axis leads it across.
            q[4] = 0.3;
        }
        let k = chain.forward(&q);
        let (start, axis) = (k.position, k.rotation.column(2).into_owned());
        let turn = chain
            .forward(&{
                let mut q = q;
                q[4] -= tilt;
                q
            })
            .rotation
            .column(2)
            .into_owned();
        let mut arm = Arm::new(&chain, q, 20.0);
        let (mut nearest, mut damped, mut moved) = (f64::INFINITY, 0.0f64, 0.0);
        for tick in 0..3000 {
            let t = f64::from(tick) * TICK_S / 6.0;
            let path = |t: f64| start + direction * (0.5 - 0.5 * (PI * (t / 6.0).min(1.0)).cos());
            let mut target = along(path, t * 6.0);
            target.axis = axis.lerp(&turn, t).normalize();
            let before = arm.last;
            let report = arm.tick(&target);
            assert!(arm.last.motion().is_finite());
            assert_eq!(report.source, IkSource::Optimum);
            for i in 0..6 {
                assert!((arm.last.qd()[i] - before.qd()[i]).abs() <= 20.0 * TICK_S + 1e-9);
            }
            nearest = report.singularity.min(nearest);
            damped = report.damping.max(damped);
            moved = arm.last.qd().iter().fold(moved, |m: f64, v| m.max(v.abs()));
        }
        assert!(nearest < 0.01 && damped > 1e-4, "never came near: {nearest} {damped}");
        assert!(moved > 0.01);
    }
}

#[test]
fn damping_is_a_smooth_function_of_the_joints() {
    let chain = chain(UR5);
    let settings = IkSettings::for_period(TICK_S, UR5_HOME);
    let damping = |q4: f64| {
        let mut q = UR5_HOME;
        q[4] = q4;
        let target = ToolTarget::at_rest(Vector3::zeros(), -Vector3::z(), None);
        task::assemble(&chain.forward(&q), &q, &[0.0; 6], &target, &settings, TICK_S).damping
    };
    let mut last = damping(-1.0);
    for k in -9_999..10_000 {
        let next = damping(f64::from(k) * 1e-4);
        // Peak 1e-3 over a range of about 0.1 rad: 1e-4 rad change it by 1e-6 at the usual slope.
        assert!((next - last).abs() < 5e-6, "{} at {k}", next - last);
        last = next;
    }
    assert!(damping(0.0) > 0.9 * settings.damping_peak_m2 && damping(-1.0) == settings.damping_floor_m2);
}

#[test]
fn singularity_lies_between_its_bounds() {
    let chain = chain(UR5E);
    let mut rng = Pcg64::seed_from_u64(1);
    // The distance is that of the arm, whatever errors weigh.
    let settings =
        IkSettings { normal_weight: 1.0, tilt_weight: 1.0, ..IkSettings::for_period(TICK_S, UR5_HOME) };
    for _ in 0..5_000 {
        let q: [f64; 6] = std::array::from_fn(|_| rng.random_range(-PI..PI));
        let target = ToolTarget::at_rest(Vector3::zeros(), -Vector3::z(), None);
        let task = task::assemble(&chain.forward(&q), &q, &[0.0; 6], &target, &settings, TICK_S);
        let smallest = task.rows.fixed_rows::<5>(0).into_owned().singular_values().min();
        let floor = settings.damping_floor_m2.sqrt();
        let weighted = IkSettings { normal_weight: 10.0, tilt_weight: 0.2, ..settings };
        let same = task::assemble(&chain.forward(&q), &q, &[0.0; 6], &target, &weighted, TICK_S);
        assert_eq!(task.singularity, same.singularity);
        assert!(task.singularity <= smallest + floor && task.singularity >= (smallest - floor) / 5f64.sqrt());
    }
}
