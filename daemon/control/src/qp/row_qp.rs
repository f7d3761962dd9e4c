//! Exact minimiser of a small strictly convex quadratic over a box with additional soft rows: the joint
//! velocities of a tick near obstacles or bounds.
//!
//! min ½ xᵀH x + gᵀx + ρ Σ_k max(b_k − c_kᵀx, 0), lower ≤ x ≤ upper. The box is hard; rows yield to it and to
//! each other with the least sum of violations, so no set of rows is infeasible. With ρ above every
//! multiplier a row holds exactly wherever it can. Contract: no allocation, no panic; an `Optimal` answer
//! lies in the box exactly and its KKT residual was computed from H, g and the rows themselves.

use crate::state::state;
use nalgebra::{SMatrix, SVector};

use super::box_qp::{ActiveBounds, clamped, factored, pinned};
use super::cholesky::{Cholesky, Square};
use super::dual::{Bounds, DualActiveSet, Gram, Rows, Termination};
use super::{KKT_TOLERANCE, QpStatus};

/// Rows come in this many blocks of J.
const BLOCKS: usize = 3;

/// Price ρ of one unit of violation \[units of g per unit of c\].
pub const PENALTY: f64 = 1e3;

/// A smaller violation of a bound or row counts as none, until the answer is refined \[units of x, units of
/// b\].
const FEASIBILITY: f64 = 1e-9;

/// Largest violation of a row that carries no penalty in the answer \[units of b\].
pub const ROW_TOLERANCE: f64 = 1e-8;

/// Up to 3·J rows c_kᵀx ≥ b_k.
#[derive(Debug, Clone, Copy)]
pub struct RowSet<const J: usize> {
    coefficients: [[[f64; J]; J]; BLOCKS],
    lower: Rows<BLOCKS, J>,
    count: usize,
}

state! { [const J: usize] RowSet<J> { coefficients, lower, count } }

impl<const J: usize> Default for RowSet<J> {
    fn default() -> Self {
        Self { coefficients: [[[0.0; J]; J]; BLOCKS], lower: [[f64::NEG_INFINITY; J]; BLOCKS], count: 0 }
    }
}

impl<const J: usize> PartialEq for RowSet<J> {
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl<const J: usize> RowSet<J> {
    /// Most rows that there is room for.
    pub const CAPACITY: usize = BLOCKS * J;

    /// Puts a row at `slot`, which must be at most [`Self::len`] and below [`Self::CAPACITY`]; else nothing
    /// changes.
    pub fn put(&mut self, slot: usize, coefficients: &[f64; J], lower: f64) {
        if slot > self.count {
            return;
        }
        let rows = self.coefficients.as_flattened_mut().iter_mut().zip(self.lower.as_flattened_mut());
        if let Some((row, bound)) = rows.skip(slot).take(1).next() {
            (*row, *bound) = (*coefficients, lower);
            self.count = self.count.max(slot + 1);
        }
    }

    /// Removes all rows; the memory stays.
    pub fn clear(&mut self) {
        let rows = self.coefficients.as_flattened_mut().iter_mut().zip(self.lower.as_flattened_mut());
        for (row, bound) in rows.take(self.count) {
            (*row, *bound) = ([0.0; J], f64::NEG_INFINITY);
        }
        self.count = 0;
    }

    /// Number of rows that it has.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.count
    }

    /// It has no rows at all.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// c_k and b_k in order.
    pub fn iter(&self) -> impl Iterator<Item = (&[f64; J], f64)> + Clone {
        let rows = self.coefficients.as_flattened().iter();
        rows.zip(self.lower.as_flattened().iter().copied()).take(self.count)
    }

    /// `x` violates no row by more than `tolerance`.
    #[must_use]
    pub fn kept_by(&self, x: &[f64; J], tolerance: f64) -> bool {
        self.iter().all(|(c, lower)| dot(c, x) >= lower - tolerance)
    }
}

/// What [`solve`] found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowSolution<const J: usize> {
    /// The minimiser; inside the box whatever the status, as long as the box is finite and not empty.
    pub x: SVector<f64, J>,
    /// `Optimal`, or why `x` must not be used.
    pub status: QpStatus,
    /// Steps of the active set.
    pub iterations: u32,
    /// The bounds that hold `x`.
    pub active: ActiveBounds,
    /// The rows that hold `x`, bit k for row k.
    pub held: u32,
    /// The rows that could not be satisfied, bit k for row k.
    pub yielded: u32,
    /// Largest gradient component that no bound or row explains, relative to the largest sum of absolute
    /// terms of a component; NaN if nothing was solved.
    pub kkt_residual: f64,
}

