//! Distances between segments, planes and boxes, with the points where they are taken.
//!
//! Contract: pure, bounded, no allocation; finite shapes give finite answers with a unit normal. A distance
//! is negative where shapes overlap; its size is then the depth by which the first must move along the normal
//! to be in contact only.
//!
//! Source: Ericson, "Real-Time Collision Detection" (2005), section 5.1.9 for two segments. The square of a
//! segment's distance to a box is convex and piecewise quadratic along the segment, so its minimum is found
//! exactly.

use nalgebra::{Matrix3, Vector3};

/// Two axes nearer than this have no defined direction between them \[m\].
const TOUCHING_M: f64 = 1e-12;

/// A straight segment between two points in one frame \[m\]; a point if both are equal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// One end \[m\].
    pub from: Vector3<f64>,
    /// The other end \[m\].
    pub to: Vector3<f64>,
}

impl Segment {
    /// The point at `share` (0: from, 1: to).
    #[must_use]
    pub fn at(&self, share: f64) -> Vector3<f64> {
        self.from + (self.to - self.from) * share
    }
}

/// Everything behind the plane through `point` is forbidden.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// A point of the plane \[m\].
    pub point: Vector3<f64>,
    /// Unit vector away from the forbidden side.
    pub normal: Vector3<f64>,
}

/// A solid box in any orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cuboid {
    /// Its middle \[m\].
    pub centre: Vector3<f64>,
    /// Half of its size along its own axes, positive \[m\].
    pub half: Vector3<f64>,
    /// Columns: its axes, orthonormal.
    pub axes: Matrix3<f64>,
}

/// Distance between two shapes, and its witness points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Separation {
    /// \[m\]; negative where they overlap.
    pub distance: f64,
    /// The point of the first shape \[m\].
    pub point: Vector3<f64>,
    /// The point of the second shape \[m\].
    pub other: Vector3<f64>,
    /// Unit vector from the second to the first: the direction in which the distance grows fastest.
    pub normal: Vector3<f64>,
}

/// From the plane to a point.
#[must_use]
pub fn point_plane(point: &Vector3<f64>, plane: &HalfSpace) -> Separation {
    let distance = plane.normal.dot(&(point - plane.point));
    let other = point - plane.normal * distance;
    Separation { distance, point: *point, other, normal: plane.normal }
}

/// From segment `b` to segment `a`.
#[must_use]
pub fn segment_segment(a: &Segment, b: &Segment) -> Separation {
    let (along_a, along_b, between) = (a.to - a.from, b.to - b.from, a.from - b.from);
    let (aa, bb, ab) = (along_a.norm_squared(), along_b.norm_squared(), along_a.dot(&along_b));
    let (ar, br) = (along_a.dot(&between), along_b.dot(&between));
    let tiny = TOUCHING_M * TOUCHING_M;
    let (s, t) = if aa <= tiny && bb <= tiny {
        (0.0, 0.0)
    } else if aa <= tiny {
        (0.0, unit(br / bb))
    } else if bb <= tiny {
        (unit(-ar / aa), 0.0)
    } else {
        let area = aa * bb - ab * ab;
        // Parallel axes have many nearest pairs: any s is valid, t follows.
        let s = if area > 1e-12 * aa * bb { unit((ab * br - ar * bb) / area) } else { 0.5 };
        let t = (ab * s + br) / bb;
        // The nearest point is beyond an end of b: fix t there and solve for s again.
        if (0.0..=1.0).contains(&t) { (s, t) } else { (unit((ab * unit(t) - ar) / aa), unit(t)) }
    };
    let (point, other) = (a.at(s), b.at(t));
    let gap = point - other;
    let distance = gap.norm();
    let normal = if distance > TOUCHING_M { gap / distance } else { across(&along_a, &along_b) };
    Separation { distance, point, other, normal }
}

