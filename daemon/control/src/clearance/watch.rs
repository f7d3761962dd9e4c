//! Which pairs must be measured in a tick: usually none.
//!
//! A pair's row matters only where some velocity in the box violates it, which requires
//!
//!   d − margin ≤ Σ_j lever_j x_j + span·k,     x_j = v_j (1 + h s)/ξ,   k = h s²/(2ξ),   s = Σ_j |q̇_j|
//!
//! with v_j the larger of |q̇_j| and the box's fastest: Σ lever_j v_j bounds the closing speed, and the
//! acceleration of two witness points along their normal at q̈ = 0 is at most 2s·Σ lever_j |q̇_j| + s²·span,
//! of which a row contains h/2. Since the distance was measured at q', it has decreased by at most Σ lever_j
//! |q_j − q'_j|. So a pair is measured again only when its last known gap may be used up, whatever q was in
//! between; jumps of q are covered like motion.
//!
//! Contract: a skipped pair has no row, so rows depend on the tick's inputs alone, not on the memory. No
//! allocation after construction.

use crate::arm::limits::{JointMotion, VelocityBox};
use crate::clearance::pairs::Pair;
use crate::state::state;

/// Rounding of a distance \[m\].
const ROUNDING_M: f64 = 1e-9;

/// How far one tick can move the arm.
pub(super) struct Reach<const J: usize> {
    /// x, per joint \[rad\].
    angle: [f64; J],
    /// k \[1\].
    turn: f64,
}

impl<const J: usize> Reach<J> {
    /// Of a step of `elapsed` \[s\] inside `allowed`, where gaps may close by `rate` \[1/s\].
    pub(super) fn new(motion: &JointMotion<J>, allowed: &VelocityBox<J>, elapsed: f64, rate: f64) -> Self {
        let sum: f64 = motion.qd.iter().map(|v| v.abs()).sum();
        let factor = (1.0 + elapsed * sum) / rate;
        let mut angle = motion.qd.map(f64::abs);
        for (x, (low, high)) in angle.iter_mut().zip(allowed.lower.iter().zip(&allowed.upper)) {
            *x = x.max(low.abs()).max(high.abs()) * factor;
        }
        Self { angle, turn: 0.5 * elapsed * sum * sum / rate }
    }
}

/// The distance of a pair when it was last measured \[m\], and where the arm was \[rad\].
#[derive(Debug, Clone, Copy)]
struct PairDistance<const J: usize> {
    q: [f64; J],
    distance: f64,
}

state! { whole [const J: usize] PairDistance<J> { q, distance } }

/// What is remembered of all pairs, by the bodies that they are about.
#[derive(Debug, Clone)]
pub(super) struct PairWatch<const J: usize> {
    groups: Box<[PairGroup<J>]>,
}

state! { [const J: usize] PairWatch<J> { groups } }

/// What is remembered of the pairs of two bodies, whose levers are much alike: one check covers nearly all.
#[derive(Debug, Clone)]
struct PairGroup<const J: usize> {
    seen: Vec<PairDistance<J>>,
    /// Pairs that are checked in every tick, in order.
    near: Vec<usize>,
    /// All others, checked together: max over them of lever_j / (gap at `since`) \[1/rad\], and of span / gap
    /// \[1\].
    levers: [f64; J],
    span: f64,
    since: [f64; J],
    swept: bool,
}

state! { [const J: usize] PairGroup<J> { seen, near, levers, span, since, swept } }

/// A pair stays among the far ones while the tick's motion uses no more than this fraction of its gap; the
/// rest is for the motion until they are looked at again.
const SHARE: f64 = 0.3;

impl<const J: usize> PairWatch<J> {
    /// Nothing seen yet of `pairs`, of which those of two bodies stand together.
    pub(super) fn new(pairs: &[Pair<J>]) -> Self {
        let groups = pairs.chunk_by(|a, b| a.bodies() == b.bodies());
        Self { groups: groups.map(|pairs| PairGroup::new(pairs.len())).collect() }
    }

    /// Calls `measure` with every pair of those that it was made for, in order, that may have a row at `q`,
    /// and with the gap above the margin \[m\] beyond which it has none; `measure` returns the pair's
    /// distance \[m\].
    pub(super) fn look(
        &mut self,
        pairs: &[Pair<J>],
        q: &[f64; J],
        reach: &Reach<J>,
        margin: f64,
        mut measure: impl FnMut(&Pair<J>, f64) -> f64,
    ) {
        let mut rest = pairs;
        for group in &mut self.groups {
            let (pairs, others) = rest.split_at_checked(group.seen.len()).unwrap_or((rest, &[]));
            rest = others;
            group.look(pairs, q, reach, margin, &mut measure);
        }
    }
}

impl<const J: usize> PairGroup<J> {
    fn new(count: usize) -> Self {
        Self {
            seen: vec![PairDistance { q: [0.0; J], distance: f64::NEG_INFINITY }; count],
            near: Vec::with_capacity(count),
            levers: [0.0; J],
            span: 0.0,
            since: [0.0; J],
            swept: false,
        }
    }

