//! Expert selection: exponential weights with fixed share, per lead, on realised position errors.
//!
//! w_e ← w_e · exp(−η_h · min(ℓ_e/ℓ̄, cap)), η_h = η (1 + NEAR/h) at lead h, normalised, then mixed with a
//! little of the equal weights so that an expert that was wrong for long can recover within steps. ℓ_e =
//! squared error of the summed displacement; ℓ̄ = running mean of the mixture's own, which makes the rule
//! independent of units, speed and lead. Source: Herbster & Warmuth 1998, "Tracking the best expert".

use crate::predict::models::mixture::{EXPERTS, LEADS, NODE_COUNT, NODES, NodePath};

const KEPT: usize = LEADS + 1;

/// How weights follow errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MixerRule {
    /// η per mean error.
    pub(super) rate: f64,
    /// Share of the weight that is redistributed at every step.
    pub(super) share: f64,
    /// Largest loss in mean errors.
    pub(super) cap: f64,
}

/// Predictions whose outcome is pending.
#[derive(Debug, Clone)]
pub(super) struct Mixer {
    rule: MixerRule,
    /// Experts that take part.
    taking_part: [bool; EXPERTS],
    pending: Box<[[NodePath; EXPERTS]]>,
    newest: usize,
    seen: usize,
    /// ℓ̄ per node \[in the plane, squared\].
    mean: [f64; NODE_COUNT],
}

/// ℓ̄ before the first error, one step ahead \[in the plane, squared\]; grows with the square of the lead.
const FIRST_MEAN: f64 = 4.0;
/// Lower bound of ℓ̄ [in the plane, squared]: errors of a resting pen carry no information.
const LEAST_MEAN: f64 = 1e-6;
/// Rate at which ℓ̄ follows an error.
const MEAN_RATE: f64 = 0.003;
/// Cap of one error in ℓ̄, as a multiple of ℓ̄.
const MEAN_CAP: f64 = 10.0;

impl Mixer {
    pub(super) fn new(rule: MixerRule, taking_part: [bool; EXPERTS]) -> Self {
        let pending = vec![[[[0.0; 2]; NODE_COUNT]; EXPERTS]; KEPT].into();
        let mean = NODES.map(|node| FIRST_MEAN * (node * node) as f64);
        Self { rule, taking_part, pending, newest: 0, seen: 0, mean }
    }

    /// Pending predictions have no outcome.
    pub(super) fn interrupt(&mut self) {
        self.seen = 0;
    }

    /// Forgets the size of errors.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.rule, self.taking_part);
    }

    /// Judges predictions whose outcome is known; `shown[h − 1]` = the sum of the last h displacements.
    pub(super) fn resolve(&mut self, shares: &mut [[f32; EXPERTS]; NODE_COUNT], shown: &[[f64; 2]; LEADS]) {
        let nodes = NODES.iter().zip(shares).zip(&mut self.mean).enumerate();
        for (node, ((lead, shares), mean)) in nodes {
            if *lead > self.seen {
                return;
            }
            let slot = (self.newest + KEPT + 1 - lead) % KEPT;
            let (Some(paths), Some([sx, sy])) = (self.pending.get(slot), shown.get(lead - 1)) else {
                return;
            };
            let mut losses = [0.0; EXPERTS];
            let mut own = [0.0; 2];
            for ((loss, path), share) in losses.iter_mut().zip(paths).zip(shares.iter()) {
                let [x, y] = path.get(node).copied().unwrap_or_default();
                let (ex, ey) = (x - sx, y - sy);
                *loss = ex * ex + ey * ey;
                if *share > 0.0 {
                    own[0] += f64::from(*share) * ex;
                    own[1] += f64::from(*share) * ey;
                }
            }
            let own = own[0] * own[0] + own[1] * own[1];
            if own.is_finite() {
                *mean += MEAN_RATE * (own.min(MEAN_CAP * *mean) - *mean);
            }
            self.rule.reweigh(*lead, shares, &losses, mean.max(LEAST_MEAN), &self.taking_part);
        }
    }

    /// Keeps a step's predictions until their outcome is known.
    pub(super) fn keep(&mut self, paths: &[NodePath; EXPERTS]) {
        self.newest = (self.newest + 1) % KEPT;
        self.seen = (self.seen + 1).min(KEPT);
        if let Some(slot) = self.pending.get_mut(self.newest) {
            *slot = *paths;
        }
    }
}

/// Factor by which weights of the next step adapt faster than those of far leads.
const NEAR: f64 = 3.0;

