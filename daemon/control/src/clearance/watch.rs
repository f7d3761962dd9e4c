//! Which pairs have to be measured in a tick: nearly always none.
//!
//! A pair's row matters only where some velocity of the box breaks it, and that needs
//!
//!   d − margin ≤ Σ_j lever_j x_j + span·k,     x_j = v_j (1 + h s)/ξ,   k = h s²/(2ξ),   s = Σ_j |q̇_j|
//!
//! with v_j the larger of |q̇_j| and the box's fastest: Σ lever_j v_j bounds the closing speed, and the acceleration of two
//! witness points along their normal at q̈ = 0 is at most 2s·Σ lever_j |q̇_j| + s²·span, of which a row holds h/2. Since the
//! distance was measured at q', it has fallen by Σ lever_j |q_j − q'_j| at most. So a pair is measured anew only when
//! what was seen of it last may be used up, wherever q has been in between; jumps of q are covered like motion.
//!
//! Contract: what is skipped has no row, so rows depend on the tick's inputs alone, not on what is remembered. No
//! allocation after construction.

use crate::arm::limits::{JointMotion, VelocityBox};
use crate::clearance::pairs::Pair;

/// What rounding may take off a distance [m].
const ROUNDING_M: f64 = 1e-9;

/// How far one tick reaches.
pub(super) struct Reach<const J: usize> {
    /// x, per joint [rad].
    angle: [f64; J],
    /// k [1].
    turn: f64,
}

impl<const J: usize> Reach<J> {
    /// Of a step of `elapsed` [s] inside `allowed`, where gaps may close by `rate` [1/s].
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

/// The distance of a pair when it was last measured [m], and where the arm was [rad].
#[derive(Debug, Clone, Copy)]
struct Seen<const J: usize> {
    q: [f64; J],
    distance: f64,
}

/// What is remembered of all pairs.
#[derive(Debug, Clone)]
pub(super) struct Watch<const J: usize> {
    seen: Vec<Seen<J>>,
    /// Pairs that are looked at in every tick, in order.
    near: Vec<usize>,
    /// All others, at once: max over them of lever_j / (gap at `since`) [1/rad], and of span / gap [1].
    levers: [f64; J],
    span: f64,
    since: [f64; J],
    swept: bool,
}

impl<const J: usize> Watch<J> {
    /// A pair stays among the far ones while it reaches over no more than this part of its gap: then one look at all holds.
    const SHARE: f64 = 1.0 / (J as f64 + 4.0);

    /// Nothing seen yet of `count` pairs.
    pub(super) fn new(count: usize) -> Self {
        Self {
            seen: vec![Seen { q: [0.0; J], distance: f64::NEG_INFINITY }; count],
            near: Vec::with_capacity(count),
            levers: [0.0; J],
            span: 0.0,
            since: [0.0; J],
            swept: false,
        }
    }

    /// Calls `measure` with every pair, in order, that may have a row at `q`, and with the gap above the margin [m] from which
    /// on it has none; it returns the pair's distance [m].
    pub(super) fn look(
        &mut self,
        pairs: &[Pair<J>],
        q: &[f64; J],
        reach: &Reach<J>,
        margin: f64,
        mut measure: impl FnMut(&Pair<J>, f64) -> f64,
    ) {
        let far = dot_moved(&self.levers, q, &self.since, &reach.angle) + self.span * reach.turn;
        if self.swept && far < 1.0 {
            for index in &self.near {
                if let (Some(pair), Some(seen)) = (pairs.get(*index), self.seen.get_mut(*index)) {
                    let wanted = dot_moved(&pair.levers, q, &seen.q, &reach.angle) + pair.span * reach.turn;
                    if !(wanted < seen.distance - margin - ROUNDING_M) {
                        let wanted = dot(&pair.levers, &reach.angle) + pair.span * reach.turn;
                        *seen = Seen { q: *q, distance: measure(pair, wanted + ROUNDING_M) };
                    }
                }
            }
            return;
        }
        self.near.clear();
        (self.levers, self.span, self.since, self.swept) = ([0.0; J], 0.0, *q, true);
        for (index, (pair, seen)) in pairs.iter().zip(&mut self.seen).enumerate() {
            let wanted = dot(&pair.levers, &reach.angle) + pair.span * reach.turn;
            let gap = |seen: &Seen<J>| {
                seen.distance - margin - ROUNDING_M - dot_moved(&pair.levers, q, &seen.q, &[0.0; J])
            };
            let mut left = gap(seen);
            if !(wanted < left * Self::SHARE) {
                *seen = Seen { q: *q, distance: measure(pair, wanted + ROUNDING_M) };
                left = gap(seen);
            }
            if wanted < left * Self::SHARE {
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
