//! Exact minimiser of a small strictly convex quadratic over a box: the joint velocities of one tick.
//!
//! min ½ xᵀH x + gᵀx, lower ≤ x ≤ upper. H may change at every call. Contract: no allocation, no panic; an
//! `Optimal` answer lies in the box exactly and its KKT residual was computed from H and g themselves.

use crate::state::state;
use nalgebra::{SMatrix, SVector};

use super::cholesky::{Cholesky, Square};
use super::dual::{Bounds, DualActiveSet, Gram, Rows, Termination};
use super::{KKT_TOLERANCE, QpStatus};

/// Distance outside the box \[units of x\] that counts as rounding and is clamped away.
const FEASIBILITY: f64 = 1e-12;

/// Which bounds hold the solution, bit `i` for coordinate `i`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ActiveBounds {
    /// Coordinates held up by their lower bound.
    pub lower: u32,
    /// Coordinates held down by their upper bound.
    pub upper: u32,
}

state! { whole [] ActiveBounds { lower, upper } }

impl ActiveBounds {
    /// Number of coordinates held.
    #[must_use]
    pub const fn count(self) -> u32 {
        self.lower.count_ones() + self.upper.count_ones()
    }
}

/// What [`solve`] found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoxSolution<const J: usize> {
    /// The minimiser; inside the box whatever the status, as long as the box is finite and not empty.
    pub x: SVector<f64, J>,
    /// `Optimal`, or why `x` must not be used.
    pub status: QpStatus,
    /// Steps of the active set; 0 when the unconstrained minimiser lies in the box.
    pub iterations: u32,
    /// The bounds that hold `x`.
    pub active: ActiveBounds,
    /// Largest gradient component that no bound explains, relative to the largest sum of absolute terms of a
    /// component; NaN if nothing was solved.
    pub kkt_residual: f64,
}

/// Minimise ½ xᵀH x + gᵀx over the box.
///
/// `h`: J x J, symmetric positive definite; `g`, `lower`, `upper`: J. A bound may be infinite, none may be
/// NaN.
///
/// *Status*: `NotFinite` for a non-finite H or g or a NaN bound, `Infeasible` for an empty box, `NotConvex`,
/// `IterationCap` (after 16 J steps), `Uncertified`.
#[must_use]
pub fn solve<const J: usize>(
    h: &SMatrix<f64, J, J>,
    g: &SVector<f64, J>,
    lower: &SVector<f64, J>,
    upper: &SVector<f64, J>,
) -> BoxSolution<J> {
    let [[g]] = [g.data.0];
    let ([[lower]], [[upper]]) = ([lower.data.0], [upper.data.0]);
    // Rows and columns of a symmetric matrix are the same.
    let h = &h.data.0;
    let failed = |status| BoxSolution {
        x: SVector::from(clamped(&[0.0; J], &lower, &upper)),
        status,
        iterations: 0,
        active: ActiveBounds::default(),
        kkt_residual: f64::NAN,
    };
    let factor = match factored(h, &g, &lower, &upper) {
        Ok(factor) => factor,
        Err(status) => return failed(status),
    };

    let mut x = factor.solve(&g.map(|entry| -entry));
    let mut active = ActiveBounds::default();
    let mut iterations = 0;
    let inside = x.iter().zip(&lower).zip(&upper).all(|((x, lower), upper)| x >= lower && x <= upper);
    if !inside {
        let bounds =
            Bounds { lower: [lower], upper: [upper], penalty: [[f64::INFINITY; J]], weight: [[1.0; J]] };
        let mut set = DualActiveSet::<1, J, J>::default();
        let mut value = [x];
        let limit = 16 * J as u32;
        let (termination, steps) = set.solve(&Inverse(&factor), &bounds, FEASIBILITY, limit, &mut value);
        iterations = steps;
        for (row, side) in set.active() {
            if side > 0.0 {
                active.upper |= 1 << row;
            } else {
                active.lower |= 1 << row;
            }
        }
        [x] = value;
        match termination {
            Termination::Optimal => {}
            Termination::IterationCap => {
                let x = SVector::from(clamped(&x, &lower, &upper));
                return BoxSolution { iterations, x, ..failed(QpStatus::IterationCap) };
            }
            Termination::Infeasible => return BoxSolution { iterations, ..failed(QpStatus::Infeasible) },
        }
        x = pinned(&x, &lower, &upper, active);
    }
    let mut kkt_residual = residual(h, &g, &x, active);
    let sharp = kkt_residual <= KKT_TOLERANCE * 1e-2;
    if let (false, Some(better)) = (sharp, polished(h, &g, &x, active)) {
        let better = pinned(&better, &lower, &upper, active);
        let better_residual = residual(h, &g, &better, active);
        if better_residual < kkt_residual {
            x = better;
            kkt_residual = better_residual;
        }
    }
    let status = if kkt_residual <= KKT_TOLERANCE { QpStatus::Optimal } else { QpStatus::Uncertified };
    BoxSolution { x: SVector::from(x), status, iterations, active, kkt_residual }
}

