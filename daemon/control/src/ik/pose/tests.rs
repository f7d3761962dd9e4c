//! Poses near singularities, far ones, and those out of reach.

use super::*;
use nalgebra::{Rotation3, Unit};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use std::f64::consts::{FRAC_PI_2, PI};

const UR5: &str = include_str!("../../../../../config/robots/ur5.urdf");
const HOME: [f64; 6] = [PI, -1.3, 1.8, -2.0708, -FRAC_PI_2, 0.0];

/// Where the tool is at `q`, as a target.
fn target_at(chain: &Chain<6>, q: &[f64; 6]) -> ToolTarget {
    let pose = chain.forward(q);
    ToolTarget::at_rest(pose.position, pose.rotation.column(2).into(), None)
}

fn reached(chain: &Chain<6>, q: &[f64; 6], target: &ToolTarget) -> bool {
    let pose = chain.forward(q);
    let inside = q.iter().zip(&chain.limits().position).all(|(q, [low, high])| (*low..=*high).contains(q));
    let axis: Vector3<f64> = pose.rotation.column(2).into();
    inside && (pose.position - target.position).norm() <= 1e-9 && (axis - target.axis).norm() <= 5e-8
}

/// A nearly stretched elbow or a nearly straight wrist slows the steps of the loop until they end short.
#[test]
fn poses_near_singularities_are_reached_where_the_steps_of_the_loop_end_short() {
    let chain = Chain::<6>::from_urdf(UR5, None, None).unwrap();
    let mut random = Pcg64::seed_from_u64(3);
    let (mut short, mut missed) = (0, 0);
    for case in 0..120 {
        let mut q = HOME.map(|q| q + random.random_range(-0.3..0.3));
        let small = 10.0_f64.powf(random.random_range(-2.5..-1.0));
        q[if case % 2 == 0 { 2 } else { 4 }] = small;
        let target = target_at(&chain, &q);
        let seed = q.map(|q| q + random.random_range(-0.25..0.25));
        short += usize::from(plain(&chain, seed, &target).is_none());
        match solve_pose(&chain, &seed, &target) {
            Some(found) => assert!(reached(&chain, &found, &target), "{case}: {found:?}"),
            None => missed += 1,
        }
    }
    assert!(short > 20, "{short} poses, the steps of the loop end short of them");
    assert_eq!(missed, 0);
}

/// Half of the workspace of the arm away from the seed, in one call.
#[test]
fn a_far_pose_is_reached_along_the_way() {
    let chain = Chain::<6>::from_urdf(UR5, None, None).unwrap();
    let mut random = Pcg64::seed_from_u64(4);
    for case in 0..60 {
        let far = Vector3::new(random.random_range(0.3..0.7), random.random_range(-0.4..0.4), 0.2);
        let about = Unit::new_normalize(Vector3::new(random.random_range(-1.0..1.0), 1.0, 0.0));
        let axis = Rotation3::from_axis_angle(&about, random.random_range(-0.4..0.4)) * -Vector3::z();
        let target = ToolTarget::at_rest(far, axis, None);
        let found = solve_pose(&chain, &HOME, &target).unwrap_or_else(|| panic!("{case}: {target:?}"));
        assert!(reached(&chain, &found, &target), "{case}: {found:?}");
    }
}

#[test]
fn what_is_out_of_reach_stays_so_however_little_it_is() {
    let chain = Chain::<6>::from_urdf(UR5, None, None).unwrap();
    // The arm stretched: a point farther along the line from the shoulder is beyond it.
    let stretched = [PI, -0.4, 0.0, -1.2, -FRAC_PI_2, 0.0];
    let wrist = chain.forward(&stretched);
    let outwards = {
        let from: Vector3<f64> = wrist.origins.column(1).into();
        let to: Vector3<f64> = wrist.origins.column(3).into();
        (to - from).normalize()
    };
    let mut seed = stretched;
    seed[2] = 0.3;
    for beyond in [1e-7, 1e-5, 1e-2, 3.0] {
        let mut target = target_at(&chain, &stretched);
        // Another turn about the pen would bring the wrist nearer.
        target.spin = Some(wrist.rotation.column(0).into());
        target.position += outwards * beyond;
        assert_eq!(solve_pose(&chain, &seed, &target), None, "{beyond} m beyond");
    }
    let narrow = UR5.replace("lower=\"-3.141592653589793\"", "lower=\"1.7\"");
    let narrow = Chain::<6>::from_urdf(&narrow, None, None).unwrap();
    let behind = target_at(&chain, &[PI, -1.0, 1.4, -2.0, -FRAC_PI_2, 0.0]);
    assert!(solve_pose(&chain, &HOME, &behind).is_some());
    let found = solve_pose(&narrow, &HOME, &behind);
    assert!(found.is_none_or(|q| q[2] >= 1.7), "{found:?}");
}
