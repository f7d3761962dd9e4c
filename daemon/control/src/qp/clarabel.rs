//! Clarabel as a second solver for the same problems: selectable backend, and reference in tests.
//!
//! Built once, data updated in place: presolve and zero-dropping off, every structural zero kept, bounds
//! finite. Soft rows get a slack each. The only file that names clarabel. Contract: never panics on
//! non-finite numbers, but each solve allocates once or twice inside clarabel (its timers), and an answer
//! with active rows is accurate to about 1e-2 of a limit although its objective is accurate to 1e-8.

use crate::state::{Reader, State, StateError, Writer};
use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::NonnegativeConeT;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};
use nalgebra::{SMatrix, SVector};

use super::QpStatus;
use super::box_qp::{ActiveBounds, BoxSolution};

/// Stands in for an infinite bound, which data updates do not allow.
const FAR: f64 = 1e9;
/// Interior-point steps; well-scaled problems take 10 to 25.
const MAX_ITERATIONS: u32 = 60;

/// Which settings of Clarabel are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ClarabelProfile {
    /// The settings that Clarabel has by default.
    Default,
    /// Equilibration and iterative refinement off, tolerances 1e-8: more than twice as fast and as accurate,
    /// but only on data already scaled to the order of one.
    #[default]
    Tuned,
}

/// How a solve ended; the solution is in the caller's slices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Solved {
    /// `Inexact` when clarabel reports success.
    pub status: QpStatus,
    /// Steps of the interior-point method.
    pub iterations: u32,
}

/// min ½ uᵀH u + qᵀu + Σ ρ_i · dist(c_iᵀu, \[lower_i, upper_i\]) with constant rows C and penalties ρ.
pub struct SoftRowQp {
    solver: DefaultSolver<f64>,
    variables: usize,
    /// ρ per row, +∞ for hard.
    penalties: Vec<f64>,
    /// Upper triangle of H, column by column, as clarabel has it now.
    hessian: Vec<f64>,
    linear: Vec<f64>,
    /// Upper bounds, minus lower bounds, zeros for the slacks.
    right: Vec<f64>,
}

/// The solver keeps its memory to itself.
impl State for SoftRowQp {
    fn save(&self, to: &mut Writer<'_>) {
        to.give_up();
    }

    fn load(&mut self, _from: &mut Reader<'_>) -> Result<(), StateError> {
        Err(StateError::Foreign)
    }
}

impl std::fmt::Debug for SoftRowQp {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SoftRowQp")
            .field("variables", &self.variables)
            .field("rows", &self.penalties.len())
            .finish_non_exhaustive()
    }
}

impl SoftRowQp {
    /// `rows`: M x N; `penalties`: M, +∞ for a hard row. `None` when clarabel refuses.
    #[must_use]
    pub fn new<const N: usize>(
        rows: &[[f64; N]],
        penalties: &[f64],
        profile: ClarabelProfile,
    ) -> Option<Self> {
        let soft: Vec<usize> =
            penalties.iter().enumerate().filter(|(_, rho)| rho.is_finite()).map(|(row, _)| row).collect();
        let size = N + soft.len();
        let mut linear = vec![0.0; N];
        linear.extend(penalties.iter().filter(|rho| rho.is_finite()));

        let mut triplets: Vec<(usize, usize, f64)> = Vec::new();
        for (i, row) in rows.iter().enumerate() {
            for (j, entry) in row.iter().enumerate().filter(|(_, entry)| **entry != 0.0) {
                triplets.push((i, j, *entry));
                triplets.push((rows.len() + i, j, -entry));
            }
        }
        for (slack, row) in soft.iter().enumerate() {
            triplets.push((*row, N + slack, -1.0));
            triplets.push((rows.len() + row, N + slack, -1.0));
            triplets.push((2 * rows.len() + slack, N + slack, -1.0));
        }
        let height = 2 * rows.len() + soft.len();
        let constraints = CscMatrix::new_from_triplets(
            height,
            size,
            triplets.iter().map(|entry| entry.0).collect(),
            triplets.iter().map(|entry| entry.1).collect(),
            triplets.iter().map(|entry| entry.2).collect(),
        );

        // Identity initially, but with the pattern of a full upper triangle.
        let mut pointers = vec![0];
        let (mut indices, mut hessian) = (Vec::new(), Vec::new());
        for column in 0..N {
            for row in 0..=column {
                indices.push(row);
                hessian.push(if row == column { 1.0 } else { 0.0 });
            }
            pointers.push(indices.len());
        }
        pointers.resize(size + 1, indices.len());
        let cost = CscMatrix::new(size, size, pointers, indices, hessian.clone());

        let mut right = vec![1.0; 2 * rows.len()];
        right.resize(height, 0.0);
        let cones = [NonnegativeConeT(height)];
        let solver =
            DefaultSolver::new(&cost, &linear, &constraints, &right, &cones, settings(profile)).ok()?;
        Some(Self { solver, variables: N, penalties: penalties.to_vec(), hessian, linear, right })
    }

