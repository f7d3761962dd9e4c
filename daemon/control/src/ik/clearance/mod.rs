//! Keeping the arm away from planes, boxes and itself: velocity dampers as rows of the IK's QP.
//!
//! For every pair of shapes with distance d and unit normal n between the nearest points, the joint velocities must obey
//!
//!   nᵀJ q̇ + ½h·nᵀJ̇q̇ ≥ −ξ (d − margin),     ξ = 1 / (max(T_a, T_b/2 + hold) + T_j + h).
//!
//! The gap above the margin then shrinks exponentially at most. T_a = max v/a is the longest time in which the IK itself stops
//! the joints, T_b = max v/a_b that of a consumer without commands, T_j = max a/j. Joints that slow down in proportion change
//! every closing speed by the factor 1 − h/T, the gaps by 1 − ξh at most: to first order braking keeps all rows at once,
//! whatever the pairs, and the QP always has an answer. A consumer covers v_n(hold + T_b/2) ≤ d − margin until it stands.
//! What that leaves out (joints that stop at different times, turning normals, position limits in the way of braking) is what
//! the margin is for; rows that cannot be kept yield with the least violation.
//!
//! Contract: after construction no allocation, bounded work, no panic. A tick whose shapes are all too far away to matter
//! costs J multiplications: no point of the arm moves farther than Σ reach_j |Δq_j|.
//! *Source*: Faverjon and Tournassoud, "A local based approach for path planning of manipulators with a high number of
//! degrees of freedom", ICRA 1987; Kanehiro et al., "A local collision avoidance method for non-strictly convex polyhedra",
//! RSS 2008.

pub(in crate::ik) mod bodies;
pub mod distance;
mod motion;
mod pairs;
pub mod shape;

use nalgebra::Vector3;
use thiserror::Error;

pub use pairs::Nearest;
pub use shape::{Capsule, MAX_OBSTACLES, Obstacle, ObstacleError};

use super::chain::{Chain, Kinematics};
use super::limit::{JointLimits, JointMotion, VelocityBox};
use crate::qp::row_qp::RowSet;
use distance::{Separation, point_plane, segment_box, segment_segment};
use motion::Moving;
use pairs::Placed;

/// Most capsules of one arm.
pub const MAX_CAPSULES: usize = 24;

/// Fastest way back to the margin [m/s].
const RETREAT_MPS: f64 = 0.05;

/// What to keep away from, and how far.
#[derive(Debug, Clone, PartialEq)]
pub struct ClearanceSettings {
    /// Distance kept between capsules and whatever they must not touch [m].
    pub margin_m: f64,
    /// The arm keeps away from itself.
    pub itself: bool,
    /// At most [`MAX_OBSTACLES`].
    pub obstacles: Vec<Obstacle>,
}

/// Why a clearance could not be set up.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ClearanceError {
    /// The margin is out of range.
    #[error("the margin {margin_m} m is outside 0.001 to 0.2 m")]
    Margin {
        /// [m]
        margin_m: f64,
    },
    /// Too many planes and boxes.
    #[error("{count} planes and boxes, but there is room for {MAX_OBSTACLES}")]
    Obstacles {
        /// How many.
        count: usize,
    },
    /// Too many shapes.
    #[error("the description has {count} collision shapes, but there is room for {MAX_CAPSULES}")]
    Capsules {
        /// How many.
        count: usize,
    },
    /// There is something to keep away from, but nothing is known of the arm's shape.
    #[error(
        "no moving link has a sphere, cylinder, capsule or box as collision geometry (only meshes: {meshes}), so nothing can be kept away"
    )]
    NoShape {
        /// Links with meshes.
        meshes: String,
    },
}

/// Evidence of one tick; the default is that of nothing to keep away from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClearanceReport {
    /// Rows that could have mattered.
    pub rows: u32,
    /// Rows that held the motion back.
    pub held: u32,
    /// Rows that could not be kept.
    pub yielded: u32,
}