/// The answer `x` of another solver in the same form: active coordinates on their bounds, the rest inside,
/// with the same residual.
#[expect(clippy::too_many_arguments, reason = "the problem, the answer, and what the solver said of it")]
pub(super) fn judged<const J: usize>(
    h: &SMatrix<f64, J, J>,
    g: &SVector<f64, J>,
    lower: &SVector<f64, J>,
    upper: &SVector<f64, J>,
    x: &SVector<f64, J>,
    active: ActiveBounds,
    status: QpStatus,
    iterations: u32,
) -> BoxSolution<J> {
    let ([[g]], [[lower]], [[upper]], [[x]]) = ([g.data.0], [lower.data.0], [upper.data.0], [x.data.0]);
    let finite = x.iter().all(|entry| entry.is_finite());
    let usable = status.usable() && finite;
    let x = if usable { pinned(&x, &lower, &upper, active) } else { clamped(&[0.0; J], &lower, &upper) };
    let kkt_residual = if usable { residual(&h.data.0, &g, &x, active) } else { f64::NAN };
    let status = match status {
        QpStatus::Inexact if kkt_residual <= KKT_TOLERANCE => QpStatus::Optimal,
        status if status.usable() && !finite => QpStatus::Uncertified,
        status => status,
    };
    BoxSolution { x: SVector::from(x), status, iterations, active, kkt_residual }
}

/// With C = I the Gram matrix is H⁻¹.
struct Inverse<'a, const J: usize>(&'a Cholesky<J>);

impl<const J: usize> Gram<1, J> for Inverse<'_, J> {
    #[inline]
    fn column(&self, row: usize, out: &mut Rows<1, J>) {
        let mut unit = [0.0; J];
        if let Some(entry) = unit.get_mut(row) {
            *entry = 1.0;
        }
        *out = [self.0.solve(&unit)];
    }
}

/// The factor of `h`, if the problem over the box has a minimiser that can be found.
///
/// # Errors
///
/// `NotFinite`, `Infeasible`, `NotConvex`.
pub(super) fn factored<const J: usize>(
    h: &Square<J>,
    g: &[f64; J],
    lower: &[f64; J],
    upper: &[f64; J],
) -> Result<Cholesky<J>, QpStatus> {
    let finite = g.iter().chain(h.as_flattened()).all(|entry| entry.is_finite());
    if !finite || lower.iter().chain(upper).any(|bound| bound.is_nan()) {
        return Err(QpStatus::NotFinite);
    }
    if lower.iter().zip(upper).any(|(lower, upper)| lower > upper) {
        return Err(QpStatus::Infeasible);
    }
    Cholesky::new(h).ok_or(QpStatus::NotConvex)
}

/// `x` moved into the box.
pub(super) fn clamped<const J: usize>(x: &[f64; J], lower: &[f64; J], upper: &[f64; J]) -> [f64; J] {
    let mut inside = *x;
    for ((x, lower), upper) in inside.iter_mut().zip(lower).zip(upper) {
        *x = x.max(*lower).min(*upper);
    }
    inside
}

