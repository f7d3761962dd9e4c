//! The condensed model x̃ = Ã x₀ + B̃ ũ as explicit matrices.
//!
//! Used to build the cost once, to hand the rows to another solver, and as the second opinion of the
//! sweeps in [`super::model`]. Normalised units.

use super::model::{A, AxisVector, B};
use crate::qp::cholesky::Square;

/// Ã and B̃ of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Condensed<const N: usize> {
    /// Ã: block i−1 is Aⁱ (3 x 3), quantity by quantity.
    pub free: [[AxisVector; 3]; N],
    /// B̃ per quantity (position, velocity, acceleration): N x N, row i−1 is x_i, column j is u_j; zero for j
    /// ≥ i.
    pub forced: [Square<N>; 3],
}

impl<const N: usize> Condensed<N> {
    /// Build Ã and B̃ from A and B.
    #[must_use]
    #[expect(clippy::indexing_slicing, reason = "indices run over the array lengths of the types")]
    pub fn new() -> Self {
        let mut free = [[[0.0; 3]; 3]; N];
        let mut power = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for block in &mut free {
            power = product(&A, &power);
            *block = power;
        }
        let mut forced = [[[0.0; N]; N]; 3];
        let mut impulse = B;
        for delay in 0..N {
            for (quantity, response) in forced.iter_mut().zip(impulse) {
                for j in 0..N - delay {
                    quantity[j + delay][j] = response;
                }
            }
            impulse = A.map(|row| row.iter().zip(impulse).map(|(a, b)| a * b).sum());
        }
        Self { free, forced }
    }
}

impl<const N: usize> Default for Condensed<N> {
    fn default() -> Self {
        Self::new()
    }
}

fn product(left: &[[f64; 3]; 3], right: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    left.map(|row| {
        let mut out = [0.0; 3];
        for (factor, from) in row.iter().zip(right) {
            for (to, entry) in out.iter_mut().zip(from) {
                *to += factor * entry;
            }
        }
        out
    })
}
