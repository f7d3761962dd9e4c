//! Keeping the arm away from planes, boxes and itself: velocity dampers as rows of the IK's QP.
//!
//! For every pair of shapes with distance d and unit normal n between the nearest points, the joint
//! velocities must obey
//!
//!   nᵀJ q̇ + ½h·nᵀJ̇q̇ ≥ −ξ (d − margin),     ξ = 1 / (max(T_a, T_b/2 + hold) + T_j + h).
//!
//! The gap above the margin then shrinks exponentially at most. T_a = max v/a is the longest time in which
//! the IK itself stops the joints, T_b = max v/a_b that of a consumer without commands, T_j = max a/j with
//! the jerk of a stop. Joints that slow down in proportion scale every closing speed by 1 − h/T and every gap
//! by at least 1 − ξh, so braking satisfies all rows at once to first order, and the QP is feasible.
//!
//! A consumer that receives no more commands brakes every joint independently, so joints that together kept a
//! gap may close it. A second row bounds the distance where that braking ends, q_s = q + q̇(h + hold) +
//! q̇|q̇|/(2a_b), with distance d_s and gradient nᵀJ_s there:
//!
//!   nᵀJ_s (h + hold + |q̇|/a_b)(q̇' − q̇) ≥ min(d, margin) − d_s
//!
//! Unchanged velocities keep q_s, so these rows are feasible too. The margin covers what both rows neglect:
//! the path to q_s, normals that turn within a tick, position limits that cut braking short. Rows that cannot
//! be satisfied are relaxed with the least violation.
//!
//! Contract: no allocation after construction, bounded work, no panic. The rows of a tick are a function of
//! its inputs; the memory between ticks (`watch`) only saves distance computations that cannot matter.
//! *Source*: Faverjon and Tournassoud, "A local based approach for path planning of manipulators with a high
//! number of degrees of freedom", ICRA 1987; Kanehiro et al., "A local collision avoidance method for
//! non-strictly convex polyhedra", RSS 2008.

mod motion;
mod pairs;
mod obstacle;
mod watch;
pub mod way;

use crate::state::state;
use thiserror::Error;

pub use crate::arm::Capsule;
pub use obstacle::{MAX_OBSTACLES, Obstacle, ObstacleError};
pub use pairs::Nearest;

use crate::arm::chain::{Chain, Kinematics};
use crate::arm::limits::{JointLimits, JointMotion, VelocityBox, longest, stop_jerk};
use crate::arm::silence::Silence;
use crate::qp::offered::OfferedRows;
use crate::qp::row_qp::RowSet;
use motion::LinkMotion;
use pairs::{Other, Pair};
use watch::{PairWatch, Reach};
pub use way::{Obstructed, Way, WayCheck};

/// Largest number of capsules of one arm.
pub const MAX_CAPSULES: usize = 40;

/// Fastest retreat to the margin \[m/s\].
const RETREAT_MPS: f64 = 0.05;

/// What to keep away from, and at which distance.
#[derive(Debug, Clone, PartialEq)]
pub struct ClearanceSettings {
    /// Distance kept between capsules and whatever they must not touch \[m\].
    pub margin_m: f64,
    /// Whether the arm keeps away from itself.
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
        /// \[m\]
        margin_m: f64,
    },
    /// Too many planes and boxes.
    #[error("{count} planes and boxes, but there is room for {MAX_OBSTACLES}")]
    Obstacles {
        /// How many there are.
        count: usize,
    },
    /// Too many shapes.
    #[error("the description has {count} collision shapes, but there is room for {MAX_CAPSULES}")]
    Capsules {
        /// How many there are.
        count: usize,
    },
    /// There is something to keep away from, but the shape of the arm is unknown.
    #[error(
        "no moving link has a sphere, cylinder, capsule or box as collision geometry (only meshes: \
         {meshes}), so nothing can be kept away"
    )]
    NoShape {
        /// Names of links that have meshes only.
        meshes: String,
    },
}

/// Evidence of one tick; the default: nothing to keep away from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClearanceReport {
    /// Rows that could have mattered.
    pub rows: u32,
    /// Rows that held the motion back.
    pub held: u32,
    /// Rows that could not be kept.
    pub yielded: u32,
}

state! { [] ClearanceReport { rows, held, yielded } }

/// What a row demands once its gap is used up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Inside {
    /// Go back to the margin.
    Retreat,
    /// Come no nearer: for an arm that is to stop.
    Stay,
}

/// Keeps the distances of one arm.
#[derive(Debug, Clone)]
pub struct Clearance<const J: usize> {
    chain: Chain<J>,
    limits: JointLimits<J>,
    pairs: Vec<Pair<J>>,
    margin: f64,
    rate: f64,
    watch: PairWatch<J>,
    found: OfferedRows<J>,
}

state! { [const J: usize] Clearance<J> { watch, found } fixed { chain, limits, pairs, margin, rate } }

