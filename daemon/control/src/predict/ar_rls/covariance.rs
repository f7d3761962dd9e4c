//! `Covariance`: P of recursive least squares, kept symmetric, positive and bounded.
//!
//! Exponential forgetting divides P by λ at every step. In directions that the input does not excite nothing takes that
//! back, and P would grow without bound (wind-up): a hand that rests, or writes one straight line, does that. Here P
//! forgets only while its trace is below a bound.

use super::REGRESSORS;

/// P, REGRESSORS x REGRESSORS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Covariance {
    matrix: [[f64; REGRESSORS]; REGRESSORS],
    /// P₀ = start·I, also the largest mean of the diagonal for which P still forgets.
    start: f64,
}

impl Covariance {
    /// P₀ = `start`·I.
    pub(super) fn new(start: f64) -> Self {
        let mut matrix = [[0.0; REGRESSORS]; REGRESSORS];
        for (i, row) in matrix.iter_mut().enumerate() {
            if let Some(entry) = row.get_mut(i) {
                *entry = start;
            }
        }
        Self { matrix, start }
    }

    /// Sum of the diagonal.
    pub(super) fn trace(&self) -> f64 {
        self.matrix.iter().enumerate().filter_map(|(i, row)| row.get(i)).sum()
    }

    /// k = P φ / (λ + φᵀ P φ), then P ← (P − k φᵀ P)/λ; `None`, with P back at its start, if P was no covariance any more.
    pub(super) fn update(&mut self, phi: &[f64], forgetting: f64) -> Option<[f64; REGRESSORS]> {
        let mut image = [0.0; REGRESSORS];
        for (row, phi) in self.matrix.iter().zip(phi) {
            for (image, p) in image.iter_mut().zip(row) {
                *image += phi * p;
            }
        }
        let excitation: f64 = image.iter().zip(phi).map(|(a, b)| a * b).sum();
        let trace = self.trace();
        let sound = excitation >= 0.0 && excitation.is_finite() && trace > 0.0 && trace.is_finite();
        if !sound {
            *self = Self::new(self.start);
            return None;
        }
        let inverse = 1.0 / (forgetting + excitation);
        let bounded = trace <= self.start * REGRESSORS as f64;
        let grown = if bounded { 1.0 / forgetting } else { 1.0 };
        for (row, left) in self.matrix.iter_mut().zip(&image) {
            for (p, right) in row.iter_mut().zip(&image) {
                // The product of the two images first: P stays symmetric to the last bit.
                *p = (*p - left * right * inverse) * grown;
            }
        }
        Some(image.map(|image| image * inverse))
    }
}
