//! Whether a straight path in joint space is clear, checked point by point before anything moves.
//!
//! Along q(s) = q₀ + s·Δq the distance d of a pair changes by at most Σ_j lever_j |Δq_j| per unit of s. Its
//! least distance allowed cannot be reached before s has grown by (d − least) / Σ_j lever_j |Δq_j|: the next
//! point to check is the smallest of these steps over all pairs. Steps are never shorter than `STEP_M` of
//! motion, or a thousandth of the path; what such a step may hide is less than [`MORE_M`], which is added to
//! the margin.
//!
//! Contract: pure; no allocation after construction; bounded work per call and a bounded number of calls per
//! path. A pair that begins nearer than the margin may not come nearer than it begins; a pair that ends
//! nearer may come as near as that. *Source*: conservative advancement, Mirtich 1996, section 2.3.

use crate::arm::chain::Chain;
use crate::clearance::watch::PairWatch;
use crate::clearance::{Clearance, Kinematics};
use crate::state::state;

/// Shortest motion of any body between two checks \[m\], bounded by the levers.
const STEP_M: f64 = 1e-3;
/// Most checks along one path.
const LOOKS: f64 = 1000.0;
/// Added to the margin, so that the damping rows leave some speed along the whole path \[m\].
pub const MORE_M: f64 = 1e-3;
/// A pair that begins nearer than the margin may come nearer by rounding only \[m\].
const ROUNDING_M: f64 = 1e-6;

/// What stands in the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstructed {
    /// Number of the pair, see [`Clearance::pair_names`].
    pub pair: u16,
    /// Position on the path, 0 to 1.
    pub share: f64,
    /// Their distance there \[m\]; negative where they overlap.
    pub distance_m: f64,
}

/// Result of one check along a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WayCheck {
    /// Clear so far; more points to check.
    SoFar,
    /// The whole path is clear.
    Clear,
    /// A pair comes too near.
    Blocked(Obstructed),
}

/// A path, and how far it was checked.
#[derive(Debug, Clone)]
pub struct Way<const J: usize> {
    from: [f64; J],
    to: [f64; J],
    share: f64,
    /// Smallest distance allowed per pair \[m\].
    least: Vec<f64>,
    /// Whether the end was checked, which sets the smallest distance allowed there.
    end_seen: bool,
}

state! { [const J: usize] Way<J> { from, to, share, least, end_seen } }

impl<const J: usize> Way<J> {
    /// A path from zero to zero with room for the pairs of `clearance`.
    #[must_use]
    pub fn new(clearance: Option<&Clearance<J>>) -> Self {
        let pairs = clearance.map_or(0, |clearance| clearance.pairs.len());
        Self {
            from: [0.0; J],
            to: [0.0; J],
            share: 0.0,
            end_seen: false,
            least: vec![f64::NEG_INFINITY; pairs],
        }
    }

    /// Begins to check the path from `from` to `to` \[rad\].
    pub fn begin(&mut self, from: [f64; J], to: [f64; J]) {
        (self.from, self.to, self.share, self.end_seen) = (from, to, 0.0, false);
    }

    /// The joints at `share` of the way \[rad\]; exactly the end at 1.
    #[must_use]
    pub fn at(&self, share: f64) -> [f64; J] {
        if share >= 1.0 {
            return self.to;
        }
        let mut q = self.from;
        q.iter_mut().zip(&self.to).for_each(|(q, to)| *q += share * (to - *q));
        q
    }
}

impl<const J: usize> Clearance<J> {
    /// Checks one more point of `way`. `chain` is the one that this clearance was made for.
    pub fn look_along(&self, chain: &Chain<J>, way: &mut Way<J>) -> WayCheck {
        if !way.end_seen {
            return self.look_at_end(chain, way);
        }
        let kinematics = chain.forward(&way.at(way.share));
        let begins = way.share <= 0.0;
        let (mut nearest, mut next) = (None::<(f64, Obstructed)>, f64::INFINITY);
        let mut farthest_m = 0.0_f64;
        for (index, (pair, least)) in self.pairs.iter().zip(&mut way.least).enumerate() {
            let distance_m = pair.separations(&kinematics, |_| {});
            if begins {
                *least = least.min(distance_m - ROUNDING_M);
            }
            let turns = way.from.iter().zip(&way.to).zip(&pair.levers);
            let reach_m: f64 = turns.map(|((from, to), lever)| lever * (to - from).abs()).sum();
            farthest_m = farthest_m.max(reach_m);
            let more = distance_m - *least;
            // Written so that a NaN distance blocks the path.
            if !(more >= 0.0) && nearest.is_none_or(|(worst, _)| !(more >= worst)) {
                let pair = u16::try_from(index).unwrap_or(u16::MAX);
                nearest = Some((more, Obstructed { pair, share: way.share, distance_m }));
            }
            if reach_m > 0.0 {
                next = next.min(more / reach_m);
            }
        }
        if let Some((_, obstructed)) = nearest {
            return WayCheck::Blocked(obstructed);
        }
        if way.share >= 1.0 {
            return WayCheck::Clear;
        }
        let shortest = if farthest_m > 0.0 { STEP_M / farthest_m } else { 1.0 };
        way.share = (way.share + next.max(shortest).max(1.0 / LOOKS)).min(1.0);
        WayCheck::SoFar
    }

    /// An end that keeps the margin is allowed, even without the addition.
    fn look_at_end(&self, chain: &Chain<J>, way: &mut Way<J>) -> WayCheck {
        let kinematics = chain.forward(&way.at(1.0));
        for (pair, least) in self.pairs.iter().zip(&mut way.least) {
            let distance_m = pair.separations(&kinematics, |_| {});
            *least = (distance_m - ROUNDING_M).clamp(self.margin - ROUNDING_M, self.margin + MORE_M);
        }
        way.end_seen = true;
        WayCheck::SoFar
    }

    /// The same clearance, with gaps closing at `share` of the rate at most.
    #[must_use]
    pub fn damped(mut self, share: f64) -> Self {
        self.rate *= share;
        // A clone's list has no spare capacity.
        self.watch = PairWatch::new(&self.pairs);
        self
    }

    /// The fraction of `qd` \[rad/s\] that satisfies every row of the last call; 1 if all of it does.
    pub(crate) fn share_kept(&self, qd: &[f64; J]) -> f64 {
        let kept = self.found.rows().iter().map(|(row, bound)| {
            let speed: f64 = row.iter().zip(qd).map(|(c, v)| c * v).sum();
            // A motion that does not close the gap opens it by no share of its speed.
            if speed >= bound || speed >= 0.0 { 1.0 } else { bound.min(0.0) / speed }
        });
        kept.fold(1.0, f64::min)
    }

    /// The smallest distance at `kinematics` \[m\] and its pair. Does not allocate.
    pub(crate) fn nearest_pair(&self, kinematics: &Kinematics<J>) -> Option<(u16, f64)> {
        let all = self.pairs.iter().zip(0_u16..).map(|(pair, n)| (n, pair.separations(kinematics, |_| {})));
        all.min_by(|(_, a), (_, b)| a.total_cmp(b))
    }

    /// Name of each pair for messages: "`forearm_link` and box 2", numbered as in the settings. Allocates.
    #[must_use]
    pub fn pair_names(&self) -> Vec<String> {
        self.pairs.iter().map(|pair| pair.called()).collect()
    }
}
