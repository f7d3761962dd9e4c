//! Correction of a preview by newer samples: one ridge regression per lead.
//!
//! Contract: fixed size, no allocation, total. The preview's error r at a lead is regressed on four terms
//! known when the newest sample came: the remaining displacement of the preview, the innovation (newest
//! sample − preview at its time), and the pen's velocity and acceleration ([`super::observer`]). The weights
//! are shrunk towards a prior from other hands. Sums forget.

use super::RefinePrior;
use crate::estimate::LawParameters;
use crate::pen::TARGET_RMS;
use crate::state::state;

/// Terms: remaining displacement of the preview, innovation, displacements by velocity and acceleration until
/// the lead.
pub(crate) const TERMS: usize = 4;
/// One value of each term, both axes.
pub(crate) type BlendTerms = [[f64; 2]; TERMS];

/// The regression at one lead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Blend {
    prior: [f64; TERMS],
    /// Weights of the prior.
    trust: [f64; TERMS],
    /// Σ terms · termsᵀ and Σ terms · error, rows divided by the horizon.
    squares: [[f64; TERMS]; TERMS],
    cross: [f64; TERMS],
    weights: [f64; TERMS],
    /// ⟨error, correction⟩ and ⟨correction, correction⟩ of the cases, made before they were learned.
    paid: f64,
    asked: f64,
    cases: f64,
}

state! { [] Blend { prior, trust, squares, cross, weights, paid, asked, cases } }

impl Blend {
    /// Without cases; `ahead` steps from the sample to the lead, on a tablet from coarse, 0, to clean, 1.
    pub(super) fn new(ahead: f64, clarity: f64, prior: &RefinePrior, law: &LawParameters) -> Self {
        let LawParameters { prior_cases, largest, shortest, .. } = *law;
        let prior = prior.weights(ahead, clarity).map(|weight| bounded(weight, largest));
        let horizon = ahead.max(shortest);
        let cases = prior_cases * (1.0 + horizon) / (horizon * horizon);
        let square = horizon * horizon;
        let step = cases * TARGET_RMS * TARGET_RMS;
        let (innovation, acceleration) = (cases * law.ordinary_innovation, cases * law.ordinary_acceleration);
        let trust = [step * square, innovation, step * square, acceleration * square * square];
        Self {
            prior,
            trust,
            squares: [[0.0; TERMS]; TERMS],
            cross: [0.0; TERMS],
            weights: prior,
            paid: 0.0,
            asked: 0.0,
            cases: 0.0,
        }
    }

    /// The correction of the preview: the regression's output times its worth.
    pub(super) fn correction(&self, terms: &BlendTerms, law: &LawParameters) -> [f64; 2] {
        let worth = self.worth(law);
        self.predicted_error(terms).map(|way| worth * way)
    }

    /// Share of the corrections that agreed with the error, in [0, 1]: a preview that is right is not moved.
    fn worth(&self, law: &LawParameters) -> f64 {
        if !(self.asked > 0.0) {
            return 1.0;
        }
        // Counts cases, not squares: a correction of a micrometre must prove itself like one of a millimetre.
        let past = self.cases * self.paid / self.asked;
        // Forgotten like any case: cases / memory is 1 − λⁿ after n of them.
        let prior = law.first_cases * (1.0 - self.cases / law.memory);
        ((past + prior) / (self.cases + prior)).clamp(0.0, 1.0)
    }

