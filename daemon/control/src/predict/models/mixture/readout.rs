//! A linear read-out of features for all nodes, and its recursive least squares.
//!
//! One covariance serves all leads: the gain k_t = P φ_t/(λ + φ_tᵀ P φ_t) depends on features only, so it is
//! computed at t, kept, and applied to the row of lead h at t + h, when the target is known. For every lead
//! this is exact recursive least squares in order of time, delayed by its own lead only.

use crate::predict::models::covariance::Covariance;
use crate::predict::models::foresight::turned;
use crate::predict::models::mixture::{LEADS, NODE_COUNT, NODES, NodePath};
use crate::state::state;

/// Two numbers per node.
const OUTPUTS: usize = 2 * NODE_COUNT;
/// Steps kept: the newest and those whose farthest lead is pending.
const KEPT: usize = LEADS + 1;
/// Rate at which the typical error follows an error.
const TYPICAL_RATE: f64 = 0.005;
/// The typical error before the first, one step ahead \[in the plane\]; proportional to the lead.
const FIRST_TYPICAL: f64 = 1.0;
/// Cap of one error in the typical one, as a multiple of it.
const TYPICAL_CAP: f64 = 3.0;

/// W, D x OUTPUTS; single precision, to halve the memory traffic and the hand-over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NodeReadout<const D: usize> {
    pub(super) rows: [[f32; OUTPUTS]; D],
}

state! { [const D: usize] NodeReadout<D> { rows } }

impl<const D: usize> NodeReadout<D> {
    pub(super) const ZERO: Self = Self { rows: [[0.0; OUTPUTS]; D] };

    /// φᵀ W, per node \[per axis\].
    pub(super) fn of(&self, features: &[f32; D]) -> NodePath {
        let mut sums = [0.0_f32; OUTPUTS];
        for (row, feature) in self.rows.iter().zip(features) {
            for (sum, w) in sums.iter_mut().zip(row) {
                *sum += *w * *feature;
            }
        }
        let mut path = [[0.0; 2]; NODE_COUNT];
        for (out, sum) in path.as_flattened_mut().iter_mut().zip(sums) {
            *out = f64::from(sum);
        }
        path
    }

    /// The read-out's output at one node.
    fn at(&self, node: usize, features: &[f32; D]) -> [f64; 2] {
        let [mut x, mut y] = [0.0_f32; 2];
        for (row, feature) in self.rows.iter().zip(features) {
            if let Some([a, b]) = row.as_chunks::<2>().0.get(node) {
                x += a * feature;
                y += b * feature;
            }
        }
        [f64::from(x), f64::from(y)]
    }

    fn correct(&mut self, node: usize, gain: &[f32; D], error: [f64; 2]) {
        let [ex, ey] = error.map(|e| e as f32);
        for (row, k) in self.rows.iter_mut().zip(gain) {
            if let Some([a, b]) = row.as_chunks_mut::<2>().0.get_mut(node) {
                *a += k * ex;
                *b += k * ey;
            }
        }
    }

    pub(super) fn numbers(&self) -> impl Iterator<Item = f64> + '_ {
        self.rows.as_flattened().iter().map(|w| f64::from(*w))
    }
}

/// The frame of the plane itself.
pub(super) const PLANE: [f64; 2] = [1.0, 0.0];

/// How a read-out learns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RlsRule {
    /// λ, the forgetting per step.
    pub(super) forgetting: f64,
    /// P₀ = start·I, the covariance at start.
    pub(super) start: f64,
    /// P forgets while its mean diagonal is below this many P₀.
    pub(super) ceiling: f64,
    /// Errors beyond this many typical ones are clipped.
    pub(super) huber: f64,
}

#[derive(Debug, Clone, Copy)]
struct Pending<const D: usize> {
    features: [f32; D],
    gain: [f32; D],
    base: NodePath,
    frame: [f64; 2],
}

/// A read-out that learns.
#[derive(Debug, Clone)]
pub(super) struct RlsReadout<const D: usize> {
    rule: RlsRule,
    covariance: Box<Covariance<D>>,
    /// Ring; `newest` is where the last step stands.
    pending: Box<[Pending<D>]>,
    newest: usize,
    /// Steps seen since the last interruption, at most KEPT.
    seen: usize,
    /// Typical error per node \[in the plane\].
    typical: [f64; NODE_COUNT],
}

impl<const D: usize> RlsReadout<D> {
    pub(super) fn new(rule: RlsRule) -> Self {
        let empty =
            Pending { features: [0.0; D], gain: [0.0; D], base: [[0.0; 2]; NODE_COUNT], frame: PLANE };
        Self {
            rule,
            covariance: Box::new(Covariance::new(rule.start, rule.ceiling)),
            pending: vec![empty; KEPT].into(),
            newest: 0,
            seen: 0,
            typical: NODES.map(|node| FIRST_TYPICAL * node as f64),
        }
    }

    /// Pending steps have no outcome.
    pub(super) fn interrupt(&mut self) {
        self.seen = 0;
    }