    /// See [`PairWatch::look`].
    fn look(
        &mut self,
        pairs: &[Pair<J>],
        q: &[f64; J],
        reach: &Reach<J>,
        margin: f64,
        measure: &mut impl FnMut(&Pair<J>, f64) -> f64,
    ) {
        let far = dot_moved(&self.levers, q, &self.since, &reach.angle) + self.span * reach.turn;
        if self.swept && far < 1.0 {
            for index in &self.near {
                if let (Some(pair), Some(seen)) = (pairs.get(*index), self.seen.get_mut(*index)) {
                    let wanted = dot_moved(&pair.levers, q, &seen.q, &reach.angle) + pair.span * reach.turn;
                    if !(wanted < seen.distance - margin - ROUNDING_M) {
                        let wanted = dot(&pair.levers, &reach.angle) + pair.span * reach.turn;
                        *seen = PairDistance { q: *q, distance: measure(pair, wanted + ROUNDING_M) };
                    }
                }
            }
            return;
        }
        self.near.clear();
        (self.levers, self.span, self.since, self.swept) = ([0.0; J], 0.0, *q, true);
        for (index, (pair, seen)) in pairs.iter().zip(&mut self.seen).enumerate() {
            let wanted = dot(&pair.levers, &reach.angle) + pair.span * reach.turn;
            let gap = |seen: &PairDistance<J>| {
                seen.distance - margin - ROUNDING_M - dot_moved(&pair.levers, q, &seen.q, &[0.0; J])
            };
            let mut left = gap(seen);
            if !(wanted < left * SHARE) {
                *seen = PairDistance { q: *q, distance: measure(pair, wanted + ROUNDING_M) };
                left = gap(seen);
            }
            if wanted < left * SHARE {
                let most = self.levers.iter_mut().zip(&pair.levers);
                most.for_each(|(most, lever)| *most = most.max(lever / left));
                self.span = self.span.max(pair.span / left);
            } else {
                self.near.push(index);
            }
        }
    }
}

/// Σ lever_j (|q_j − from_j| + x_j)
fn dot_moved<const J: usize>(levers: &[f64; J], q: &[f64; J], from: &[f64; J], x: &[f64; J]) -> f64 {
    let moved = q.iter().zip(from).zip(x).map(|((q, from), x)| (q - from).abs() + x);
    levers.iter().zip(moved).map(|(lever, moved)| lever * moved).sum()
}