/// `x` with the active coordinates exactly on their bounds and the others inside.
pub(super) fn pinned<const J: usize>(
    x: &[f64; J],
    lower: &[f64; J],
    upper: &[f64; J],
    active: ActiveBounds,
) -> [f64; J] {
    let mut pinned = clamped(x, lower, upper);
    for (i, ((x, lower), upper)) in pinned.iter_mut().zip(lower).zip(upper).enumerate() {
        if active.upper >> i & 1 == 1 {
            *x = *upper;
        } else if active.lower >> i & 1 == 1 {
            *x = *lower;
        }
    }
    pinned
}

/// Solves the free coordinates again for the held ones, with H itself instead of updated quantities.
#[expect(clippy::indexing_slicing, reason = "every index runs over 0..J of an [_; J]")]
fn polished<const J: usize>(
    h: &Square<J>,
    g: &[f64; J],
    x: &[f64; J],
    active: ActiveBounds,
) -> Option<[f64; J]> {
    let held = active.lower | active.upper;
    let free = |i: usize| held >> i & 1 == 0;
    let mut reduced = [[0.0; J]; J];
    let mut right = *x;
    for i in 0..J {
        if free(i) {
            right[i] = -g[i];
            for j in 0..J {
                if free(j) {
                    reduced[i][j] = h[i][j];
                } else {
                    right[i] -= h[i][j] * x[j];
                }
            }
        } else {
            reduced[i][i] = 1.0;
        }
    }
    Some(Cholesky::new(&reduced)?.solve(&right))
}

/// Stationarity and multiplier signs at a point of the box.
fn residual<const J: usize>(h: &Square<J>, g: &[f64; J], x: &[f64; J], active: ActiveBounds) -> f64 {
    let mut worst = 0.0_f64;
    let mut scale = f64::MIN_POSITIVE;
    for (i, (row, g)) in h.iter().zip(g).enumerate() {
        let mut gradient = *g;
        let mut size = g.abs();
        for (h, x) in row.iter().zip(x) {
            gradient += h * x;
            size += (h * x).abs();
        }
        // The gradient must push outward where a bound holds, and vanish elsewhere.
        let unexplained = if active.upper >> i & 1 == 1 {
            gradient.max(0.0)
        } else if active.lower >> i & 1 == 1 {
            (-gradient).max(0.0)
        } else {
            gradient.abs()
        };
        // f64::max drops a NaN; a residual must propagate it.
        if unexplained.is_nan() || unexplained > worst {
            worst = unexplained;
        }
        if worst.is_nan() {
            return worst;
        }
        scale = scale.max(size);
    }
    worst / scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_residual_is_the_gradient_that_no_bound_explains() {
        let (h, g) = ([[2.0, 0.0], [0.0, 4.0]], [-2.0, 4.0]);
        let free = ActiveBounds::default();
        let of = |x: [f64; 2], active| residual(&h, &g, &x, active);
        assert_eq!(of([1.0, -1.0], free), 0.0);
        // Gradient 2 and 4 of terms that add up to 4 + 2 and 4 + 0.
        assert_eq!(of([2.0, 0.0], free), 4.0 / 6.0);
        // A bound explains what pushes outward, and only that.
        assert_eq!(of([0.0, -1.0], ActiveBounds { lower: 0, upper: 1 }), 0.0);
        assert_eq!(of([2.0, -1.0], ActiveBounds { lower: 0, upper: 1 }), 2.0 / 8.0);
        assert_eq!(of([1.0, 0.0], ActiveBounds { lower: 2, upper: 0 }), 0.0);
        assert_eq!(of([1.0, -2.0], ActiveBounds { lower: 2, upper: 0 }), 4.0 / 12.0);
        assert!(of([f64::NAN, -1.0], free).is_nan());
    }
}