impl MixerRule {
    fn reweigh(
        &self,
        lead: usize,
        shares: &mut [f32; EXPERTS],
        losses: &[f64; EXPERTS],
        mean: f64,
        taking_part: &[bool; EXPERTS],
    ) {
        // Errors of far leads overlap from step to step, so each carries less information.
        let rate = self.rate * (1.0 + NEAR / lead as f64);
        let mut weighed = [0.0; EXPERTS];
        let entries = weighed.iter_mut().zip(shares.iter()).zip(losses).zip(taking_part);
        for (((weighed, share), loss), _) in entries.filter(|(_, takes)| **takes) {
            // A NaN loss counts as the largest.
            let bounded = if *loss < self.cap * mean { *loss / mean } else { self.cap };
            *weighed = f64::from(*share) * (-rate * bounded).exp();
        }
        let total: f64 = weighed.iter().sum();
        if !(total > 0.0) {
            return;
        }
        let dealt = self.share / taking_part.iter().filter(|takes| **takes).count() as f64;
        for ((share, weighed), _) in shares.iter_mut().zip(weighed).zip(taking_part).filter(|(_, t)| **t) {
            *share = ((1.0 - self.share) * weighed / total + dealt) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    const RULE: MixerRule = MixerRule { rate: 0.3, share: 0.02, cap: 6.0 };
    /// The last expert does not take part.
    const PART: usize = EXPERTS - 1;

    /// Against the module's formula, computed from all predictions made.
    #[test]
    fn weights_follow_the_errors_of_what_was_predicted_for_now() {
        let mut rng = Pcg64::seed_from_u64(21);
        let mut mixer = Mixer::new(RULE, std::array::from_fn(|e| e < PART));
        let even = std::array::from_fn(|e| if e < PART { 1.0 / PART as f32 } else { 0.0 });
        let (mut shares, mut expected) = ([even; NODE_COUNT], [even; NODE_COUNT]);
        let mut means = NODES.map(|node| 4.0 * (node * node) as f64);
        let (mut kept, mut walked): (Vec<[NodePath; EXPERTS]>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
        for k in 0..150 {
            walked.push([rng.random_range(5.0..15.0), rng.random_range(-10.0..10.0)]);
            let last = |steps: usize| {
                let way = walked.iter().rev().take(steps);
                way.fold([0.0, 0.0], |[x, y], [dx, dy]| [x + dx, y + dy])
            };
            let shown = std::array::from_fn(|h| last(h + 1));
            mixer.resolve(&mut shares, &shown);
            for (node, lead) in NODES.into_iter().enumerate() {
                let Some(made) = kept.len().checked_sub(lead) else { continue };
                let [sx, sy] = last(lead);
                let errors = kept[made].map(|path| [path[node][0] - sx, path[node][1] - sy]);
                let own = |i: usize| {
                    let all = errors.iter().zip(&expected[node]).filter(|(_, share)| **share > 0.0);
                    all.map(|(error, share)| f64::from(*share) * error[i]).sum::<f64>()
                };
                let own = own(0) * own(0) + own(1) * own(1);
                if own.is_finite() {
                    means[node] += 0.003 * (own.min(10.0 * means[node]) - means[node]);
                }
                let rate = RULE.rate * (1.0 + 3.0 / lead as f64);
                let weighed: [f64; EXPERTS] = std::array::from_fn(|e| {
                    let [x, y] = errors[e];
                    let loss = (x * x + y * y) / means[node];
                    let bounded = if loss.is_nan() { RULE.cap } else { loss.min(RULE.cap) };
                    if e < PART { f64::from(expected[node][e]) * (-rate * bounded).exp() } else { 0.0 }
                });
                let total: f64 = weighed.iter().sum();
                for (share, weighed) in expected[node].iter_mut().zip(weighed).take(PART) {
                    *share = (0.98 * weighed / total + 0.02 / PART as f64) as f32;
                }
            }
            for (found, expected) in shares.as_flattened().iter().zip(expected.as_flattened()) {
                assert!((found - expected).abs() < 1e-5, "{k}: {found} {expected}");
            }
            // Experts whose error grows with their number; sometimes one is NaN.
            let paths: [NodePath; EXPERTS] = std::array::from_fn(|e| {
                NODES.map(|node| {
                    let size = (e + 1) as f64 * node as f64;
                    let bad = if k % 17 == 0 && e == 1 { f64::NAN } else { 0.0 };
                    let mut off = |ahead: f64| ahead * node as f64 + bad + size * rng.random_range(-1.0..1.0);
                    [off(10.0), off(0.0)]
                })
            });
            mixer.keep(&paths);
            kept.push(paths);
        }
        for shares in shares {
            assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-5 && shares[PART] == 0.0);
            assert!(shares.iter().any(|share| *share > 1.5 / PART as f32), "none is preferred: {shares:?}");
        }
    }
}