impl<const J: usize> Clearance<J> {
    /// For the arm `chain` inside `limits`, commanded every `period_s` seconds.
    ///
    /// # Errors
    ///
    /// See [`ClearanceError`].
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
        let own = longest(limits.velocity(), limits.acceleration());
        let consumer = 0.5 * longest(limits.velocity(), limits.deceleration()) + limits.hold_s();
        let ease = longest(limits.acceleration(), &stop_jerk(limits));
        let mut pairs = pairs::with_obstacles(chain, &settings.obstacles);
        if settings.itself {
            pairs.extend(pairs::of_itself(chain, limits));
        }
        pairs.sort_by_key(Pair::bodies);
        Ok(Self {
            chain: chain.clone(),
            limits: *limits,
            watch: PairWatch::new(&pairs),
            pairs,
            margin,
            rate: 1.0 / (own.max(consumer) + ease + period_s),
            found: OfferedRows::default(),
        })
    }

    /// The rows of the last call.
    pub(crate) fn found(&self) -> &OfferedRows<J> {
        &self.found
    }

    /// ξ: the fraction of the gap that may close per second \[1/s\].
    #[must_use]
    pub const fn rate_hz(&self) -> f64 {
        self.rate
    }

    /// Pairs of links that are checked against each other, inner link first, one entry per pair of their
    /// capsules.
    pub fn links(&self) -> impl Iterator<Item = [usize; 2]> {
        self.pairs.iter().filter_map(|pair| Some([pair.first.link, pair.other_link()?]))
    }

    /// Pairs of the arm's own capsules that are checked, inner link first, with their distances \[m\]. For
    /// judges of the shapes.
    pub fn distances_within<'a>(
        &'a self,
        kinematics: &'a Kinematics<J>,
    ) -> impl Iterator<Item = ([&'a Capsule; 2], f64)> {
        self.pairs.iter().filter_map(|pair| match &pair.other {
            Other::Capsule(other) => Some(([&pair.first, other], pair.separations(kinematics, |_| {}))),
            Other::Plane(_) | Other::Cuboid(_) => None,
        })
    }

    /// The nearest pair; `None` if there is nothing to keep away from. For start-up checks: allocates.
    #[must_use]
    pub fn nearest(&self, kinematics: &Kinematics<J>) -> Option<Nearest> {
        let measured = self.pairs.iter().map(|pair| (pair, pair.separations(kinematics, |_| {})));
        let nearest = measured.min_by(|(_, a), (_, b)| a.total_cmp(b));
        nearest.map(|(pair, distance)| pair.nearest(distance))
    }

    /// The rows for a step of `elapsed` seconds inside `allowed` from `motion`. Rows that no velocity in the
    /// box can violate are left out, and beyond the capacity those with the most room.
    pub fn rows(
        &mut self,
        kinematics: &Kinematics<J>,
        motion: &JointMotion<J>,
        allowed: &VelocityBox<J>,
        elapsed: f64,
        inside: Inside,
    ) -> &RowSet<J> {
        let Self { chain, limits, pairs, margin, rate, watch, found, .. } = self;
        found.clear();
        let back = match inside {
            Inside::Retreat => RETREAT_MPS,
            Inside::Stay => 0.0,
        };
        let reach = Reach::new(motion, allowed, elapsed, *rate);
        let (mut moving, mut silent) = (None, None);
        let glide = Silence::farthest(limits, motion, allowed, elapsed);
        watch.look(pairs, &motion.q, &reach, *margin, |pair, enough| {
            let distance = pair.separations(kinematics, |separation| {
                let gap = separation.distance - *margin;
                if !(gap <= enough) {
                    return;
                }
                let moving = moving.get_or_insert_with(|| LinkMotion::new(kinematics, &motion.qd));
                let (row, bending) = moving.apart(pair, &separation);
                let bound = (-*rate * gap).min(back) - 0.5 * elapsed * bending;
                found.offer(&row, bound, allowed);
            });
            // A consumer without commands never gets that far.
            let farthest: f64 = pair.levers.iter().zip(&glide).map(|(lever, angle)| lever * angle).sum();
            if distance - *margin <= farthest {
                let silent = silent.get_or_insert_with(|| Silence::after(chain, limits, motion, elapsed));
                let resting = LinkMotion::new(&silent.kinematics, &[0.0; J]);
                let least = margin.min(distance);
                pair.separations(&silent.kinematics, |separation| {
                    let (mut row, _) = resting.apart(pair, &separation);
                    row.iter_mut().zip(&silent.gain).for_each(|(c, gain)| *c *= gain * *rate);
                    let now: f64 = row.iter().zip(&motion.qd).map(|(c, v)| c * v).sum();
                    found.offer(&row, now - *rate * (separation.distance - least), allowed);
                });
            }
            distance
        });
        found.rows()
    }
}
