//! Claims about inverse kinematics: every reachable pose is found, the nearest of all postures is chosen, at
//! singularities too.

use super::*;
use crate::kinematics::{calibrated, nominal};
use crate::options::{ControllerOptions, Series};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

const ANGLES: std::ops::Range<f64> = -PI..PI;

/// The largest error in each of six numbers.
fn worst(dh: &ArmDh, tcp: &[f64; 6], wanted: &[f64; 6], q: &[f64; 6]) -> f64 {
    off(dh, tcp, wanted, q).amax()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn joints_lead_to_the_pose_they_were_asked_for(
        q in prop::array::uniform6(ANGLES),
        near in prop::array::uniform6(-2.0 * PI..2.0 * PI),
        tcp in prop::array::uniform6(-0.3f64..0.3),
        e_series in any::<bool>(),
    ) {
        let dh = nominal(if e_series { Series::E } else { Series::Cb3 });
        let wanted = pose(&(dh.flange(&q) * frame(&tcp)));
        let found = joints_for(&dh, &tcp, &wanted, &near);
        prop_assert!(found.is_some());
        let found = found.unwrap();
        prop_assert!(worst(&dh, &tcp, &wanted, &found) < 2e-9);
        prop_assert!(found.iter().all(|q| q.abs() <= POSITION_LIMIT_RAD));
    }

    #[test]
    fn the_posture_asked_near_is_the_posture_found(
        q in prop::array::uniform6(ANGLES),
        bends in prop::array::uniform2(0.2f64..2.9),
        sides in any::<[bool; 2]>(),
        by in prop::array::uniform6(-0.02f64..0.02),
    ) {
        let mut q = q;
        // Elbow and wrist bent, to either side.
        for ((joint, bend), side) in [2, 4].into_iter().zip(bends).zip(sides) {
            q[joint] = if side { bend } else { -bend };
        }
        let dh = nominal(Series::E);
        // Near a singularity two postures are near, and either may be the nearer one.
        let reach = dh.flange(&q).translation.vector.xy().norm();
        prop_assume!(reach > 0.3);
        let mut near = q;
        near.iter_mut().zip(by).for_each(|(near, by)| *near += by);
        let found = joints_for(&dh, &[0.0; 6], &pose(&dh.flange(&q)), &near).unwrap();
        for (found, q) in found.iter().zip(q) {
            prop_assert!((found - q).abs() < 1e-6, "{found:?} {q:?}");
        }
    }

    #[test]
    fn an_arm_with_a_calibration_reaches_its_own_poses(
        q in prop::array::uniform6(ANGLES),
        millimetres in 0.5f64..8.0,
        seed in 0u64..1000,
        e_series in any::<bool>(),
    ) {
        let series = if e_series { Series::E } else { Series::Cb3 };
        let home = ControllerOptions::new(series).q;
        let dh = calibrated(series, millimetres * 1e-3, seed, &home);
        let wanted = pose(&dh.flange(&q));
        let found = joints_for(&dh, &[0.0; 6], &wanted, &home);
        prop_assert!(found.is_some());
        prop_assert!(worst(&dh, &[0.0; 6], &wanted, &found.unwrap()) < 2e-9);
    }

    #[test]
    fn nothing_that_is_asked_for_panics(
        wanted in prop::array::uniform6(any::<f64>()),
        near in prop::array::uniform6(any::<f64>()),
    ) {
        let dh = nominal(Series::E);
        if let Some(q) = joints_for(&dh, &[0.0; 6], &wanted, &near) {
            prop_assert!(worst(&dh, &[0.0; 6], &wanted, &q) < 2e-9);
        }
    }
}

/// Postures at and near all kinds of singularity.
fn singular() -> Vec<[f64; 6]> {
    let mut found = Vec::new();
    for near in [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3, -1e-8, -1e-4] {
        // Wrist, elbow stretched and folded nearly, both.
        found.extend([
            [0.3, -1.2, 1.4, -0.7, near, 0.9],
            [0.3, -1.2, 1.4, -0.7, PI + near, 0.9],
            [-0.8, -1.0, near, 0.4, 1.1, -2.0],
            [-0.8, -1.0, 2.6 + near, 0.4, -1.1, 2.0],
            [1.7, -0.4, near, 0.2, near, 0.1],
            // Straight up, and as the arm is at zero.
            [near, -FRAC_PI_2, near, -FRAC_PI_2, near, near],
            [near; 6],
        ]);
    }
    found
}

#[test]
fn poses_at_and_near_singularities_are_found() {
    for series in [Series::Cb3, Series::E] {
        let dh = nominal(series);
        for q in singular() {
            let wanted = pose(&dh.flange(&q));
            for near in [q, [0.0; 6], ControllerOptions::new(series).q] {
                let found = joints_for(&dh, &[0.0; 6], &wanted, &near);
                let found = found.unwrap_or_else(|| panic!("{series:?} {q:?} from {near:?}"));
                assert!(worst(&dh, &[0.0; 6], &wanted, &found) < 2e-9, "{q:?} {found:?}");
            }
        }
    }
}

