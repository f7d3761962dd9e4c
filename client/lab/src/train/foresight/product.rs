//! Matrix products of the training, in tiles that stay in registers.
//!
//! Contract: every sum runs in the order of its terms, without fused multiply-add, so that results are the
//! same bit for bit with any width of vector instructions.

use multiversion::multiversion;

/// Rows of a tile.
pub(super) const ROWS: usize = 4;
/// Columns of a tile.
pub(super) const COLUMNS: usize = 16;

/// The left factor, M x K: for every four rows, K columns of four numbers.
#[derive(Debug, Clone, Default)]
pub(super) struct LeftFactor {
    tiles: Vec<[f32; ROWS]>,
    terms: usize,
}

/// The right factor, K x N: for every sixteen columns, K rows of sixteen numbers.
#[derive(Debug, Clone, Default)]
pub(super) struct RightFactor {
    tiles: Vec<[f32; COLUMNS]>,
    terms: usize,
}

impl LeftFactor {
    /// Fills it from `number(m, k)`; `rows` is a multiple of [`ROWS`].
    pub(super) fn fill(&mut self, rows: usize, terms: usize, number: impl Fn(usize, usize) -> f32) {
        debug_assert!(rows.is_multiple_of(ROWS), "{rows}");
        self.tiles.clear();
        self.terms = terms;
        for block in 0..rows / ROWS {
            let tile = (0..terms).map(|k| std::array::from_fn(|r| number(block * ROWS + r, k)));
            self.tiles.extend(tile);
        }
    }
}

impl RightFactor {
    /// Fills it from `number(k, n)`; `columns` is a multiple of [`COLUMNS`].
    pub(super) fn fill(&mut self, terms: usize, columns: usize, number: impl Fn(usize, usize) -> f32) {
        debug_assert!(columns.is_multiple_of(COLUMNS), "{columns}");
        self.tiles.clear();
        self.terms = terms;
        for block in 0..columns / COLUMNS {
            let tile = (0..terms).map(|k| std::array::from_fn(|c| number(k, block * COLUMNS + c)));
            self.tiles.extend(tile);
        }
    }
}

/// `out` (M x N, row by row) += `left` · `right`.
#[multiversion(targets("x86_64+avx+avx2+bmi1+bmi2+lzcnt+popcnt"))]
pub(super) fn add_product(out: &mut [f32], columns: usize, left: &LeftFactor, right: &RightFactor) {
    let terms = left.terms.max(1);
    for (rows, a) in out.chunks_exact_mut(ROWS * columns).zip(left.tiles.chunks_exact(terms)) {
        for (block, b) in right.tiles.chunks_exact(terms).enumerate() {
            let mut sums = [[0.0_f32; COLUMNS]; ROWS];
            for (a, b) in a.iter().zip(b) {
                for r in 0..ROWS {
                    for c in 0..COLUMNS {
                        sums[r][c] += a[r] * b[c];
                    }
                }
            }
            for (row, sums) in rows.chunks_exact_mut(columns).zip(sums) {
                let row = &mut row[block * COLUMNS..][..COLUMNS];
                for (out, sum) in row.iter_mut().zip(sums) {
                    *out += sum;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_product_is_the_sum_over_its_terms() {
        let (m, k, n) = (8, 7, 32);
        let a = |m: usize, k: usize| (m as f32 - 3.0) * 0.5 + k as f32;
        let b = |k: usize, n: usize| (n as f32 * 0.25 - k as f32).sin();
        let (mut left, mut right) = (LeftFactor::default(), RightFactor::default());
        left.fill(m, k, a);
        right.fill(k, n, b);
        let mut out = vec![1.0; m * n];
        add_product(&mut out, n, &left, &right);
        for (index, got) in out.iter().enumerate() {
            let (row, column) = (index / n, index % n);
            let expected: f64 = (0..k).map(|k| f64::from(a(row, k)) * f64::from(b(k, column))).sum();
            assert!((f64::from(*got) - 1.0 - expected).abs() < 1e-4, "{row} {column}: {got} {expected}");
        }
    }
}