    fn predicted_error(&self, terms: &BlendTerms) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for (weight, term) in self.weights.iter().zip(terms) {
            for (sum, term) in sum.iter_mut().zip(term) {
                *sum += weight * term;
            }
        }
        sum
    }

    /// One case: the preview's `error`, `ahead` steps after the sample. All in normalised units.
    pub(super) fn learn(&mut self, terms: &BlendTerms, error: [f64; 2], ahead: f64, law: &LawParameters) {
        let (forgetting, LawParameters { largest, shortest, .. }) = (law.forgetting(), *law);
        let ([sx, sy], [rx, ry]) = (self.predicted_error(terms), error);
        self.paid = forgetting * self.paid + sx * rx + sy * ry;
        self.asked = forgetting * self.asked + sx * sx + sy * sy;
        self.cases = forgetting * self.cases + 1.0;
        let scale = 1.0 / ahead.max(shortest);
        let scale = scale * scale;
        for ((row, cross), [x, y]) in self.squares.iter_mut().zip(&mut self.cross).zip(terms) {
            let [ex, ey] = error;
            *cross = forgetting * *cross + scale * (x * ex + y * ey);
            for (entry, [u, v]) in row.iter_mut().zip(terms) {
                *entry = forgetting * *entry + scale * (x * u + y * v);
            }
        }
        self.weights = self.solved(largest).unwrap_or(self.prior);
    }

    /// (Σ + P) w = c + P w₀ by a Cholesky factorisation; `None` if it fails numerically.
    #[expect(clippy::indexing_slicing, reason = "indices run over the array lengths of the types")]
    fn solved(&self, largest: f64) -> Option<[f64; TERMS]> {
        let mut factor = self.squares;
        let mut w = self.cross;
        for k in 0..TERMS {
            factor[k][k] += self.trust[k];
            w[k] += self.trust[k] * self.prior[k];
        }
        for k in 0..TERMS {
            let pivot = factor[k][k];
            if !(pivot > 0.0 && pivot < f64::INFINITY) {
                return None;
            }
            for i in k + 1..TERMS {
                let ratio = factor[i][k] / pivot;
                for j in k..TERMS {
                    factor[i][j] -= ratio * factor[k][j];
                }
                w[i] -= ratio * w[k];
            }
        }
        for k in (0..TERMS).rev() {
            for j in k + 1..TERMS {
                w[k] -= factor[k][j] * w[j];
            }
            w[k] /= factor[k][k];
        }
        let sound = w.iter().all(|w| w.is_finite());
        sound.then(|| w.map(|w| bounded(w, largest)))
    }
}