/// Minimise ½ xᵀH x + gᵀx + ρ·(violations of `rows`) over the box.
///
/// `h`: J x J, symmetric positive definite; `g`, `lower`, `upper`: J. A bound may be infinite, none may be
/// NaN.
///
/// *Status*: `NotFinite` for a non-finite H, g or row or a NaN bound, `Infeasible` for an empty box,
/// `NotConvex`, `IterationCap` (after 64 J steps), `Uncertified`.
#[must_use]
pub fn solve<const J: usize>(
    h: &SMatrix<f64, J, J>,
    g: &SVector<f64, J>,
    lower: &SVector<f64, J>,
    upper: &SVector<f64, J>,
    rows: &RowSet<J>,
) -> RowSolution<J> {
    let ([[g]], [[lower]], [[upper]]) = ([g.data.0], [lower.data.0], [upper.data.0]);
    let h = &h.data.0;
    let failed = |status| RowSolution {
        x: SVector::from(clamped(&[0.0; J], &lower, &upper)),
        status,
        iterations: 0,
        active: ActiveBounds::default(),
        held: 0,
        yielded: 0,
        kkt_residual: f64::NAN,
    };
    if !rows.iter().all(|(c, lower)| c.iter().all(|entry| entry.is_finite()) && lower.is_finite()) {
        return failed(QpStatus::NotFinite);
    }
    let factor = match factored(h, &g, &lower, &upper) {
        Ok(factor) => factor,
        Err(status) => return failed(status),
    };

    let start = factor.solve(&g.map(|entry| -entry));
    let [r0, r1, r2] = rows.coefficients.map(|block| block.map(|c| dot(&c, &start)));
    let mut value = [start, r0, r1, r2];
    let [b0, b1, b2] = rows.lower;
    let bounds = Bounds {
        lower: [lower, b0, b1, b2],
        upper: [upper, [f64::INFINITY; J], [f64::INFINITY; J], [f64::INFINITY; J]],
        penalty: [[f64::INFINITY; J], [PENALTY; J], [PENALTY; J], [PENALTY; J]],
        weight: [[1.0; J]; 4],
    };
    let mut set = DualActiveSet::<4, J, J>::default();
    let gram = BoxAndRows { factor: &factor, rows };
    let (termination, iterations) = set.solve(&gram, &bounds, FEASIBILITY, 64 * J as u32, &mut value);
    let [found, ..] = value;
    let inside = SVector::from(clamped(&found, &lower, &upper));
    match termination {
        Termination::Optimal => {}
        Termination::IterationCap => {
            return RowSolution { iterations, x: inside, ..failed(QpStatus::IterationCap) };
        }
        Termination::Infeasible => {
            return RowSolution { iterations, x: inside, ..failed(QpStatus::Infeasible) };
        }
    }
    let mut state = WorkingSet { active: ActiveBounds::default(), held: 0, yielded: 0 };
    for (row, side) in set.active() {
        match row.checked_sub(J) {
            None if side > 0.0 => state.active.upper |= 1 << row,
            None => state.active.lower |= 1 << row,
            Some(row) => state.held |= 1 << row,
        }
    }
    for (k, z) in set.multipliers().as_flattened().iter().skip(J).enumerate() {
        state.yielded |= u32::from(-z >= PENALTY && state.held >> k & 1 == 0) << k;
    }
    let problem = RowProblem { h, g: &g, lower: &lower, upper: &upper, rows };
    let Some((x, multipliers)) = problem.refined(&found, &state) else {
        return RowSolution { iterations, x: inside, ..failed(QpStatus::Uncertified) };
    };
    let x = clamped(&x, &lower, &upper);
    let kkt_residual = problem.residual(&x, &multipliers, &state);
    let certified = kkt_residual <= KKT_TOLERANCE && problem.rows_kept(&x, &state);
    RowSolution {
        x: SVector::from(x),
        status: if certified { QpStatus::Optimal } else { QpStatus::Uncertified },
        iterations,
        active: state.active,
        held: state.held,
        yielded: state.yielded,
        kkt_residual,
    }
}

/// C = \[1; c_0ᵀ; c_1ᵀ; ...\], hence the Gram matrix C H⁻¹ Cᵀ.
struct BoxAndRows<'a, const J: usize> {
    factor: &'a Cholesky<J>,
    rows: &'a RowSet<J>,
}

impl<const J: usize> Gram<4, J> for BoxAndRows<'_, J> {
    fn column(&self, row: usize, out: &mut Rows<4, J>) {
        let mut source = [0.0; J];
        match row.checked_sub(J) {
            None => {
                if let Some(entry) = source.get_mut(row) {
                    *entry = 1.0;
                }
            }
            Some(row) => {
                if let Some(c) = self.rows.coefficients.as_flattened().get(row) {
                    source = *c;
                }
            }
        }
        let moved = self.factor.solve(&source);
        let [r0, r1, r2] = self.rows.coefficients.map(|block| block.map(|c| dot(&c, &moved)));
        *out = [moved, r0, r1, r2];
    }
}

/// What holds the solution.
struct WorkingSet {
    active: ActiveBounds,
    held: u32,
    yielded: u32,
}

struct RowProblem<'a, const J: usize> {
    h: &'a Square<J>,
    g: &'a [f64; J],
    lower: &'a [f64; J],
    upper: &'a [f64; J],
    rows: &'a RowSet<J>,
}

