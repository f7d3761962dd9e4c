//! Error bands of a predictor: the daemon's own calibration ([`Factor`]), scored before it learns.
//!
//! A band is a factor, one per look-ahead time and share, times the pen's recent step. Every prediction
//! updates the factors once its target is known; a prediction made at t is scored by the factors at t. Cases
//! in which the pen rests before and after carry no information and are not learned from.

use foretrace_control::learn::Factor;
use foretrace_control::pen::REST;
use foretrace_control::predict::bands::{level, level_square};

use super::super::scaled::RunningScale;
use super::{LEADS_MS, SHARES};

/// A prediction whose target has not come yet.
#[derive(Debug, Clone, Copy)]
struct PendingBand {
    lead: usize,
    /// The first point at which its target is over.
    due: usize,
    /// Distance of the prediction from the truth \[raw units\]; unknown to the bands until then.
    error: f64,
    /// How far the pen went \[raw units\].
    moved: f64,
    /// Recent step when it was made \[raw units\].
    unit: f64,
    resting: bool,
}

/// Bands of one entrant on one set.
#[derive(Debug, Clone)]
pub(super) struct Bands {
    scale: RunningScale,
    level_square: f64,
    factors: [[Factor; SHARES.len()]; LEADS_MS.len()],
    waiting: Vec<PendingBand>,
}

impl Bands {
    /// Wide initial bands, not given out yet; `steps` of the device to each look-ahead time.
    pub(super) fn untried(steps: impl Fn(usize) -> f64) -> Self {
        let factors = std::array::from_fn(|lead| [Factor::untried(steps(lead).max(1.0)); SHARES.len()]);
        Self { scale: RunningScale::default(), level_square: 0.0, factors, waiting: Vec::new() }
    }

    /// A sequence is over, and with it every target in it.
    pub(super) fn end_sequence(&mut self) {
        self.learn_until(usize::MAX);
        self.level_square = 0.0;
    }

    /// The pen came to `point` by a step of `v`.
    pub(super) fn observe(&mut self, point: usize, v: [f64; 2]) {
        self.learn_until(point);
        self.scale.observe(v);
        let unit = self.scale.raw_per_unit();
        self.level_square = level_square(self.level_square, v.map(|component| component / unit));
    }

    /// Radii \[raw units\] of a prediction made now, once enough is known.
    pub(super) fn at(&self, lead: usize) -> Option<[f64; SHARES.len()]> {
        let [half, most] = self.factors.get(lead)?.each_ref().map(Factor::get);
        Some([half? * self.unit(), most? * self.unit()])
    }

    /// A prediction made now missed by `error` a target that the pen reaches before `due`, `moved` away \[raw
    /// units\].
    pub(super) fn push(&mut self, lead: usize, due: usize, error: f64, moved: f64) {
        let (unit, resting) = (self.unit(), level(self.level_square) <= REST);
        self.waiting.push(PendingBand { lead, due, error, moved, unit, resting });
    }

    fn unit(&self) -> f64 {
        level(self.level_square) * self.scale.raw_per_unit()
    }

    fn learn_until(&mut self, point: usize) {
        let factors = &mut self.factors;
        self.waiting.retain(|case| {
            if case.due > point {
                return true;
            }
            if !(case.resting && case.moved <= case.unit)
                && let Some(factors) = factors.get_mut(case.lead)
            {
                for (factor, share) in factors.iter_mut().zip(SHARES) {
                    factor.judge(case.error / case.unit, share);
                }
            }
            false
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_come_to_hold_their_shares_and_know_nothing_of_targets_to_come() {
        let mut bands = Bands::untried(|_| 4.0);
        let mut inside = [0.0; 2];
        for point in 0..4000_usize {
            bands.observe(point, [3.0, 4.0]);
            if let Some(radii) = bands.at(2).filter(|_| point >= 2000) {
                // Errors 0 .. 99 in some order.
                let error = (point * 37 % 100) as f64;
                inside = [0, 1].map(|i| inside[i] + f64::from(u8::from(error <= radii[i])));
            }
            bands.push(2, point + 5, (point * 37 % 100) as f64, 20.0);
            assert!(point > 50 || bands.at(2).is_none());
        }
        let shares = inside.map(|count| count / 2000.0);
        assert!((shares[0] - 0.5).abs() < 0.05 && (shares[1] - 0.9).abs() < 0.05, "{shares:?}");
        assert_eq!(bands.at(3), None);
        // A prediction whose target has not come changes nothing.
        let before = bands.at(2);
        bands.push(2, usize::MAX - 1, 1e9, 20.0);
        bands.observe(4000, [3.0, 4.0]);
        let after = bands.at(2).unwrap();
        assert!((after[1] / before.unwrap()[1] - 1.0).abs() < 0.2);
    }
}
