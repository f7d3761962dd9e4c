//! Exact dual active set (after Goldfarb and Idnani) for two-sided rows, hard or soft, in Gram form.
//!
//! min ½ uᵀH u + qᵀu + Σ ρ_i · dist(c_iᵀu, \[lower_i, upper_i\]), ρ_i = ∞ for a hard row. The solver sees
//! only the rows' values r = C u, which obey r = r⁰ − G z with r⁰ the values at the unconstrained optimum and
//! G = C H⁻¹ Cᵀ. The signed multipliers −ρ ≤ z ≤ ρ are what it looks for: z > 0 holds a row down at its upper
//! bound, z < 0 holds it up at its lower one, |z| = ρ is a saturated soft row, violated with constant force.
//! Every step of positive length raises the dual objective, hence no cycling; rounding could still cycle,
//! hence the iteration cap. A row dependent on the active ones moves the multipliers only, until one leaves
//! or saturates.
//!
//! Source: Goldfarb and Idnani, "A numerically stable dual method for solving strictly convex quadratic
//! programs", Math. Prog. 27 (1983), algorithm section 3; the upper bound on the multipliers is ours.

#![expect(
    clippy::needless_range_loop,
    reason = "triangular loops over several arrays read best with indices"
)]

use crate::state::state;

/// One number per row: `B` blocks of `L` rows. Row `k` is entry `k % L` of block `k / L`. (Blocks, because
/// four limits on each of N steps are then typed by N alone.)
pub type Rows<const B: usize, const L: usize> = [[f64; L]; B];

/// A Gram column whose remainder is below this share of its diagonal is rounding: the row is dependent.
const DEPENDENT: f64 = 1e-12;

/// What the rows must satisfy.
#[derive(Debug, Clone, Copy)]
pub struct Bounds<const B: usize, const L: usize> {
    /// May be −∞; not above `upper`.
    pub lower: Rows<B, L>,
    /// Upper bounds; they may be +∞.
    pub upper: Rows<B, L>,
    /// ρ > 0 per unit of violation; +∞ makes the row hard.
    pub penalty: Rows<B, L>,
    /// Positive scale by which violations are compared; 1/√G_ii is best, any is correct.
    pub weight: Rows<B, L>,
}

state! { [const B: usize, const L: usize] Bounds<B, L> { lower, upper, penalty, weight } }

/// Columns of G = C H⁻¹ Cᵀ, asked for one by one.
pub trait Gram<const B: usize, const L: usize> {
    /// Write column `row` (< B·L) of G.
    fn column(&self, row: usize, out: &mut Rows<B, L>);
}

/// How the active set ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Termination {
    /// No row is violated by more than the tolerance.
    Optimal,
    /// The iterations did not suffice.
    IterationCap,
    /// Hard rows contradict each other.
    Infeasible,
}

/// Workspace and result; `W` is the most rows that can be independent (the number of variables).
#[derive(Debug, Clone)]
pub struct DualActiveSet<const B: usize, const L: usize, const W: usize> {
    multiplier: Rows<B, L>,
    /// What each row must satisfy in its present state: both bounds while inactive, the outer side of its
    /// bound while saturated.
    lower: Rows<B, L>,
    upper: Rows<B, L>,
    count: usize,
    row: [usize; W],
    /// +1 at the upper bound, −1 at the lower.
    side: [f64; W],
    columns: [Rows<B, L>; W],
    /// Cholesky factor of G over the active rows: lower triangle, row by row.
    factor: [[f64; W]; W],
    reciprocal: [f64; W],
}

state! {
    [const B: usize, const L: usize, const W: usize] DualActiveSet<B, L, W> {
        multiplier, lower, upper, count, row, side, columns, factor, reciprocal,
    }
}

/// What ends a step.
#[derive(Clone, Copy, PartialEq)]
enum StepEnd {
    Full,
    Own,
    Active { slot: usize, saturates: bool },
}