/// Keeps the distances of one arm.
#[derive(Debug)]
pub struct Clearance<const J: usize> {
    chain: Chain<J>,
    obstacles: Vec<Obstacle>,
    pairs: Vec<[usize; 2]>,
    margin: f64,
    rate: f64,
    reach: [f64; J],
    /// Direction of the first joint's axis in the base frame.
    first_axis: Vector3<f64>,
    /// Joint positions of the last look, and the smallest distance found there.
    seen: [f64; J],
    nearest: f64,
}

impl<const J: usize> Clearance<J> {
    /// For the arm `chain` inside `limits`, commanded every `period_s` seconds.
    ///
    /// *Errors*: see [`ClearanceError`].
    pub fn new(
        chain: &Chain<J>,
        limits: &JointLimits<J>,
        period_s: f64,
        settings: &ClearanceSettings,
    ) -> Result<Self, ClearanceError> {
        let margin = settings.margin_m;
        if !(1e-3..=0.2).contains(&margin) {
            return Err(ClearanceError::Margin { margin_m: margin });
        }
        if settings.obstacles.len() > MAX_OBSTACLES {
            return Err(ClearanceError::Obstacles { count: settings.obstacles.len() });
        }
        if chain.capsules().len() > MAX_CAPSULES {
            return Err(ClearanceError::Capsules { count: chain.capsules().len() });
        }
        if !settings.obstacles.is_empty() && chain.capsules().iter().all(|capsule| capsule.link == 0) {
            return Err(ClearanceError::NoShape { meshes: chain.mesh_links().join(", ") });
        }
        let longest = |v: &[f64; J], a: &[f64; J]| v.iter().zip(a).map(|(v, a)| v / a).fold(0.0, f64::max);
        let own = longest(limits.velocity(), limits.acceleration());
        let consumer = 0.5 * longest(limits.velocity(), limits.deceleration()) + limits.hold_s();
        let ease = limits.jerk().map_or(0.0, |jerk| longest(limits.acceleration(), jerk));
        Ok(Self {
            chain: chain.clone(),
            obstacles: settings.obstacles.clone(),
            pairs: if settings.itself { pairs::of_itself(chain, limits) } else { Vec::new() },
            margin,
            rate: 1.0 / (own.max(consumer) + ease + period_s),
            reach: chain.reach(),
            first_axis: chain
                .frames(&[0.0; J])
                .first()
                .map_or_else(Vector3::z, |(r, _)| r.column(2).into_owned()),
            seen: [0.0; J],
            nearest: f64::NEG_INFINITY,
        })
    }

    /// Distance kept [m].
    #[must_use]
    pub const fn margin_m(&self) -> f64 {
        self.margin
    }

    /// ξ: the share of the gap that may close per second [1/s].
    #[must_use]
    pub const fn rate_hz(&self) -> f64 {
        self.rate
    }

    /// Pairs of capsules of the arm itself that are watched, as indices into [`Chain::capsules`].
    #[must_use]
    pub fn pairs(&self) -> &[[usize; 2]] {
        &self.pairs
    }

    /// What is nearest at joint positions `q` [rad]; `None` where nothing is to be kept away. For start-up checks: allocates.
    #[must_use]
    pub fn nearest(&self, q: &[f64; J]) -> Option<Nearest> {
        let placed = Placed::new(&self.chain, q);
        let mut best: Option<Nearest> = None;
        self.each(&placed, |first, second, found| {
            if best.as_ref().is_none_or(|best| found.distance < best.distance_m) {
                best = Some(Nearest::of(self.chain.capsules(), first, second, found.distance));
            }
        });
        best
    }

