//! Distances between segments, planes and boxes against brute force.

use foretrace_control::clearance::{Obstacle, ObstacleError};
use foretrace_control::geometry::{Cuboid, Segment, Separation, point_plane, segment_box, segment_segment};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn vector(rng: &mut Pcg64, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-size..size))
}

/// Sometimes a point, sometimes along an axis.
fn segment(rng: &mut Pcg64) -> Segment {
    let from = vector(rng, 1.0);
    let to = match rng.random_range(0..6) {
        0 => from,
        1 => from + Vector3::x() * rng.random_range(-1.0..1.0),
        _ => vector(rng, 1.0),
    };
    Segment { from, to }
}

fn cuboid(rng: &mut Pcg64) -> Cuboid {
    let mut size = || rng.random_range(0.05..1.0);
    let size = [size(), size(), size()];
    let rpy = if rng.random_range(0..3) == 0 { Vector3::zeros() } else { vector(rng, 3.0) };
    match Obstacle::cuboid(vector(rng, 0.8).into(), size, rpy.into()).unwrap() {
        Obstacle::Cuboid(cuboid) => cuboid,
        Obstacle::HalfSpace(_) => unreachable!(),
    }
}

/// The minimum of a convex function over 0 to 1, by golden-section search.
fn smallest(f: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..200 {
        let (a, b) = (high - 0.618_033_988_75 * (high - low), low + 0.618_033_988_75 * (high - low));
        if f(a) < f(b) { high = b } else { low = a }
    }
    f(0.5 * (low + high)).min(f(0.0)).min(f(1.0))
}

fn point_segment(p: &Vector3<f64>, s: &Segment) -> f64 {
    smallest(|t| (s.at(t) - p).norm())
}

fn point_box(p: &Vector3<f64>, c: &Cuboid) -> f64 {
    let local = c.axes.transpose() * (p - c.centre);
    local.zip_map(&c.half, |x, h| (x.abs() - h).max(0.0)).norm()
}

fn assert_witnessed(found: &Separation, on: &Segment) {
    assert!((found.normal.norm() - 1.0).abs() < 1e-9, "{found:?}");
    assert!(point_segment(&found.point, on) < 1e-7, "{found:?}");
    assert!(((found.point - found.other) - found.normal * found.distance).norm() < 1e-9, "{found:?}");
}

#[test]
fn two_segments_are_as_far_apart_as_their_nearest_points() {
    let mut rng = Pcg64::seed_from_u64(1);
    for round in 0..3_000 {
        let (a, mut b) = (segment(&mut rng), segment(&mut rng));
        if round % 5 == 0 {
            // Parallel, to rounding.
            b.to = b.from + (a.to - a.from) * rng.random_range(-2.0..2.0);
        }
        let found = segment_segment(&a, &b);
        let brute = smallest(|s| point_segment(&a.at(s), &b));
        assert!((found.distance - brute).abs() < 1e-7, "{a:?} {b:?}: {} {brute}", found.distance);
        assert_witnessed(&found, &a);
        assert!(point_segment(&found.other, &b) < 1e-7);
        let back = segment_segment(&b, &a);
        assert!((back.distance - found.distance).abs() < 1e-9);
    }
}

#[test]
fn a_segment_is_as_far_from_a_box_as_its_nearest_point() {
    let mut rng = Pcg64::seed_from_u64(2);
    let (mut apart, mut inside) = (0, 0);
    for _ in 0..20_000 {
        let (s, c) = (segment(&mut rng), cuboid(&mut rng));
        let found = segment_box(&s, &c);
        let brute = smallest(|t| point_box(&s.at(t), &c));
        assert_witnessed(&found, &s);
        if brute > 1e-9 {
            assert!((found.distance - brute).abs() < 1e-7, "{s:?} {c:?}: {} {brute}", found.distance);
            assert!(point_box(&found.other, &c) < 1e-9);
            apart += 1;
        } else {
            assert!(found.distance <= 1e-6, "{found:?}");
            // Moved out by the depth it touches; moved a little less it still overlaps.
            let moved = |by: f64| {
                let shift = found.normal * by;
                segment_box(&Segment { from: s.from + shift, to: s.to + shift }, &c).distance
            };
            assert!(moved(-found.distance + 1e-6) > 0.0, "{found:?}");
            inside += 1;
        }
    }
    assert!(apart > 5_000 && inside > 1_000, "{apart} {inside}");
}

/// Continuity: from far outside to the middle, distances of nearby positions differ by no more than their
/// displacement.
#[test]
fn distance_to_a_box_has_no_jumps() {
    let mut rng = Pcg64::seed_from_u64(3);
    for _ in 0..300 {
        let (s, c, way) = (segment(&mut rng), cuboid(&mut rng), vector(&mut rng, 1.0));
        let at = |k: i32| {
            let shift = way * (f64::from(k) * 2e-3);
            segment_box(&Segment { from: s.from + shift, to: s.to + shift }, &c).distance
        };
        let mut last = at(-500);
        for k in -499..=500 {
            let next = at(k);
            assert!((next - last).abs() <= way.norm() * 2e-3 + 1e-9, "{last} to {next}");
            last = next;
        }
    }
}

#[test]
fn plane_distance_is_signed_height_over_the_plane() {
    let Obstacle::HalfSpace(plane) = Obstacle::plane([0.1, -0.2, 0.3], [0.0, 0.6, 0.8]).unwrap() else {
        panic!()
    };
    let found = point_plane(&(plane.point + plane.normal * -0.25 + Vector3::x()), &plane);
    assert!((found.distance + 0.25).abs() < 1e-12);
    assert!((found.other - (plane.point + Vector3::x())).norm() < 1e-12);
}

#[test]
fn obstacles_without_direction_or_volume_are_refused() {
    assert!(matches!(Obstacle::plane([0.0; 3], [0.0, 0.0, 2.0]), Err(ObstacleError::Normal { .. })));
    assert_eq!(Obstacle::plane([f64::NAN, 0.0, 0.0], [0.0, 0.0, 1.0]), Err(ObstacleError::NotFinite));
    let flat = Obstacle::cuboid([0.0; 3], [1.0, 0.0, 1.0], [0.0; 3]).unwrap_err();
    assert!(flat.to_string().contains("[1, 0, 1] m"), "{flat}");
}