impl<const B: usize, const L: usize, const W: usize> Default for DualActiveSet<B, L, W> {
    fn default() -> Self {
        Self {
            multiplier: [[0.0; L]; B],
            lower: [[0.0; L]; B],
            upper: [[0.0; L]; B],
            count: 0,
            row: [0; W],
            side: [0.0; W],
            columns: [[[0.0; L]; B]; W],
            factor: [[0.0; W]; W],
            reciprocal: [0.0; W],
        }
    }
}

impl<const B: usize, const L: usize, const W: usize> DualActiveSet<B, L, W> {
    /// Solve from no active row. `value` holds r⁰ on entry and r on return; multipliers and active rows stay
    /// readable in `self`. Returns the termination and the number of steps, at most `max_iterations`.
    #[inline]
    pub fn solve(
        &mut self,
        gram: &impl Gram<B, L>,
        bounds: &Bounds<B, L>,
        tolerance: f64,
        max_iterations: u32,
        value: &mut Rows<B, L>,
    ) -> (Termination, u32) {
        self.multiplier = [[0.0; L]; B];
        self.lower = bounds.lower;
        self.upper = bounds.upper;
        self.count = 0;
        let mut iterations = 0;
        let mut column = [[0.0; L]; B];
        while let Some(entering) = self.most_violated(bounds, tolerance, value) {
            gram.column(entering, &mut column);
            loop {
                if iterations >= max_iterations {
                    return (Termination::IterationCap, iterations);
                }
                iterations += 1;
                match self.step(entering, &column, bounds, value) {
                    None => return (Termination::Infeasible, iterations),
                    Some(StepEnd::Active { .. }) => {}
                    Some(StepEnd::Full | StepEnd::Own) => break,
                }
            }
        }
        (Termination::Optimal, iterations)
    }

    /// Signed multipliers z: positive at the upper bound.
    #[must_use]
    pub const fn multipliers(&self) -> &Rows<B, L> {
        &self.multiplier
    }

    /// The active rows with their side (+1 upper, −1 lower), in order of entry.
    pub fn active(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.row.iter().copied().zip(self.side.iter().copied()).take(self.count)
    }

    /// Move the active multipliers so that the active rows change by −`change` (in order of entry), the
    /// others being still: one step of iterative refinement. Returns Σ G_·j Δz_j, by which all rows drop.
    ///
    /// A multiplier that rounding put on the wrong side of 0 or ρ ends exactly there, its row inactive.
    #[inline]
    #[expect(clippy::indexing_slicing, reason = "slots are below count <= W")]
    pub fn correct(&mut self, change: &[f64; W], bounds: &Bounds<B, L>) -> Rows<B, L> {
        let mut delta = self.forward(change);
        self.backward(&mut delta);
        let mut dropped = [[0.0; L]; B];
        for slot in (0..self.count.min(W)).rev() {
            let row = self.row[slot];
            let penalty = bounds.penalty.as_flattened()[row];
            let before = self.multiplier.as_flattened()[row];
            let inward = self.side[slot] * (before + delta[slot]);
            let kept = inward.max(0.0).min(penalty);
            let after = self.side[slot] * kept;
            // A multiplier may be as large as ρ: `after − before` would round off the refinement.
            let moved = if kept == inward { delta[slot] } else { after - before };
            add_scaled(&mut dropped, &self.columns[slot], moved);
            self.multiplier.as_flattened_mut()[row] = after;
            if kept != inward {
                self.remove(slot);
                self.leave(row, after, bounds);
            }
        }
        dropped
    }