/// Clamped to ± `largest`; 0 for NaN. Total, unlike `clamp`, for any `largest`.
fn bounded(weight: f64, largest: f64) -> f64 {
    if weight.is_finite() { weight.max(-largest).min(largest) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix4, Vector4};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    const LAW: &LawParameters = &LawParameters::SHIPPED;
    const PRIOR: &RefinePrior = &RefinePrior::SHIPPED;

    fn random(rng: &mut Pcg64, size: f64) -> [f64; 2] {
        [rng.random_range(-size..size), rng.random_range(-size..size)]
    }

    /// Terms of ordinary motion and an error that follows `weights` plus noise.
    fn case(rng: &mut Pcg64, ahead: f64, weights: [f64; TERMS], noise: f64) -> (BlendTerms, [f64; 2]) {
        let sizes = [30.0, 4.0, 12.0 * ahead, 2.5 * ahead * ahead];
        let terms = sizes.map(|size| random(rng, size));
        let mut error = random(rng, noise);
        for (weight, [x, y]) in weights.iter().zip(&terms) {
            error[0] += weight * x;
            error[1] += weight * y;
        }
        (terms, error)
    }

    #[test]
    fn weights_are_those_of_the_ridge_regression_over_the_same_cases() {
        let ahead = 3.5;
        let mut rng = Pcg64::seed_from_u64(5);
        let mut blend = Blend::new(ahead, 0.0, PRIOR, LAW);
        let scale = 1.0 / (ahead * ahead);
        let cases = 40.0 * (1.0 + ahead) * scale;
        let ridge =
            Vector4::new(100.0 * ahead * ahead, 10.0, 100.0 * ahead * ahead, 4.0 * ahead.powi(4)) * cases;
        let prior = Vector4::from(PRIOR.weights(ahead, 0.0));
        let (mut squares, mut cross) = (Matrix4::zeros(), Vector4::zeros());
        for _ in 0..700 {
            let (terms, error) = case(&mut rng, ahead, [-0.7, 2.0, 0.3, 0.5], 3.0);
            blend.learn(&terms, error, ahead, LAW);
            (squares, cross) = (squares * LAW.forgetting(), cross * LAW.forgetting());
            for axis in 0..2 {
                let x = Vector4::from(terms.map(|term| term[axis]));
                squares += x * x.transpose() * scale;
                cross += x * (error[axis] * scale);
            }
        }
        let expected =
            (squares + Matrix4::from_diagonal(&ridge)).lu().solve(&(cross + ridge.component_mul(&prior)));
        for (got, expected) in blend.weights.iter().zip(expected.unwrap().iter()) {
            assert!((got - expected).abs() < 1e-9, "{got}, directly {expected}");
        }
        assert!(blend.weights.iter().zip(prior.iter()).all(|(got, prior)| (got - prior).abs() > 0.02));
    }

    #[test]
    fn a_new_hand_has_what_other_hands_had_and_learns_its_own() {
        let mut rng = Pcg64::seed_from_u64(6);
        let mut blend = Blend::new(1.5, 0.0, PRIOR, LAW);
        assert_eq!(blend.weights, PRIOR.weights(1.5, 0.0));
        let own = [-0.1, 3.0, 0.2, 0.8];
        for _ in 0..4000 {
            let (terms, error) = case(&mut rng, 1.5, own, 1.0);
            blend.learn(&terms, error, 1.5, LAW);
        }
        for ((got, own), prior) in blend.weights.iter().zip(own).zip(PRIOR.weights(1.5, 0.0)) {
            assert!((got - own).abs() < 0.2 * (prior - own).abs(), "{got}, {own}, once {prior}");
        }
    }

    #[test]
    fn weights_stay_finite_and_bounded_whatever_is_learned() {
        let mut rng = Pcg64::seed_from_u64(7);
        for size in [1e-300, 1e-3, 1e3, 1e150] {
            let mut blend = Blend::new(0.2, 0.0, PRIOR, LAW);
            for _ in 0..200 {
                let terms = std::array::from_fn(|_| random(&mut rng, size));
                blend.learn(&terms, random(&mut rng, size * 1e3), 0.2, LAW);
                assert!(blend.weights.iter().all(|w| w.abs() <= LAW.largest), "{size}: {:?}", blend.weights);
            }
        }
    }

    #[test]
    fn corrections_are_worth_the_share_of_them_that_went_the_way_of_the_error() {
        let ahead = 2.5;
        let mut rng = Pcg64::seed_from_u64(8);
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        for own in [[-0.7, 2.0, 0.3, 0.5], [0.6, -1.0, -0.5, 0.0]] {
            let mut blend = Blend::new(ahead, 0.5, PRIOR, LAW);
            let (mut paid, mut asked, mut cases, mut prior) = (0.0, 0.0, 0.0, 20.0);
            for k in 0..60 {
                let (terms, error) = case(&mut rng, ahead, own, 20.0);
                let correction =
                    [0, 1].map(|axis| (0..TERMS).map(|i| blend.weights[i] * terms[i][axis]).sum::<f64>());
                // Twenty cases in which they were fully right come first, and are forgotten like the others.
                let past: f64 = if k == 0 { 0.0 } else { cases * paid / asked };
                let worth = ((past + prior) / (cases + prior)).clamp(0.0, 1.0);
                let found = blend.correction(&terms, LAW);
                for (found, correction) in found.iter().zip(correction) {
                    assert!((found - worth * correction).abs() < 1e-9, "{k}: {found} {worth} {correction}");
                }
                blend.learn(&terms, error, ahead, LAW);
                paid = 0.998 * paid + dot(correction, error);
                asked = 0.998 * asked + dot(correction, correction);
                cases = 0.998 * cases + 1.0;
                prior *= 0.998;
            }
        }
    }

    /// By hand: each part decays to e^(−1) at its reach, and tablets are interpolated.
    #[test]
    fn what_other_hands_had_fades_with_the_lead() {
        let left = (-1.0_f64).exp();
        let close =
            |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        let weight = |ahead: f64, clarity: f64, term: usize| PRIOR.weights(ahead, clarity)[term];
        for (term, reach, near, far) in [(0, 1.5, -0.9, -0.6), (1, 4.0, 0.0, 1.9), (2, 5.5, 0.68, 0.0)] {
            close(weight(0.0, 0.0, term), near);
            close(weight(reach, 0.0, term), far + (near - far) * left);
            close(weight(1e9, 0.0, term), far);
        }
        close(weight(0.0, 0.0, 3), 0.25 - 0.9);
        close(weight(15.0, 0.0, 3), 0.25 * left - 0.9 * (-25.0_f64).exp());
        let clean = [(0, 12.0, -1.0, -0.3), (1, 5.0, 0.0, 1.2), (2, 9.0, 1.0, 0.0), (3, 10.0, 1.0, 0.0)];
        for (term, reach, near, far) in clean {
            close(weight(0.0, 1.0, term), near);
            close(weight(reach, 1.0, term), far + (near - far) * left);
            // Slowly at first: a Gaussian.
            close(weight(2.0 * reach, 1.0, term), far + (near - far) * left.powi(4));
            let middle = 0.5 * (weight(3.0, 0.0, term) + weight(3.0, 1.0, term));
            close(weight(3.0, 0.5, term), middle);
        }
    }
}
