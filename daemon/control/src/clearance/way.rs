//! Whether a straight way in joint space is clear, looked along piece by piece before anything moves.
//!
//! Along q(s) = q₀ + s·Δq the distance d of a pair changes by Σ_j lever_j |Δq_j| per unit of s at most. From
//! a place where it is (d − least) more than it must be, nothing can touch before s has grown by (d − least)
//! / Σ_j lever_j |Δq_j|: the next place that has to be looked at is where the first pair's share of that
//! ends. Steps are never shorter than `STEP_M` of way, or a thousandth of the whole; what may hide in one is
//! less than [`MORE_M`], which is kept on top of the margin.
//!
//! Contract: pure; no allocation after construction; bounded work per call and a bounded number of calls per
//! way. A pair that begins nearer than the margin may not come nearer than it begins, one that ends near it
//! may come as near as that. *Source*: conservative advancement, Mirtich 1996, section 2.3.

use crate::arm::chain::Chain;
use crate::clearance::watch::Watch;
use crate::clearance::{Clearance, Kinematics};

/// Shortest way that any body goes between two looks \[m\], by the levers, which are more than it really
/// goes.
const STEP_M: f64 = 1e-3;
/// Most looks along one way.
const LOOKS: f64 = 1000.0;
/// Kept on top of the margin, so that rows that damp closing speeds leave some on the whole way \[m\].
pub const MORE_M: f64 = 1e-3;
/// A pair that begins nearer may come nearer by rounding only \[m\].
const ROUNDING_M: f64 = 1e-6;

/// What stands in the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstructed {
    /// Number of the pair, see [`Clearance::pair_names`].
    pub pair: u16,
    /// Where on the way, 0 to 1.
    pub share: f64,
    /// How near they would come there \[m\]; negative where they overlap.
    pub distance_m: f64,
}

/// What a look along a way found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Looked {
    /// Nothing so far.
    SoFar,
    /// Nothing on the whole way.
    Clear,
    /// Something.
    Blocked(Obstructed),
}

/// A way, and how far it was looked along.
#[derive(Debug, Clone)]
pub struct Way<const J: usize> {
    from: [f64; J],
    to: [f64; J],
    share: f64,
    /// Per pair, how near it may come \[m\].
    least: Vec<f64>,
    /// The end was looked at, which says how near it may come there.
    end_seen: bool,
}

impl<const J: usize> Way<J> {
    /// Room for the pairs of `clearance`; from zero to zero.
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

    /// Begins to look along the way from `from` to `to` \[rad\].
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
    /// Looks at one more place of `way`. `chain` is the one that this was made for.
    pub fn look_along(&self, chain: &Chain<J>, way: &mut Way<J>) -> Looked {
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
            // Written so that what is no number is in the way.
            if !(more >= 0.0) && nearest.is_none_or(|(worst, _)| !(more >= worst)) {
                let pair = u16::try_from(index).unwrap_or(u16::MAX);
                nearest = Some((more, Obstructed { pair, share: way.share, distance_m }));
            }
            if reach_m > 0.0 {
                next = next.min(more / reach_m);
            }
        }
        if let Some((_, obstructed)) = nearest {
            return Looked::Blocked(obstructed);
        }
        if way.share >= 1.0 {
            return Looked::Clear;
        }
        let shortest = if farthest_m > 0.0 { STEP_M / farthest_m } else { 1.0 };
        way.share = (way.share + next.max(shortest).max(1.0 / LOOKS)).min(1.0);
        Looked::SoFar
    }

    /// An end that keeps the margin is as good as any, even if nothing is left on top.
    fn look_at_end(&self, chain: &Chain<J>, way: &mut Way<J>) -> Looked {
        let kinematics = chain.forward(&way.at(1.0));
        for (pair, least) in self.pairs.iter().zip(&mut way.least) {
            let distance_m = pair.separations(&kinematics, |_| {});
            *least = (distance_m - ROUNDING_M).clamp(self.margin - ROUNDING_M, self.margin + MORE_M);
        }
        way.end_seen = true;
        Looked::SoFar
    }

    /// The same, gaps closing at `share` of the rate at most.
    #[must_use]
    pub fn damped(mut self, share: f64) -> Self {
        self.rate *= share;
        // The copy of a list keeps no room for more.
        self.watch = Watch::new(self.pairs.len());
        self
    }

    /// The part of `qd` \[rad/s\] that keeps every row found last, 1 where it keeps them all.
    pub(crate) fn share_kept(&self, qd: &[f64; J]) -> f64 {
        let kept = self.found.rows().iter().map(|(row, bound)| {
            let speed: f64 = row.iter().zip(qd).map(|(c, v)| c * v).sum();
            // No share of a motion that does not close the gap would open it.
            if speed >= bound || speed >= 0.0 { 1.0 } else { bound.min(0.0) / speed }
        });
        kept.fold(1.0, f64::min)
    }

    /// The smallest distance at `kinematics`, and the pair that has it: without allocation.
    pub(crate) fn nearest_pair(&self, kinematics: &Kinematics<J>) -> Option<(u16, f64)> {
        let all = self.pairs.iter().zip(0_u16..).map(|(pair, n)| (n, pair.separations(kinematics, |_| {})));
        all.min_by(|(_, a), (_, b)| a.total_cmp(b))
    }

    /// What each pair is called, for people: "`forearm_link` and box 2", numbered as in the settings.
    /// Allocates.
    #[must_use]
    pub fn pair_names(&self) -> Vec<String> {
        self.pairs.iter().map(|pair| pair.called()).collect()
    }
}