    /// The row that violates its present bounds most by weight, if any does by more than `tolerance`.
    ///
    /// Passes without branches over all rows, with four running maxima, so that the compiler vectorises both.
    #[inline]
    fn most_violated(&self, bounds: &Bounds<B, L>, tolerance: f64, value: &Rows<B, L>) -> Option<usize> {
        let mut scores = [[0.0; L]; B];
        let limits = self.lower.as_flattened().iter().zip(self.upper.as_flattened());
        let rows = value.as_flattened().iter().zip(limits).zip(bounds.weight.as_flattened());
        for (score, ((r, (lower, upper)), weight)) in scores.as_flattened_mut().iter_mut().zip(rows) {
            let (above, below) = (r - upper, lower - r);
            let violation = if above > below { above } else { below };
            let weighted = violation * weight;
            *score = if violation > tolerance { weighted } else { 0.0 };
        }
        let (fours, rest) = scores.as_flattened().as_chunks::<4>();
        let mut worst = [0.0; 4];
        for four in fours {
            for (worst, score) in worst.iter_mut().zip(four) {
                *worst = if *score > *worst { *score } else { *worst };
            }
        }
        let worst = worst.iter().chain(rest).fold(0.0, |worst: f64, score| worst.max(*score));
        if worst > 0.0 { scores.as_flattened().iter().position(|score| *score == worst) } else { None }
    }