/// With the flange's centre above the shoulder's axis, the wrist touches the cylinder that it cannot enter.
#[test]
fn a_pose_with_the_wrist_at_the_shoulders_cylinder_is_found() {
    for series in [Series::Cb3, Series::E] {
        let dh = nominal(series);
        // Folded up so that the third link ends above the base: found by bisection over q2.
        let reach = |q2: f64| {
            let q = [0.4, q2, 2.0, 0.3, 0.7, 0.2];
            let elbow = [q2, q2 + 2.0];
            let along = dh.a[1] * elbow[0].cos() + dh.a[2] * elbow[1].cos();
            (along + dh.d[4] * (q2 + 2.0 + 0.3).sin(), q)
        };
        let (mut low, mut high) = (-3.0, 0.0);
        assert!(reach(low).0 * reach(high).0 < 0.0);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if reach(low).0 * reach(middle).0 <= 0.0 { high = middle } else { low = middle }
        }
        let (_, q) = reach(low);
        let wanted = pose(&dh.flange(&q));
        let found = joints_for(&dh, &[0.0; 6], &wanted, &q).unwrap();
        assert!(worst(&dh, &[0.0; 6], &wanted, &found) < 2e-9);
    }
}

/// All postures of one pose, each asked for by asking near it.
#[test]
fn a_pose_amid_the_workspace_has_eight_postures_and_each_is_found() {
    for series in [Series::Cb3, Series::E] {
        let dh = nominal(series);
        let q = [0.5, -1.2, 1.5, -1.0, 1.2, 0.3];
        let all = postures(&dh, &dh.flange(&q), &q);
        assert_eq!(all.len(), 8);
        let wanted = pose(&dh.flange(&q));
        let mut different: Vec<[f64; 6]> = Vec::new();
        for posture in all {
            let near = turned_near(posture, &[0.0; 6]).unwrap().0;
            let found = joints_for(&dh, &[0.0; 6], &wanted, &near).unwrap();
            assert!(worst(&dh, &[0.0; 6], &wanted, &found) < 1e-9);
            assert!(found.iter().zip(near).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?} {near:?}");
            let same = |other: &[f64; 6]| other.iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-3);
            assert!(!different.iter().any(same));
            different.push(found);
        }
    }
}

#[test]
fn joints_turn_as_near_as_their_range_lets_them() {
    let dh = nominal(Series::E);
    let q = [3.0, -1.2, 1.5, -1.0, 1.2, 0.3];
    let wanted = pose(&dh.flange(&q));
    for (near, expected) in [(6.0, 3.0), (-6.0, 3.0 - TAU), (-3.0, 3.0 - TAU), (0.1, 3.0), (-0.2, 3.0 - TAU)]
    {
        let mut from = q;
        from[0] = near;
        let found = joints_for(&dh, &[0.0; 6], &wanted, &from).unwrap();
        assert!((found[0] - expected).abs() < 1e-9, "{near}: {found:?}");
    }
}

#[test]
fn what_is_out_of_reach_is_not_found_unless_it_is_near_enough() {
    let (dh, near) = (nominal(Series::Cb3), ControllerOptions::new(Series::Cb3).q);
    for wanted in [[2.0, 0.0, 0.3, 0.0, 3.1, 0.0], [f64::NAN; 6], [1e300; 6]] {
        assert_eq!(joints_for(&dh, &[0.0; 6], &wanted, &near), None);
    }
    // A millimetre beyond a stretched arm.
    let stretched = [0.0, 0.0, 0.0, 0.0, -FRAC_PI_2, 0.0];
    let mut wanted = pose(&dh.flange(&stretched));
    wanted[0] -= 1e-3;
    assert_eq!(joints_for(&dh, &[0.0; 6], &wanted, &stretched), None);
    let wide = PoseTolerance::new(2e-3, 1e-6);
    let found = search(&dh, &[0.0; 6], &wanted, &stretched, wide, &mut 0).unwrap();
    assert!(off(&dh, &[0.0; 6], &wanted, &found).fixed_rows::<3>(0).norm() <= 2e-3);
}

#[test]
fn a_straight_way_is_straight() {
    let (dh, q) = (nominal(Series::E), ControllerOptions::new(Series::E).q);
    let mut to = pose(&dh.flange(&q));
    to[0] -= 0.05;
    to[2] += 0.1;
    let way = Straight::new(dh, [0.0; 6], &q, &to);
    assert!((way.length() - 0.125f64.sqrt() * 0.1f64.sqrt()).abs() < 1e-9, "{}", way.length());
    let half = way.joints(0.5, &q).unwrap();
    let moved = dh.flange(&half).translation.vector - dh.flange(&q).translation.vector;
    assert!((moved - nalgebra::Vector3::new(-0.025, 0.0, 0.05)).norm() < 1e-7, "{moved}");
}
