//! `Covariance`: P of recursive least squares, kept symmetric, positive and bounded.
//!
//! Exponential forgetting divides P by λ at every step. In directions that the input does not excite nothing takes that
//! back, and P would grow without bound (wind-up): a hand that rests, or writes one straight line, does that. Here P
//! forgets only while its trace is below a bound.

/// P, D x D.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Covariance<const D: usize> {
    matrix: [[f64; D]; D],
    /// P₀ = start·I.
    start: f64,
    /// Largest trace for which P still forgets.
    bound: f64,
}

impl<const D: usize> Covariance<D> {
    /// P₀ = `start`·I; forgets while its mean diagonal is at most `ceiling`·`start`.
    pub(crate) fn new(start: f64, ceiling: f64) -> Self {
        let mut matrix = [[0.0; D]; D];
        for (i, row) in matrix.iter_mut().enumerate() {
            if let Some(entry) = row.get_mut(i) {
                *entry = start;
            }
        }
        Self { matrix, start, bound: ceiling * start * D as f64 }
    }

    /// Sum of the diagonal.
    pub(crate) fn trace(&self) -> f64 {
        self.diagonal().sum()
    }

    fn diagonal(&self) -> impl Iterator<Item = f64> + '_ {
        self.matrix.iter().enumerate().filter_map(|(i, row)| row.get(i).copied())
    }

    /// k = P φ / (λ + φᵀ P φ), then P ← (P − k φᵀ P)/λ; `None`, with P back at its start, if P was no covariance any more.
    pub(crate) fn update(&mut self, phi: &[f64], forgetting: f64) -> Option<[f64; D]> {
        let mut image = [0.0; D];
        for (row, phi) in self.matrix.iter().zip(phi) {
            for (image, p) in image.iter_mut().zip(row) {
                *image += phi * p;
            }
        }
        let excitation: f64 = image.iter().zip(phi).map(|(a, b)| a * b).sum();
        let trace = self.trace();
        // A covariance has variances on its diagonal and an image that points forward; NaN fails everywhere.
        let positive = self.diagonal().all(|variance| variance > 0.0);
        let sound = positive && trace.is_finite() && excitation >= 0.0 && excitation.is_finite();
        if !sound {
            *self = Self::new(self.start, self.bound / (self.start * D as f64));
            return None;
        }
        let inverse = 1.0 / (forgetting + excitation);
        // With room for the rounding of the sum, so that P forgets from its very first step on.
        let grown = if trace <= self.bound * 1.000_001 { 1.0 / forgetting } else { 1.0 };
        for (row, left) in self.matrix.iter_mut().zip(&image) {
            for (p, right) in row.iter_mut().zip(&image) {
                // The product of the two images first: P stays symmetric to the last bit.
                *p = (*p - left * right * inverse) * grown;
            }
        }
        Some(image.map(|image| image * inverse))
    }
}