    /// Raises or lowers the multiplier of row `p` until the row meets its bound or another row blocks. `None`
    /// if nothing ever would.
    #[inline]
    #[expect(
        clippy::indexing_slicing,
        reason = "p < B*L comes from most_violated, slots are below count <= W"
    )]
    fn step(
        &mut self,
        p: usize,
        column: &Rows<B, L>,
        bounds: &Bounds<B, L>,
        value: &mut Rows<B, L>,
    ) -> Option<StepEnd> {
        let count = self.count.min(W);
        let entries = column.as_flattened();
        let mut against = [0.0; W];
        for slot in 0..count {
            against[slot] = entries[self.row[slot]];
        }
        let half = self.forward(&against);
        let mut curvature = entries[p];
        for entry in half.iter().take(count) {
            curvature -= entry * entry;
        }
        let independent = count < W && curvature > DEPENDENT * entries[p];
        let mut rate = half;
        self.backward(&mut rate);

        let r = value.as_flattened()[p];
        let z = self.multiplier.as_flattened()[p];
        let penalty = bounds.penalty.as_flattened()[p];
        let above = r - self.upper.as_flattened()[p];
        let below = self.lower.as_flattened()[p] - r;
        let (sign, violation) = if above > below { (1.0, above) } else { (-1.0, below) };
        let saturated = z != 0.0 && sign * z < 0.0;

        let mut length = if saturated { z.abs() } else { penalty - z.abs() };
        let mut block = StepEnd::Own;
        if independent {
            let full = violation.max(0.0) / curvature;
            if full <= length {
                length = full;
                block = StepEnd::Full;
            }
        }
        for slot in 0..count {
            let inward = self.side[slot] * self.multiplier.as_flattened()[self.row[slot]];
            let slope = -sign * rate[slot] * self.side[slot];
            let room = if slope < 0.0 {
                inward.max(0.0) / -slope
            } else if slope > 0.0 {
                (bounds.penalty.as_flattened()[self.row[slot]] - inward).max(0.0) / slope
            } else {
                f64::INFINITY
            };
            if room < length {
                length = room;
                block = StepEnd::Active { slot, saturates: slope > 0.0 };
            }
        }
        let bounded = length < f64::INFINITY;
        if !bounded {
            return None;
        }

        let signed = sign * length;
        add_scaled(value, column, -signed);
        for slot in 0..count {
            let change = signed * rate[slot];
            add_scaled(value, &self.columns[slot], change);
            self.multiplier.as_flattened_mut()[self.row[slot]] -= change;
        }
        let multiplier = z + signed;
        self.multiplier.as_flattened_mut()[p] = multiplier;
        match block {
            StepEnd::Full => {
                let side = if saturated { -sign } else { sign };
                self.append(p, side, column, &half, curvature);
            }
            StepEnd::Own if saturated => self.leave(p, 0.0, bounds),
            StepEnd::Own => self.leave(p, sign * penalty, bounds),
            StepEnd::Active { slot, saturates } => {
                let row = self.row[slot];
                let bound = bounds.penalty.as_flattened()[row];
                let end = if saturates { self.side[slot] * bound } else { 0.0 };
                self.remove(slot);
                self.leave(row, end, bounds);
            }
        }
        Some(block)
    }

    /// Fix the multiplier of a row that is not active and set what the row must satisfy from now on.
    #[inline]
    #[expect(clippy::indexing_slicing, reason = "row < B*L")]
    fn leave(&mut self, row: usize, multiplier: f64, bounds: &Bounds<B, L>) {
        let (lower, upper) = (bounds.lower.as_flattened()[row], bounds.upper.as_flattened()[row]);
        self.multiplier.as_flattened_mut()[row] = multiplier;
        let (lower, upper) = if multiplier > 0.0 {
            (upper, f64::INFINITY)
        } else if multiplier < 0.0 {
            (f64::NEG_INFINITY, lower)
        } else {
            (lower, upper)
        };
        self.lower.as_flattened_mut()[row] = lower;
        self.upper.as_flattened_mut()[row] = upper;
    }

    #[inline]
    #[expect(clippy::indexing_slicing, reason = "count < W is checked by the caller through `independent`")]
    fn append(&mut self, row: usize, side: f64, column: &Rows<B, L>, half: &[f64; W], curvature: f64) {
        let slot = self.count;
        self.row[slot] = row;
        self.side[slot] = side;
        self.columns[slot] = *column;
        self.factor[slot] = *half;
        let root = curvature.sqrt();
        self.factor[slot][slot] = root;
        self.reciprocal[slot] = 1.0 / root;
        self.lower.as_flattened_mut()[row] = f64::NEG_INFINITY;
        self.upper.as_flattened_mut()[row] = f64::INFINITY;
        self.count = slot + 1;
    }

    /// Take a slot out of the factor: shift the rows below up and restore the triangle by Givens rotations.
    #[inline]
    #[expect(clippy::indexing_slicing, reason = "slot < count <= W")]
    fn remove(&mut self, slot: usize) {
        let count = self.count.min(W);
        for k in slot + 1..count {
            self.row[k - 1] = self.row[k];
            self.side[k - 1] = self.side[k];
            self.columns[k - 1] = self.columns[k];
            self.factor[k - 1] = self.factor[k];
        }
        self.count = count - 1;
        for k in slot..self.count {
            let (a, b) = (self.factor[k][k], self.factor[k][k + 1]);
            let radius = a.hypot(b);
            let (cos, sin) = (a / radius, b / radius);
            self.factor[k][k] = radius;
            self.reciprocal[k] = 1.0 / radius;
            for below in k + 1..self.count {
                let (left, right) = (self.factor[below][k], self.factor[below][k + 1]);
                self.factor[below][k] = cos * left + sin * right;
                self.factor[below][k + 1] = cos * right - sin * left;
            }
        }
    }

    /// L⁻¹ b over the active slots; the rest is zero.
    #[inline]
    #[expect(clippy::indexing_slicing, reason = "slots are below count <= W")]
    fn forward(&self, b: &[f64; W]) -> [f64; W] {
        let mut x = [0.0; W];
        for i in 0..self.count.min(W) {
            let mut sum = b[i];
            for k in 0..i {
                sum -= self.factor[i][k] * x[k];
            }
            x[i] = sum * self.reciprocal[i];
        }
        x
    }

    /// Replace x by L⁻ᵀ x over the active slots.
    #[inline]
    #[expect(clippy::indexing_slicing, reason = "slots are below count <= W")]
    fn backward(&self, x: &mut [f64; W]) {
        for i in (0..self.count.min(W)).rev() {
            let scaled = x[i] * self.reciprocal[i];
            x[i] = scaled;
            for k in 0..i {
                x[k] -= self.factor[i][k] * scaled;
            }
        }
    }
}

#[inline]
fn add_scaled<const B: usize, const L: usize>(target: &mut Rows<B, L>, source: &Rows<B, L>, scale: f64) {
    for (to, from) in target.as_flattened_mut().iter_mut().zip(source.as_flattened()) {
        *to += scale * from;
    }
}
