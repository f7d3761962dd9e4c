//! `Covariance`: P of recursive least squares, kept symmetric, positive and bounded.
//!
//! Exponential forgetting divides P by λ at every step. In directions without excitation P would grow without
//! bound (wind-up), e.g. while the hand rests or writes one straight line. Here P forgets only while its
//! trace is below a bound.

/// P, D x D.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Covariance<const D: usize> {
    matrix: [[f64; D]; D],
    /// P₀ = start·I, the covariance at start.
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

    /// k = P φ / (λ + φᵀ P φ), then P ← (P − k φᵀ P)/λ; `None`, with P reset, if P was no covariance any
    /// more.
    pub(crate) fn update(&mut self, phi: &[f64], forgetting: f64) -> Option<[f64; D]> {
        let mut image = [0.0; D];
        for (row, phi) in self.matrix.iter().zip(phi) {
            for (image, p) in image.iter_mut().zip(row) {
                *image += phi * p;
            }
        }
        let excitation: f64 = image.iter().zip(phi).map(|(a, b)| a * b).sum();
        let trace = self.trace();
        // A covariance has positive variances and φᵀPφ ≥ 0; NaN fails everywhere.
        let positive = self.diagonal().all(|variance| variance > 0.0);
        let sound = positive && trace.is_finite() && excitation >= 0.0 && excitation.is_finite();
        if !sound {
            *self = Self::new(self.start, self.bound / (self.start * D as f64));
            return None;
        }
        let inverse = 1.0 / (forgetting + excitation);
        // With room for rounding of the sum, so that P forgets from the first step on.
        let grown = if trace <= self.bound * 1.000_001 { 1.0 / forgetting } else { 1.0 };
        for (row, left) in self.matrix.iter_mut().zip(&image) {
            for (p, right) in row.iter_mut().zip(&image) {
                // The outer product first: P stays symmetric to the last bit.
                *p = (*p - left * right * inverse) * grown;
            }
        }
        Some(image.map(|image| image * inverse))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_step_is_the_one_worked_by_hand() {
        // P = 4, φ = 2, λ = 1/2: k = 8/(1/2 + 16), P' = (4 − 8·8/16.5)/λ.
        let mut p = Covariance::<1>::new(4.0, 1.0);
        let [gain] = p.update(&[2.0], 0.5).unwrap();
        assert!((gain - 8.0 / 16.5).abs() < 1e-15);
        assert!((p.trace() - (4.0 - 64.0 / 16.5) / 0.5).abs() < 1e-14);
        // Without excitation nothing is learned, and P forgets until its trace has grown to the bound.
        let mut p = Covariance::<2>::new(4.0, 3.0);
        for _ in 0..100 {
            assert_eq!(p.update(&[0.0, 0.0], 0.9), Some([0.0, 0.0]));
        }
        assert!(p.trace() > 24.0 && p.trace() < 24.1 / 0.9, "{}", p.trace());
    }

    #[test]
    fn what_is_no_covariance_starts_anew_whatever_is_wrong_with_it() {
        let (one, huge) = ([1.0; 3], [1e60; 3]);
        let diagonal = |a, b, c| [[a, 0.0, 0.0], [0.0, b, 0.0], [0.0, 0.0, c]];
        for (matrix, phi) in [
            // A variance that is not positive, or NaN.
            (diagonal(1.0, -0.1, 1.0), one),
            (diagonal(1.0, 1.0, 0.0), one),
            (diagonal(f64::NAN, 1.0, 1.0), one),
            // A trace that overflows without excitation.
            (diagonal(1e308, 1e308, 1e308), [1e-200; 3]),
            // A negative φᵀPφ.
            ([[1.0, -2.0, 0.0], [-2.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [1.0, 1.0, 0.0]),
            // An excitation that overflows, or is NaN.
            (diagonal(1e200, 1e200, 1e200), huge),
            (diagonal(1.0, 1.0, 1.0), [f64::NAN, 0.0, 0.0]),
        ] {
            let new = Covariance::<3>::new(2.0, 5.0);
            let mut broken = Covariance { matrix, ..new };
            assert_eq!(broken.update(&phi, 0.99), None, "{matrix:?}");
            assert!(broken == new, "{broken:?}");
            assert!(broken.update(&one, 0.99).is_some());
        }
    }
}