    /// The rows for a step of `elapsed` seconds inside `allowed` from `motion`; those that no velocity in the box could break
    /// are left out, and beyond the capacity those that are farthest from being broken.
    pub fn rows(
        &mut self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        allowed: &VelocityBox<J>,
        elapsed: f64,
    ) -> RowSet<J> {
        let mut rows = RowSet::default();
        let extremes = allowed.lower.iter().zip(&allowed.upper).map(|(low, high)| low.abs().max(high.abs()));
        let fastest: f64 = extremes.zip(&self.reach).map(|(v, reach)| v * reach).sum();
        let moved = motion.q.iter().zip(&self.seen).zip(&self.reach);
        let moved: f64 = moved.map(|((q, seen), reach)| (q - seen).abs() * reach).sum();
        // Self-collision closes with the motion of both sides.
        let near = self.margin + 2.0 * fastest / self.rate;
        if self.nearest - 2.0 * moved > near {
            return rows;
        }
        let placed = Placed::new(&self.chain, &motion.q);
        let moving = Moving::new(kinematics, &motion.qd);
        let mut slack = [0.0; 32];
        let mut nearest = f64::INFINITY;
        self.each(&placed, |first, second, found| {
            nearest = nearest.min(found.distance);
            if !(found.distance <= near) {
                return;
            }
            let (mut row, mut bending) = moving.toward(first, &found.point, &found.normal);
            if let Some(link) = second {
                let (other, bent) = moving.toward(link, &found.other, &found.normal);
                row.iter_mut().zip(&other).for_each(|(row, other)| *row -= other);
                bending -= bent;
            }
            let bound =
                (-self.rate * (found.distance - self.margin)).min(RETREAT_MPS) - 0.5 * elapsed * bending;
            let ends = allowed.lower.iter().zip(&allowed.upper).zip(&row);
            let worst: f64 = ends.map(|((low, high), c)| (c * low).min(c * high)).sum();
            let room = worst - bound;
            if !(room < 0.0) {
                return;
            }
            let capacity = RowSet::<J>::CAPACITY.min(slack.len());
            let mut slot = rows.len();
            if slot >= capacity {
                // The one with most room gives way.
                let kept = slack.iter().take(capacity).enumerate();
                let loosest =
                    kept.fold(
                        (0, f64::NEG_INFINITY),
                        |(at, most), (i, slack)| {
                            if *slack > most { (i, *slack) } else { (at, most) }
                        },
                    );
                if loosest.1 <= room {
                    return;
                }
                slot = loosest.0;
            }
            if let Some(slack) = slack.get_mut(slot) {
                *slack = room;
                rows.put(slot, &row, bound);
            }
        });
        (self.seen, self.nearest) = (motion.q, nearest);
        rows
    }

    /// Calls `found` with every separation: link of the first capsule, link of the second (`None`: an obstacle).
    fn each(&self, placed: &Placed, mut found: impl FnMut(usize, Option<usize>, Separation)) {
        for (capsule, axis) in self.chain.capsules().iter().zip(&placed.axes) {
            // The base cannot be moved away from anything.
            if capsule.link == 0 {
                continue;
            }
            let mut tell = |separation: Separation| {
                found(capsule.link, None, separation.less(capsule.radius));
            };
            for obstacle in &self.obstacles {
                match obstacle {
                    // The first link turns in parallel to a table that the arm stands on: no joint changes that gap.
                    Obstacle::HalfSpace(plane)
                        if capsule.link == 1 && plane.normal.dot(&self.first_axis).abs() > 1.0 - 1e-6 => {}
                    // Both ends: a capsule that lies along a plane can neither approach nor tilt into it.
                    Obstacle::HalfSpace(plane) => {
                        tell(point_plane(&axis.from, plane));
                        if axis.from != axis.to {
                            tell(point_plane(&axis.to, plane));
                        }
                    }
                    Obstacle::Cuboid(cuboid) => {
                        tell(segment_box(axis, cuboid));
                        for end in [axis.from, axis.to] {
                            tell(segment_box(&distance::Segment { from: end, to: end }, cuboid));
                        }
                    }
                }
            }
        }
        let capsules = self.chain.capsules();
        for [a, b] in &self.pairs {
            if let (Some(first), Some(second), Some(on_first), Some(on_second)) =
                (capsules.get(*a), capsules.get(*b), placed.axes.get(*a), placed.axes.get(*b))
            {
                let separation = segment_segment(on_first, on_second).less(first.radius + second.radius);
                found(first.link, Some(second.link), separation);
            }
        }
    }
}