impl<const J: usize> RowProblem<'_, J> {
    /// Solves for the solution and the row multipliers again, from H itself instead of updated quantities: x
    /// = x₀ + H⁻¹Cᵀλ over the free coordinates, (C H⁻¹ Cᵀ) λ = b − C x₀ over the held rows.
    #[expect(clippy::indexing_slicing, reason = "every index runs over 0..J of an [_; J]")]
    fn refined(&self, found: &[f64; J], state: &WorkingSet) -> Option<([f64; J], Rows<BLOCKS, J>)> {
        let free = |i: usize| (state.active.lower | state.active.upper) >> i & 1 == 0;
        let x = pinned(found, self.lower, self.upper, state.active);
        let mut right = [0.0; J];
        let mut reduced = [[0.0; J]; J];
        for i in 0..J {
            if !free(i) {
                reduced[i][i] = 1.0;
                right[i] = x[i];
                continue;
            }
            right[i] = -self.g[i];
            for j in 0..J {
                if free(j) {
                    reduced[i][j] = self.h[i][j];
                } else {
                    right[i] -= self.h[i][j] * x[j];
                }
            }
            for (k, (c, _)) in self.rows.iter().enumerate() {
                if state.yielded >> k & 1 == 1 {
                    right[i] += PENALTY * c[i];
                }
            }
        }
        let factor = Cholesky::new(&reduced)?;
        let mut x = factor.solve(&right);

        let mut across = [[0.0; J]; J];
        let mut schur = [[0.0; J]; J];
        let mut gap = [0.0; J];
        let held = self.rows.iter().enumerate().filter(|(k, _)| state.held >> k & 1 == 1);
        for (slot, (_, (c, bound))) in held.clone().enumerate().take(J) {
            let mut on_free = *c;
            for i in 0..J {
                if !free(i) {
                    on_free[i] = 0.0;
                }
            }
            across[slot] = factor.solve(&on_free);
            gap[slot] = bound - dot(c, &x);
            for (other, (_, (c, _))) in held.clone().enumerate().take(slot + 1) {
                schur[slot][other] = dot(c, &across[slot]);
            }
        }
        for (slot, row) in schur.iter_mut().enumerate().skip(held.clone().count()) {
            row[slot] = 1.0;
        }
        let forces = Cholesky::new(&schur)?.solve(&gap);
        let mut multipliers = [[0.0; J]; BLOCKS];
        for (slot, (k, _)) in held.enumerate().take(J) {
            if let Some(multiplier) = multipliers.as_flattened_mut().get_mut(k) {
                *multiplier = forces[slot];
            }
            for i in 0..J {
                x[i] += forces[slot] * across[slot][i];
            }
        }
        for (k, multiplier) in multipliers.as_flattened_mut().iter_mut().enumerate() {
            if state.yielded >> k & 1 == 1 {
                *multiplier = PENALTY;
            }
        }
        Some((x, multipliers))
    }

    /// Stationarity and the signs of all multipliers.
    fn residual(&self, x: &[f64; J], multipliers: &Rows<BLOCKS, J>, state: &WorkingSet) -> f64 {
        let mut worst = 0.0_f64;
        let mut scale = f64::MIN_POSITIVE;
        for (i, (row, g)) in self.h.iter().zip(self.g).enumerate() {
            let mut gradient = *g;
            let mut size = g.abs();
            let forces = self.rows.iter().zip(multipliers.as_flattened());
            let forces = forces.filter_map(|((c, _), force)| Some(-force * c.get(i)?));
            for term in row.iter().zip(x).map(|(h, x)| h * x).chain(forces) {
                gradient += term;
                size += term.abs();
            }
            let unexplained = if state.active.upper >> i & 1 == 1 {
                gradient.max(0.0)
            } else if state.active.lower >> i & 1 == 1 {
                (-gradient).max(0.0)
            } else {
                gradient.abs()
            };
            // f64::max drops a NaN; a residual must propagate it.
            if unexplained.is_nan() {
                return unexplained;
            }
            worst = worst.max(unexplained);
            scale = scale.max(size);
        }
        for (k, force) in multipliers.as_flattened().iter().enumerate() {
            if state.held >> k & 1 == 1 {
                worst = worst.max(-force).max(force - PENALTY);
            }
        }
        worst / scale
    }

    /// Every row is on the side that its multiplier requires.
    fn rows_kept(&self, x: &[f64; J], state: &WorkingSet) -> bool {
        self.rows.iter().enumerate().all(|(k, (c, bound))| {
            let slack = dot(c, x) - bound;
            if state.yielded >> k & 1 == 1 {
                slack <= ROW_TOLERANCE
            } else if state.held >> k & 1 == 1 {
                slack.abs() <= ROW_TOLERANCE
            } else {
                slack >= -ROW_TOLERANCE
            }
        })
    }
}

fn dot<const J: usize>(a: &[f64; J], b: &[f64; J]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
