//! Clarabel as another solver of the law's problems: selectable backend, and reference in tests.
//!
//! Built once, data updated in place: presolve and zero-dropping off, every structural zero kept, bounds
//! finite. Soft rows get a slack each. Contract: never panics on non-finite numbers, but each
//! solve allocates once or twice inside clarabel (its timers), and an answer with active rows is accurate to
//! about 1e-2 of a limit although its objective is accurate to 1e-8.

use clarabel::algebra::CscMatrix;
use clarabel::solver::SupportedConeT::NonnegativeConeT;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus};
use foretrace_control::qp::QpStatus;
use foretrace_control::qp::backend::{OtherSolver, SoftRows, Solved};

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

/// One problem as Clarabel has it.
struct SoftRowQp {
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

impl std::fmt::Debug for SoftRowQp {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SoftRowQp")
            .field("variables", &self.variables)
            .field("rows", &self.penalties.len())
            .finish_non_exhaustive()
    }
}

impl OtherSolver for ClarabelProfile {
    fn name(&self) -> &'static str {
        match self {
            Self::Default => "Clarabel",
            Self::Tuned => "Clarabel, tuned",
        }
    }

    fn set_up(&self, rows: &[f64], variables: usize, penalties: &[f64]) -> Option<Box<dyn SoftRows>> {
        Some(Box::new(SoftRowQp::new(rows, variables, penalties, *self)?))
    }
}

impl SoftRowQp {
    fn new(rows: &[f64], variables: usize, penalties: &[f64], profile: ClarabelProfile) -> Option<Self> {
        let soft: Vec<usize> =
            penalties.iter().enumerate().filter(|(_, rho)| rho.is_finite()).map(|(row, _)| row).collect();
        let (size, height) = (variables + soft.len(), 2 * penalties.len() + soft.len());
        let mut linear = vec![0.0; variables];
        linear.extend(penalties.iter().filter(|rho| rho.is_finite()));

        let mut triplets: Vec<(usize, usize, f64)> = Vec::new();
        for (i, row) in rows.chunks_exact(variables.max(1)).enumerate() {
            for (j, entry) in row.iter().enumerate().filter(|(_, entry)| **entry != 0.0) {
                triplets.push((i, j, *entry));
                triplets.push((penalties.len() + i, j, -entry));
            }
        }
        for (slack, row) in soft.iter().enumerate() {
            let column = variables + slack;
            triplets.push((*row, column, -1.0));
            triplets.push((penalties.len() + row, column, -1.0));
            triplets.push((2 * penalties.len() + slack, column, -1.0));
        }
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
        for column in 0..variables {
            for row in 0..=column {
                indices.push(row);
                hessian.push(if row == column { 1.0 } else { 0.0 });
            }
            pointers.push(indices.len());
        }
        pointers.resize(size + 1, indices.len());
        let cost = CscMatrix::new(size, size, pointers, indices, hessian.clone());

        let mut right = vec![1.0; 2 * penalties.len()];
        right.resize(height, 0.0);
        let cones = [NonnegativeConeT(height)];
        let solver =
            DefaultSolver::new(&cost, &linear, &constraints, &right, &cones, settings(profile)).ok()?;
        Some(Self { solver, variables, penalties: penalties.to_vec(), hessian, linear, right })
    }

    fn update(&mut self, hessian: &[f64], linear: &[f64], lower: &[f64], upper: &[f64]) -> bool {
        let columns = hessian.chunks_exact(self.variables.max(1)).enumerate();
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

impl SoftRows for SoftRowQp {
    fn solve(
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
