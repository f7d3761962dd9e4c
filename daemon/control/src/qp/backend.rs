//! Which solver answers: the exact ones of this room, or another of the same problems, for comparison.

use nalgebra::{SMatrix, SVector};

use super::QpStatus;
use super::box_qp::{ActiveBounds, BoxSolution, judged};
use crate::state::{Reader, State, StateError, Writer, state};

/// Which solver answers.
#[derive(Debug, Clone, Copy, Default)]
pub enum Backend {
    /// The exact dual active set. Allocates nothing.
    #[default]
    Exact,
    /// Another solver. May allocate; its accuracy is its own. Inverse kinematics with clearance or envelope
    /// rows stays with the exact one.
    Other(&'static dyn OtherSolver),
}

/// By the solver's name.
impl PartialEq for Backend {
    fn eq(&self, other: &Self) -> bool {
        let name = |backend: &Self| match backend {
            Self::Exact => None,
            Self::Other(solver) => Some(solver.name()),
        };
        name(self) == name(other)
    }
}

/// A solver of [`SoftRows`] that is not of this crate.
pub trait OtherSolver: std::fmt::Debug + Sync {
    /// Name, as messages and comparisons have it.
    fn name(&self) -> &'static str;

    /// Sets up problems of `variables` = N unknowns. `rows`: M x N, row by row; `penalties`: M, +∞ for a hard
    /// row. `None` when the solver refuses.
    fn set_up(&self, rows: &[f64], variables: usize, penalties: &[f64]) -> Option<Box<dyn SoftRows>>;
}

/// min ½ uᵀH u + qᵀu + Σ ρ_i · dist(c_iᵀu, \[lower_i, upper_i\]) with constant rows C and penalties ρ.
pub trait SoftRows: std::fmt::Debug + Send {
    /// Solve for H (N·N, symmetric), `linear` q (N) and the rows' bounds (M each), into `solution` (N) and
    /// the signed `multipliers` (M, positive at the upper bound, exactly ±ρ where saturated, 0 where idle).
    ///
    /// *Status*: `Inexact` is success; `NotFinite`, `Infeasible`, `IterationCap`, `Uncertified` are not.
    fn solve(
        &mut self,
        hessian: &[f64],
        linear: &[f64],
        lower: &[f64],
        upper: &[f64],
        solution: &mut [f64],
        multipliers: &mut [f64],
    ) -> Solved;
}

/// How a solve ended; the solution is in the caller's slices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Solved {
    /// `Inexact` when the solver reports success.
    pub status: QpStatus,
    /// Steps of the solver's method.
    pub iterations: u32,
}

/// The solver keeps its memory to itself.
impl State for dyn SoftRows {
    fn save(&self, to: &mut Writer<'_>) {
        to.give_up();
    }

    fn load(&mut self, _from: &mut Reader<'_>) -> Result<(), StateError> {
        Err(StateError::Foreign)
    }
}

/// [`super::box_qp::solve`] by another solver.
#[derive(Debug)]
pub struct OtherBox<const J: usize> {
    qp: Box<dyn SoftRows>,
}

state! { [const J: usize] OtherBox<J> { qp } }

impl<const J: usize> OtherBox<J> {
    /// `None` when the solver refuses.
    #[must_use]
    pub fn new(solver: &dyn OtherSolver) -> Option<Self> {
        let identity = SMatrix::<f64, J, J>::identity();
        Some(Self { qp: solver.set_up(identity.as_slice(), J, &[f64::INFINITY; J])? })
    }

    /// The same contract as [`super::box_qp::solve`], with `Inexact` for success. The answer is clamped into
    /// the box; the residual is that of the answer with its active coordinates on their bounds.
    pub fn solve(
        &mut self,
        h: &SMatrix<f64, J, J>,
        g: &SVector<f64, J>,
        lower: &SVector<f64, J>,
        upper: &SVector<f64, J>,
    ) -> BoxSolution<J> {
        let mut x = SVector::<f64, J>::zeros();
        let mut multipliers = [0.0; J];
        let solved = self.qp.solve(
            h.as_slice(),
            g.as_slice(),
            lower.as_slice(),
            upper.as_slice(),
            x.as_mut_slice(),
            &mut multipliers,
        );
        let mut active = ActiveBounds::default();
        for (i, z) in multipliers.iter().enumerate() {
            active.upper |= u32::from(*z > 0.0) << i;
            active.lower |= u32::from(*z < 0.0) << i;
        }
        judged(h, g, lower, upper, &x, active, solved.status, solved.iterations)
    }
}
