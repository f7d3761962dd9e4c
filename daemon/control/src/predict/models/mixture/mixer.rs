//! Whom to believe: exponential weights with fixed share, per lead, on realised position errors.
//!
//! w_e ← w_e · exp(−η_h · min(ℓ_e/ℓ̄, cap)), η_h = η (1 + NEAR/h) at lead h, normalised, then mixed with a little of the
//! equal weights so that an expert that was wrong for long can come back within steps. ℓ_e = squared error of the summed
//! displacement; ℓ̄ = running mean of the mixture's own, so that units, speeds and leads do not matter.
//! Source: Herbster & Warmuth 1998, "Tracking the best expert".

use crate::predict::models::mixture::{EXPERTS, LEADS, NODE_COUNT, NODES, Path};

const KEPT: usize = LEADS + 1;

/// How weights follow errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MixerRule {
    /// η per mean error.
    pub(super) rate: f64,
    /// Part of the weight that is dealt out anew at every step.
    pub(super) share: f64,
    /// Largest loss in mean errors.
    pub(super) cap: f64,
}

/// Predictions that wait for their future.
#[derive(Debug, Clone)]
pub(super) struct Mixer {
    rule: MixerRule,
    /// Experts that take part.
    taking_part: usize,
    pending: Box<[[Path; EXPERTS]]>,
    newest: usize,
    seen: usize,
    /// ℓ̄ per node [in the plane, squared].
    mean: [f64; NODE_COUNT],
}

/// ℓ̄ before the first error, one step ahead [in the plane, squared]; farther ahead with the square of the lead.
const FIRST_MEAN: f64 = 4.0;
/// ℓ̄ counts as no less than this [in the plane, squared]: errors of a pen that rests say nothing.
const LEAST_MEAN: f64 = 1e-6;
/// Part of the way by which ℓ̄ follows one error.
const MEAN_RATE: f64 = 0.003;
/// One error counts as at most this many mean ones in ℓ̄.
const MEAN_CAP: f64 = 10.0;

impl Mixer {
    pub(super) fn new(rule: MixerRule, taking_part: usize) -> Self {
        let pending = vec![[[[0.0; 2]; NODE_COUNT]; EXPERTS]; KEPT].into();
        let mean = NODES.map(|node| FIRST_MEAN * (node * node) as f64);
        Self { rule, taking_part, pending, newest: 0, seen: 0, mean }
    }

    /// What waits will not see its future.
    pub(super) fn interrupt(&mut self) {
        self.seen = 0;
    }

    /// Forgets how large errors are.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.rule, self.taking_part);
    }

    /// Judges predictions whose future is known; `shown[h − 1]` = the sum of the last h displacements.
    pub(super) fn settle(&mut self, shares: &mut [[f32; EXPERTS]; NODE_COUNT], shown: &[[f64; 2]; LEADS]) {
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
            self.rule.reweigh(*lead, shares, &losses, mean.max(LEAST_MEAN), self.taking_part);
        }
    }

    /// Keeps a step's predictions until their future is seen.
    pub(super) fn keep(&mut self, paths: &[Path; EXPERTS]) {
        self.newest = (self.newest + 1) % KEPT;
        self.seen = (self.seen + 1).min(KEPT);
        if let Some(slot) = self.pending.get_mut(self.newest) {
            *slot = *paths;
        }
    }
}

/// How much faster the next step's weights follow than those of far leads.
const NEAR: f64 = 3.0;

impl MixerRule {
    fn reweigh(
        &self,
        lead: usize,
        shares: &mut [f32; EXPERTS],
        losses: &[f64; EXPERTS],
        mean: f64,
        taking_part: usize,
    ) {
        // Errors of far leads overlap from step to step: one of them says less that is new.
        let rate = self.rate * (1.0 + NEAR / lead as f64);
        let mut weighed = [0.0; EXPERTS];
        let entries = weighed.iter_mut().zip(shares.iter()).zip(losses).take(taking_part);
        for ((weighed, share), loss) in entries {
            // A loss that is NaN is as bad as can be.
            let bounded = if *loss < self.cap * mean { *loss / mean } else { self.cap };
            *weighed = f64::from(*share) * (-rate * bounded).exp();
        }
        let total: f64 = weighed.iter().sum();
        if !(total > 0.0) {
            return;
        }
        let dealt = self.share / taking_part as f64;
        for (share, weighed) in shares.iter_mut().zip(weighed).take(taking_part) {
            *share = ((1.0 - self.share) * weighed / total + dealt) as f32;
        }
    }
}