fn dot<const J: usize>(a: &[f64; J], b: &[f64; J]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::arm::{Chain, JointLimits};
    use crate::clearance::{Obstacle, pairs};

    const UR5: &str = include_str!("../../../../config/robots/ur5.urdf");
    const MARGIN_M: f64 = 0.01;
    const STEP_S: f64 = 0.002;
    const RATE_HZ: f64 = 4.0;

    fn all_pairs() -> Vec<Pair<6>> {
        let chain = Chain::from_urdf(UR5, None, None).unwrap();
        let ends = chain.limits();
        let limits = JointLimits::new(ends.position, ends.velocity, [40.0; 6]).unwrap();
        let mut all = pairs::with_obstacles(&chain, &[Obstacle::plane([0.0; 3], [0.0, 0.0, 1.0]).unwrap()]);
        all.extend(pairs::of_itself(&chain, &limits));
        all.sort_by_key(Pair::bodies);
        assert!(all.len() > 10 && all.iter().any(|pair| pair.span > 0.0));
        all
    }

    fn motion(rng: &mut Pcg64, speed: f64) -> (JointMotion<6>, VelocityBox<6>) {
        let mut motion = JointMotion::at_rest([0.7; 6]);
        motion.qd = std::array::from_fn(|_| speed * rng.random_range(-1.0..1.0));
        let allowed = VelocityBox { lower: motion.qd.map(|v| v - 0.08), upper: motion.qd.map(|v| v + 0.08) };
        (motion, allowed)
    }

    /// The right-hand side of the module's inequality: a pair with a larger gap has no row \[m\].
    fn wanted(pair: &Pair<6>, motion: &JointMotion<6>, allowed: &VelocityBox<6>) -> f64 {
        let s: f64 = motion.qd.iter().map(|v| v.abs()).sum();
        let closing: f64 = (0..6)
            .map(|j| {
                let fastest = motion.qd[j].abs().max(allowed.lower[j].abs()).max(allowed.upper[j].abs());
                pair.levers[j] * fastest * (1.0 + STEP_S * s) / RATE_HZ
            })
            .sum();
        closing + pair.span * STEP_S * s * s / (2.0 * RATE_HZ)
    }

    /// Pairs that are measured in one call, with the gap that was asked for.
    fn looked(
        watch: &mut PairWatch<6>,
        pairs: &[Pair<6>],
        motion: &JointMotion<6>,
        allowed: &VelocityBox<6>,
        distances: &[f64],
    ) -> Vec<Option<f64>> {
        let reach = Reach::new(motion, allowed, STEP_S, RATE_HZ);
        let mut measured = vec![None; pairs.len()];
        watch.look(pairs, &motion.q, &reach, MARGIN_M, |pair, enough| {
            let index = pairs.iter().position(|other| std::ptr::eq(other, pair)).unwrap();
            measured[index] = Some(enough);
            distances[index]
        });
        measured
    }

    #[test]
    fn what_stands_still_is_measured_again_only_where_it_may_have_a_row() {
        let (pairs, mut rng) = (all_pairs(), Pcg64::seed_from_u64(3));
        for speed in [0.0, 0.1, 2.0, 15.0] {
            let (motion, allowed) = motion(&mut rng, speed);
            let needed: Vec<f64> = pairs.iter().map(|pair| wanted(pair, &motion, &allowed)).collect();
            for share in [0.0, 0.99, 1.01, 3.0, 9.0, 11.0, 1000.0] {
                let mut watch = PairWatch::new(&pairs);
                let distances: Vec<f64> = needed.iter().map(|needed| MARGIN_M + share * needed).collect();
                let first = looked(&mut watch, &pairs, &motion, &allowed, &distances);
                for (enough, needed) in first.iter().zip(&needed) {
                    let enough = enough.expect("nothing was seen before");
                    assert!((enough - needed).abs() < 2.0 * ROUNDING_M, "{enough} {needed}");
                }
                let again = looked(&mut watch, &pairs, &motion, &allowed, &distances);
                assert!(again.iter().all(|seen| seen.is_some() == (share < 1.0)), "{speed} {share}");
                for (enough, needed) in
                    again.iter().zip(&needed).filter_map(|(enough, n)| Some((enough.as_ref()?, n)))
                {
                    assert!((enough - needed).abs() < 2.0 * ROUNDING_M, "{enough} {needed}");
                }
            }
        }
    }

    /// Distances change as fast as the levers allow: no pair that may have a row is skipped, and nearly all
    /// others are.
    #[test]
    fn nothing_comes_near_unseen() {
        let (pairs, mut rng) = (all_pairs(), Pcg64::seed_from_u64(4));
        let base: Vec<f64> = pairs.iter().map(|_| rng.random_range(0.3..3.0)).collect();
        let mut watch = PairWatch::new(&pairs);
        let (mut near, mut measured, mut all) = (0, 0, 0);
        let mut q = [0.0; 6];
        for tick in 0..5000 {
            let (mut motion, allowed) = motion(&mut rng, [0.02, 0.3, 2.0, 15.0][tick / 50 % 4]);
            q = std::array::from_fn(|j| q[j] + STEP_S * motion.qd[j]);
            if tick % 100 == 0 {
                q = std::array::from_fn(|_| rng.random_range(-0.3..0.3));
            }
            motion.q = q;
            let distances: Vec<f64> = pairs
                .iter()
                .zip(&base)
                .map(|(pair, base)| base - (0..6).map(|j| pair.levers[j] * q[j].abs()).sum::<f64>())
                .collect();
            let seen = looked(&mut watch, &pairs, &motion, &allowed, &distances);
            for ((pair, distance), seen) in pairs.iter().zip(&distances).zip(seen) {
                let needs = distance - MARGIN_M <= wanted(pair, &motion, &allowed);
                assert!(seen.is_some() || !needs, "{tick}: {distance} m");
                near += usize::from(needs);
                measured += usize::from(seen.is_some());
                all += 1;
            }
        }
        assert!(near > all / 50 && near < all / 2, "{near} of {all}");
        assert!(measured - near < (all - near) / 100, "{measured} measured, {near} of {all} near");
    }

    /// What was far when it was seen may have come near by as much as levers let it: it is looked at again.
    #[test]
    fn what_was_seen_from_elsewhere_is_worth_less_by_the_way_there() {
        let (pairs, mut rng) = (all_pairs(), Pcg64::seed_from_u64(5));
        let (motion, allowed) = motion(&mut rng, 0.02);
        let moved = [1.0; 6];
        let way = |pair: &Pair<6>| pair.levers.iter().sum::<f64>();
        for extra in [0.0, 1e-3] {
            let mut watch = PairWatch::new(&pairs);
            let distances: Vec<f64> = pairs.iter().map(|pair| MARGIN_M + extra + way(pair)).collect();
            looked(&mut watch, &pairs, &motion, &allowed, &distances);
            let there = JointMotion { q: std::array::from_fn(|j| motion.q[j] + moved[j]), ..motion };
            let again = looked(&mut watch, &pairs, &there, &allowed, &distances);
            for (pair, seen) in pairs.iter().zip(again) {
                assert!(seen.is_some() || extra > wanted(pair, &there, &allowed), "{extra}: {}", way(pair));
            }
        }
    }
}