    /// Solve for H (N·N, symmetric), `linear` q (N) and the rows' bounds (M each), into `solution` (N) and
    /// the signed `multipliers` (M, positive at the upper bound, exactly ±ρ where saturated, 0 where idle).
    ///
    /// *Status*: `Inexact` is success; `NotFinite`, `Infeasible`, `IterationCap`, `Uncertified` are not.
    pub fn solve(
        &mut self,
        hessian: &[f64],
        linear: &[f64],
        lower: &[f64],
        upper: &[f64],
        solution: &mut [f64],
        multipliers: &mut [f64],
    ) -> Solved {
        let failed = |status| Solved { status, iterations: 0 };
        let inputs = hessian.iter().chain(linear);
        if !inputs.clone().all(|value| value.is_finite()) || lower.iter().chain(upper).any(|b| b.is_nan()) {
            return failed(QpStatus::NotFinite);
        }
        if !self.update(hessian, linear, lower, upper) {
            return failed(QpStatus::Uncertified);
        }
        self.solver.solve();
        let found = &self.solver.solution;
        for (to, value) in solution.iter_mut().zip(&found.x) {
            *to = *value;
        }
        let rows = self.penalties.len();
        let (dual, slack) = (found.z.split_at_checked(rows), found.s.split_at_checked(rows));
        if let (Some((above, rest)), Some((gap_above, gap_rest))) = (dual, slack) {
            let mut violations = found.x.iter().skip(self.variables);
            let sides = above.iter().zip(gap_above).zip(rest.iter().zip(gap_rest));
            for ((to, penalty), ((y, s), (y_below, s_below))) in
                multipliers.iter_mut().zip(&self.penalties).zip(sides)
            {
                // At an interior point all multipliers are slightly positive: the larger of a pair is the
                // active one.
                let held = |y: f64, s: f64| if y > s { y } else { 0.0 };
                let mut z = held(*y, *s) - held(*y_below, *s_below);
                if penalty.is_finite() {
                    let violation = violations.next().copied().unwrap_or(0.0);
                    if violation > penalty - z.abs() {
                        z = penalty.copysign(z);
                    }
                }
                *to = z;
            }
        }
        let status = match found.status {
            SolverStatus::Solved => QpStatus::Inexact,
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => QpStatus::Infeasible,
            SolverStatus::MaxIterations => QpStatus::IterationCap,
            _ => QpStatus::Uncertified,
        };
        Solved { status, iterations: found.iterations }
    }

    fn update(&mut self, hessian: &[f64], linear: &[f64], lower: &[f64], upper: &[f64]) -> bool {
        let columns = hessian.chunks_exact(self.variables).enumerate();
        let triangle = columns.flat_map(|(column, entries)| entries.iter().take(column + 1));
        let mut changed = false;
        for (to, entry) in self.hessian.iter_mut().zip(triangle) {
            changed |= *to != *entry;
            *to = *entry;
        }
        for (to, entry) in self.linear.iter_mut().zip(linear) {
            *to = *entry;
        }
        let bounds = upper.iter().copied().chain(lower.iter().map(|bound| -bound));
        for (to, bound) in self.right.iter_mut().take(2 * self.penalties.len()).zip(bounds) {
            *to = bound.clamp(-FAR, FAR);
        }
        (!changed || self.solver.update_P(&self.hessian).is_ok())
            && self.solver.update_q(&self.linear).is_ok()
            && self.solver.update_b(&self.right).is_ok()
    }
}

/// [`super::box_qp::solve`] by clarabel.
#[derive(Debug)]
pub struct ClarabelBox<const J: usize> {
    qp: SoftRowQp,
}

/// The solver keeps its memory to itself.
impl<const J: usize> State for ClarabelBox<J> {
    fn save(&self, to: &mut Writer<'_>) {
        to.give_up();
    }

    fn load(&mut self, _from: &mut Reader<'_>) -> Result<(), StateError> {
        Err(StateError::Foreign)
    }
}

impl<const J: usize> ClarabelBox<J> {
    /// `None` when clarabel refuses.
    #[must_use]
    pub fn new(profile: ClarabelProfile) -> Option<Self> {
        let mut identity = [[0.0; J]; J];
        for (i, row) in identity.iter_mut().enumerate() {
            if let Some(entry) = row.get_mut(i) {
                *entry = 1.0;
            }
        }
        Some(Self { qp: SoftRowQp::new(&identity, &[f64::INFINITY; J], profile)? })
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
        super::box_qp::judged(h, g, lower, upper, &x, active, solved.status, solved.iterations)
    }
}

fn settings(profile: ClarabelProfile) -> DefaultSettings<f64> {
    let common = DefaultSettings {
        verbose: false,
        presolve_enable: false,
        input_sparse_dropzeros: false,
        max_iter: MAX_ITERATIONS,
        ..DefaultSettings::default()
    };
    match profile {
        ClarabelProfile::Default => common,
        ClarabelProfile::Tuned => DefaultSettings {
            equilibrate_enable: false,
            iterative_refinement_enable: false,
            tol_gap_abs: 1e-8,
            tol_gap_rel: 1e-8,
            tol_feas: 1e-8,
            ..common
        },
    }
}