    /// Resets the covariance of the features.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.rule);
    }

    /// Corrects `readout` by targets that are now known; `shown[h − 1]` = the sum of the last h
    /// displacements.
    pub(super) fn resolve(&mut self, readout: &mut NodeReadout<D>, shown: &[[f64; 2]; LEADS]) {
        for (node, (lead, typical)) in NODES.iter().zip(&mut self.typical).enumerate() {
            if *lead > self.seen {
                return;
            }
            let slot = (self.newest + KEPT + 1 - lead) % KEPT;
            let (Some(pending), Some([sx, sy])) = (self.pending.get(slot), shown.get(lead - 1)) else {
                return;
            };
            let [bx, by] = pending.base.get(node).copied().unwrap_or_default();
            let [wx, wy] = readout.at(node, &pending.features);
            let [rx, ry] = turned(pending.frame, [sx - bx, sy - by]);
            let (ex, ey) = (rx - wx, ry - wy);
            let length = ex.hypot(ey);
            let bound = self.rule.huber * *typical;
            *typical += TYPICAL_RATE * (length.min(TYPICAL_CAP * *typical) - *typical);
            let share = if length <= bound { 1.0 } else { bound / length };
            if share.is_finite() {
                readout.correct(node, &pending.gain, [ex * share, ey * share]);
            }
        }
    }

    /// Keeps a step until its targets are known; the read-out speaks in `frame` (cosine and sine of its x).
    pub(super) fn keep(&mut self, features: &[f32; D], base: NodePath, frame: [f64; 2]) {
        self.newest = (self.newest + 1) % KEPT;
        self.seen = (self.seen + 1).min(KEPT);
        let gain = self.gain(features);
        if let Some(slot) = self.pending.get_mut(self.newest) {
            *slot = Pending { features: *features, gain, base, frame };
        }
    }

    /// k; zero without excitation.
    fn gain(&mut self, features: &[f32; D]) -> [f32; D] {
        let phi = features.map(f64::from);
        if phi.iter().map(|p| p * p).sum::<f64>() <= LEAST_EXCITATION {
            return [0.0; D];
        }
        let gain = self.covariance.update(&phi, self.rule.forgetting);
        gain.map_or([0.0; D], |gain| gain.map(|k| k as f32))
    }
}

/// |φ|² below which features carry no excitation. A pen at rest is learned from: the network's cells keep
/// changing, and their output is corrected.
const LEAST_EXCITATION: f64 = 1e-4;

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: RlsRule = RlsRule { forgetting: 0.99, start: 10.0, ceiling: 1e9, huber: 1e9 };

    /// Features and displacements that are correlated.
    fn step(t: usize) -> ([f32; 3], [f64; 2]) {
        let t = t as f64;
        let phi = [(0.3 * t).sin(), (0.17 * t).cos(), (0.05 * t * t).sin()];
        let next = 0.3 * (t + 1.0);
        (phi.map(|f| f as f32), [2.0 * next.sin(), (0.17 * (t + 1.0)).cos() - next.cos()])
    }

    /// Recursive least squares of one lead as in textbooks, with targets that come `lead` steps late.
    fn textbook(lead: usize, steps: usize) -> [[f64; 2]; 3] {
        let mut p = nalgebra::Matrix3::<f64>::identity() * RULE.start;
        let mut theta = nalgebra::Matrix3x2::<f64>::zeros();
        for t in 0..steps - lead {
            let phi = nalgebra::Vector3::from(step(t).0.map(f64::from));
            let gain = p * phi / (RULE.forgetting + (phi.transpose() * p * phi)[0]);
            p = (p - gain * phi.transpose() * p) / RULE.forgetting;
            let target =
                (t + 1..=t + lead).map(|k| step(k - 1).1).fold([0.0; 2], |[a, b], [x, y]| [a + x, b + y]);
            let error = nalgebra::RowVector2::from(target) - phi.transpose() * theta;
            theta += gain * error;
        }
        std::array::from_fn(|i| [theta[(i, 0)], theta[(i, 1)]])
    }

    #[test]
    fn every_lead_learns_by_recursive_least_squares_of_its_own() {
        const STEPS: usize = 300;
        let mut readout = NodeReadout::<3>::ZERO;
        let mut learner = RlsReadout::new(RULE);
        let mut shown = [[0.0; 2]; LEADS];
        for t in 0..STEPS {
            // The displacement predicted at t − 1 is observed before the features of t.
            if t > 0 {
                let [x, y] = step(t - 1).1;
                shown.rotate_right(1);
                shown[0] = [0.0; 2];
                shown.iter_mut().for_each(|[a, b]| (*a, *b) = (*a + x, *b + y));
                learner.resolve(&mut readout, &shown);
            }
            learner.keep(&step(t).0, [[0.0; 2]; NODE_COUNT], PLANE);
        }
        for (node, lead) in NODES.iter().enumerate() {
            let expected = textbook(*lead, STEPS);
            for (row, expected) in readout.rows.iter().zip(expected) {
                let got = [f64::from(row[2 * node]), f64::from(row[2 * node + 1])];
                for (got, expected) in got.iter().zip(expected) {
                    // Read-outs are kept in single precision.
                    assert!(
                        (got - expected).abs() < 2e-3 * (1.0 + expected.abs()),
                        "lead {lead}: {got} {expected}"
                    );
                }
            }
        }
    }
}
