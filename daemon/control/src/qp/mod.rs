//! Small strictly convex quadratic programs, solved exactly and certified.
//!
//! Contract: bounded work, no allocation, no panic. A solution is `Optimal` only if its KKT residual is at
//! most [`KKT_TOLERANCE`]; anything else says so and the caller falls back. Another solver of the same
//! problems can answer instead ([`backend`]), for comparison.

use crate::state::choices;

pub mod cholesky;
pub mod dual;
pub mod box_qp;
pub mod row_qp;
pub(crate) mod offered;
pub mod backend;

/// Largest KKT residual of a solution called optimal, relative to the size of the problem's own gradient.
pub const KKT_TOLERANCE: f64 = 1e-9;

/// How a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum QpStatus {
    /// The unique optimum, certified by its KKT residual.
    Optimal,
    /// Solved by an interior-point method to its own tolerance, which is looser than [`KKT_TOLERANCE`].
    Inexact,
    /// The active set ended but the certificate failed: do not use.
    Uncertified,
    /// Out of iterations: do not use.
    IterationCap,
    /// The hard rows contradict each other.
    Infeasible,
    /// The cost matrix is not positive definite.
    NotConvex,
    /// Some input was NaN or infinite, or nothing was solved yet.
    #[default]
    NotFinite,
}

choices! { QpStatus { Optimal, Inexact, Uncertified, IterationCap, Infeasible, NotConvex, NotFinite } }

impl QpStatus {
    /// The solution may be used.
    #[must_use]
    pub const fn usable(self) -> bool {
        matches!(self, Self::Optimal | Self::Inexact)
    }
}