/// From the box to the segment; if they overlap, the shortest way out.
#[must_use]
pub fn segment_box(segment: &Segment, cuboid: &Cuboid) -> Separation {
    let into = |point: &Vector3<f64>| cuboid.axes.tr_mul(&(point - cuboid.centre));
    let local = Segment { from: into(&segment.from), to: into(&segment.to) };
    let share = nearest_to_box(&local, &cuboid.half);
    let point = local.at(share);
    let outside = beyond(&point, &cuboid.half);
    let distance = outside.norm();
    let out = |point: &Vector3<f64>| cuboid.centre + cuboid.axes * point;
    if distance > TOUCHING_M {
        let normal = cuboid.axes * (outside / distance);
        return Separation { distance, point: out(&point), other: out(&(point - outside)), normal };
    }
    let (depth, share, direction) = shallowest_way(&local, &cuboid.half);
    let point = local.at(share);
    Separation {
        distance: -depth,
        point: out(&point),
        other: out(&(point + direction * depth)),
        normal: cuboid.axes * direction,
    }
}

/// Where along a segment the distance to the box \[−half, half\] is smallest.
///
/// The derivative of its square is continuous, piecewise linear and non-decreasing, with breakpoints where a
/// coordinate crosses a face. Between the two breakpoints around its zero one division gives the minimum.
fn nearest_to_box(segment: &Segment, half: &Vector3<f64>) -> f64 {
    let along = segment.to - segment.from;
    let slope = |share: f64| beyond(&segment.at(share), half).dot(&along);
    let (mut low, mut high) = (0.0, 1.0);
    let (mut at_low, mut at_high) = (slope(0.0), slope(1.0));
    if at_low >= 0.0 {
        return 0.0;
    }
    if at_high <= 0.0 {
        return 1.0;
    }
    for ((from, along), half) in segment.from.iter().zip(&along).zip(half) {
        for face in [-half, *half] {
            let share = (face - from) / along;
            // An infinite or NaN share (parallel to the face) is never inside.
            if share > low && share < high {
                let here = slope(share);
                if here <= 0.0 {
                    (low, at_low) = (share, here);
                } else {
                    (high, at_high) = (share, here);
                }
            }
        }
    }
    let rise = at_high - at_low;
    if rise > 0.0 { low - at_low * ((high - low) / rise) } else { low }
}

/// The part of a point that is outside the box \[−half, half\].
fn beyond(point: &Vector3<f64>, half: &Vector3<f64>) -> Vector3<f64> {
    point.zip_map(half, |x, half| x - x.max(-half).min(half))
}

/// The least motion that separates a segment from the box: depth of its deepest point, the point's share, and
/// the outward direction, normal to a face, or to an edge and the segment.
fn shallowest_way(segment: &Segment, half: &Vector3<f64>) -> (f64, f64, Vector3<f64>) {
    let along = segment.to - segment.from;
    let mut best = (f64::INFINITY, 0.0, Vector3::z());
    for unit in [Vector3::x(), Vector3::y(), Vector3::z()] {
        let edge = along.cross(&unit).try_normalize(TOUCHING_M);
        for axis in [Some(unit), edge].into_iter().flatten() {
            for direction in [axis, -axis] {
                let reach = half.dot(&direction.abs());
                let (at_from, at_to) =
                    (reach - direction.dot(&segment.from), reach - direction.dot(&segment.to));
                let (depth, share) = if at_to > at_from { (at_to, 1.0) } else { (at_from, 0.0) };
                if depth < best.0 {
                    best = (depth, share, direction);
                }
            }
        }
    }
    best
}

/// A direction in which two crossing axes separate.
fn across(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    let spare = if a.x.abs() <= a.y.abs() { Vector3::x() } else { Vector3::y() };
    [a.cross(b), a.cross(&spare)]
        .into_iter()
        .find_map(|direction| direction.try_normalize(TOUCHING_M))
        .unwrap_or_else(Vector3::z)
}

fn unit(share: f64) -> f64 {
    share.clamp(0.0, 1.0)
}
