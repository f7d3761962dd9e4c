//! Dense Cholesky factorisation of small fixed-size matrices, without allocation.
//!
//! Contract: `None` for a matrix that is not positive definite or not finite; loop bounds come from the type.

#![expect(
    clippy::needless_range_loop,
    reason = "triangular loops over several arrays read best with indices"
)]

/// Square matrix, row by row.
pub type Square<const N: usize> = [[f64; N]; N];

/// Lower triangular L with H = L Lᵀ, and the reciprocals of its diagonal.
#[derive(Debug, Clone, Copy)]
pub struct Cholesky<const N: usize> {
    lower: Square<N>,
    reciprocal: [f64; N],
}

impl<const N: usize> Cholesky<N> {
    /// Factor a symmetric `h` (N x N, only its lower triangle is read).
    #[must_use]
    #[inline]
    #[expect(clippy::indexing_slicing, reason = "every index runs over 0..N of an [_; N]")]
    pub fn new(h: &Square<N>) -> Option<Self> {
        let mut lower = [[0.0; N]; N];
        let mut reciprocal = [0.0; N];
        for i in 0..N {
            for j in 0..=i {
                let mut sum = h[i][j];
                for k in 0..j {
                    sum -= lower[i][k] * lower[j][k];
                }
                if j < i {
                    lower[i][j] = sum * reciprocal[j];
                } else {
                    // Rounding leaves about 1e-16 of the diagonal where an exact factor would have zero.
                    if !(sum > h[i][i] * 1e-14 && sum < f64::INFINITY) {
                        return None;
                    }
                    let root = sum.sqrt();
                    lower[i][i] = root;
                    reciprocal[i] = 1.0 / root;
                }
            }
        }
        Some(Self { lower, reciprocal })
    }

    /// x with H x = `b`.
    #[must_use]
    #[inline]
    #[expect(clippy::indexing_slicing, reason = "every index runs over 0..N of an [_; N]")]
    pub fn solve(&self, b: &[f64; N]) -> [f64; N] {
        let mut x = *b;
        for i in 0..N {
            let mut sum = x[i];
            for k in 0..i {
                sum -= self.lower[i][k] * x[k];
            }
            x[i] = sum * self.reciprocal[i];
        }
        for i in (0..N).rev() {
            let scaled = x[i] * self.reciprocal[i];
            x[i] = scaled;
            for k in 0..i {
                x[k] -= self.lower[i][k] * scaled;
            }
        }
        x
    }

    /// H⁻¹ (N x N), exactly symmetric.
    #[must_use]
    #[expect(clippy::indexing_slicing, reason = "every index runs over 0..N of an [_; N]")]
    pub fn inverse(&self) -> Square<N> {
        // M = L⁻¹ row by row, then H⁻¹ = Mᵀ M.
        let mut m = [[0.0; N]; N];
        for i in 0..N {
            let mut row = [0.0; N];
            for k in 0..i {
                let factor = self.lower[i][k];
                for j in 0..N {
                    row[j] -= factor * m[k][j];
                }
            }
            row[i] = 1.0;
            for entry in &mut row {
                *entry *= self.reciprocal[i];
            }
            m[i] = row;
        }
        let mut inverse = [[0.0; N]; N];
        for row in &m {
            for i in 0..N {
                for j in 0..N {
                    inverse[i][j] += row[i] * row[j];
                }
            }
        }
        inverse
    }
}
