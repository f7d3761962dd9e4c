//! Jerk MPC of the writing plane: from the commanded state, the held target and the preview to a [`Plan`].
//!
//! Per axis, ½J = ½(1−α)‖G_c(x_c − x̃)‖² + ½α‖G_f(g − x̃)‖² + ½β‖ũ‖² over the condensed triple integrator,
//! jerk hard, acceleration, velocity and position softened by an exact penalty. Behind a servo that is a
//! filter, the x̃ of the errors is the arm's motion, and only the limits and the effort concern the command.
//! The axes are independent. The unconstrained optimum comes from constant gains and is the answer if it
//! keeps every limit; else the exact dual active set; else a status, and the caller falls back. Every answer
//! carries its KKT residual: stationarity relative to 1 + max|q| + max|z|, rows relative to 1 + |r|, in units
//! of mm and steps.
//!
//! Contract: no allocation after [`Mpc::new`] with [`Backend::Exact`], bounded work, no panic for any input.
//! Source: Agravante et al. 2018, section 2.

pub mod model;
pub mod condense;
pub mod cost;
pub mod limits;
mod brake;
pub mod behind;
pub mod settings;
pub mod plan;
mod lanes;
mod sweeps;
mod free;
mod axis;
mod settle;

use crate::state::state;
pub use cost::Gains;
pub use limits::{AxisLimits, SoftPenalty};
pub use plan::{ActiveLimits, AxisReport, Plan, PlanReport, SolvePath};
pub use settings::{MpcError, MpcSettings};

use crate::qp::backend::{Backend, SoftRows};
use crate::qp::dual::{Bounds, DualActiveSet};
use crate::qp::{KKT_TOLERANCE, QpStatus};
use crate::units::{AxisState, Trust};
use axis::AxisProblem;
use behind::Behind;
use condense::Condensed;
use cost::Cost;
use free::{Free, FreeOptimum};
use model::{MotionRows, Scale, rollout};

/// Where a plan begins, per axis of the writing plane's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// The state that is commanded, per axis.
    pub command: [AxisState; 3],
    /// The arm behind its servo; not read if there is none.
    pub arm: [AxisState; 3],
}

/// The planner of three axes over `N` steps.
pub struct Mpc<const N: usize> {
    step_s: f64,
    /// Group delay of the servo behind which errors are counted \[s\]; 0: none.
    servo_s: f64,
    scale: Scale,
    max_iterations: u32,
    /// α of the costs; NaN before the first plan.
    alpha: f64,
    axes: Box<[AxisPlanner<N>; 3]>,
    free: Free<N>,
    set: Box<DualActiveSet<4, N, N>>,
}

state! {
    [const N: usize] Mpc<N> { alpha, axes, free, set }
    fixed { step_s, servo_s, scale, max_iterations }
}

impl<const N: usize> std::fmt::Debug for Mpc<N> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Mpc").field("steps", &N).field("step_s", &self.step_s).finish_non_exhaustive()
    }
}

struct AxisPlanner<const N: usize> {
    cost: Cost<N>,
    /// Positions absolute \[mm\]; those of the working copy count from the start.
    rows: Bounds<4, N>,
    shifted: Bounds<4, N>,
    other: Option<Box<dyn SoftRows>>,
}

state! { [const N: usize] AxisPlanner<N> { cost, rows, shifted } present { other } }

impl<const N: usize> Mpc<N> {
    /// Check the settings and compute everything constant.
    ///
    /// # Errors
    /// The first setting outside its range, a cost that double precision cannot invert, or another
    /// solver's refusal.
    pub fn new(settings: &MpcSettings) -> Result<Self, MpcError> {
        const { assert!(N > 0 && N <= 60, "horizon of 1 to 60 steps") };
        settings.validate()?;
        let scale = Scale::new(settings.step_s);
        let condensed = Condensed::<N>::new();
        let behind = (settings.servo_s > 0.0).then(|| Behind::new(settings.servo_s, settings.step_s));
        let axis = |axis: usize, feedback: &Gains, feedforward: &Gains, limits: &AxisLimits| {
            let cost = Cost::new(&condensed, behind, feedback, feedforward, settings.effort)
                .ok_or(MpcError::Singular { axis })?;
            let rows = limits::rows(limits, &scale, &settings.soft_penalty, &cost);
            let other = match settings.backend {
                Backend::Exact => None,
                Backend::Other(solver) => {
                    let constraints = constraint_rows(&condensed);
                    let built = solver.set_up(constraints.as_flattened(), N, rows.penalty.as_flattened());
                    Some(built.ok_or(MpcError::Solver { solver: solver.name(), axis })?)
                }
            };
            Ok(AxisPlanner { cost, rows, shifted: rows, other })
        };
        let ([cx, cy, cz], [fx, fy, fz], [lx, ly, lz]) =
            (&settings.gains_feedback, &settings.gains_feedforward, &settings.limits());
        let axes = Box::new([axis(0, cx, fx, lx)?, axis(1, cy, fy, ly)?, axis(2, cz, fz, lz)?]);
        let [x, y, z] = &*axes;
        let same_gains = y.cost.same_gains(&x.cost) && z.cost.same_gains(&x.cost);
        let free = Free::new(axes.each_ref().map(|axis| &axis.rows), same_gains);
        Ok(Self {
            step_s: settings.step_s,
            servo_s: settings.servo_s,
            scale,
            max_iterations: settings.max_iterations,
            alpha: f64::NAN,
            axes,
            free,
            set: Box::default(),
        })
    }

    /// Plan N steps from `start` (the commanded state now).
    ///
    /// `conservative`: the held target x_c, the same at every step; `preview`: the references g at
    /// i·Δ after now, i = 1..N, per axis; all in the writing plane's frame, SI units. At trust 0 the preview
    /// is not read. `max_iterations`: this tick's budget per axis, on top of the settings' ceiling.
    ///
    /// `plan` is written only if the report is usable, and is unchanged otherwise.
    ///
    /// Assumes that the arm is at the command; [`Mpc::plan_behind`] takes its position behind a servo.
    pub fn plan(
        &mut self,
        start: &[AxisState; 3],
        conservative: &[AxisState; 3],
        preview: &[[AxisState; N]; 3],
        trust: Trust,
        max_iterations: u32,
        plan: &mut Plan<N>,
    ) -> PlanReport {
        let from = Start { command: *start, arm: *start };
        self.plan_behind(&from, conservative, preview, trust, max_iterations, plan)
    }

    /// The same with the arm at another position than the command.
    #[expect(clippy::indexing_slicing, reason = "indices run over the three axes, the length of every array")]
    pub fn plan_behind(
        &mut self,
        Start { command: start, arm }: &Start,
        conservative: &[AxisState; 3],
        preview: &[[AxisState; N]; 3],
        trust: Trust,
        max_iterations: u32,
        plan: &mut Plan<N>,
    ) -> PlanReport {
        let cap = self.max_iterations.min(max_iterations);
        let mut report = PlanReport::default();
        if !self.set_trust(trust) {
            report.axes = [AxisReport::failed(QpStatus::NotConvex, 0); 3];
            return report;
        }
        let optimum = self.free.solve(&self.scale, (start, arm), conservative, preview);
        let mut jerks = [[0.0; N]; 3];
        for k in 0..3 {
            let (axis, kkt_residual) = (&mut self.axes[k], optimum.residual(k));
            let normalised = if axis.other.is_none() && optimum.inside(k) && kkt_residual <= KKT_TOLERANCE {
                let (path, status) = (SolvePath::Gain, QpStatus::Optimal);
                report.axes[k] = AxisReport { path, status, kkt_residual, ..AxisReport::default() };
                optimum.jerks(k)
            } else {
                let inputs = ([&start[k], &arm[k]], &conservative[k], &preview[k]);
                let (normalised, found) = axis.solve(&optimum, k, &self.scale, inputs, cap, &mut self.set);
                report.axes[k] = found;
                normalised
            };
            jerks[k] = normalised.map(|jerk| jerk * self.scale.jerk_inverse);
        }
        if report.usable() {
            plan.step_s = self.step_s;
            plan.start = *start;
            plan.jerks = jerks;
        }
        report
    }

    /// Blend costs again if α has changed; `false` when an H cannot be factored.
    #[inline]
    fn set_trust(&mut self, trust: Trust) -> bool {
        trust.alpha() == self.alpha || self.blend(trust)
    }

    #[cold]
    #[inline(never)]
    fn blend(&mut self, trust: Trust) -> bool {
        let [x, y, z] = &mut *self.axes;
        let mut sound = x.cost.set_trust(trust);
        for (axis, same_as) in [(y, &*x), (z, &*x)] {
            if axis.cost.same_gains(&same_as.cost) {
                axis.cost.copy_blend(&same_as.cost);
            } else {
                sound &= axis.cost.set_trust(trust);
            }
        }
        let [x, y, z] = &*self.axes;
        self.free.set_costs([&x.cost, &y.cost, &z.cost], &self.scale);
        self.alpha = if sound { trust.alpha() } else { f64::NAN };
        sound
    }

    /// Δ \[s\].
    #[must_use]
    pub const fn step_s(&self) -> f64 {
        self.step_s
    }
}

impl<const N: usize> AxisPlanner<N> {
    /// Solves one axis that its lane could not: limits are active, numbers are non-finite, or another solver
    /// was selected. `inputs`: command and arm at the start, held target, references. Returns normalised
    /// jerks.
    ///
    /// Not inlined: the usual tick needs none of this code and keeps its own in the cache.
    #[inline(never)]
    fn solve(
        &mut self,
        optimum: &FreeOptimum<N>,
        index: usize,
        scale: &Scale,
        ([start, arm], held, references): ([&AxisState; 2], &AxisState, &[AxisState; N]),
        max_iterations: u32,
        set: &mut DualActiveSet<4, N, N>,
    ) -> ([f64; N], AxisReport) {
        self.shift(start.position * scale.position);
        let pull = self.cost.pull(
            &scale.normalised(held, start.position),
            references.iter().map(|reference| scale.normalised(reference, start.position)),
        );
        let [position, velocity, _] = scale.normalised(arm, start.position);
        let start = optimum.start(index);
        let problem =
            AxisProblem { cost: &self.cost, bounds: &self.shifted, start, arm: [position, velocity], pull };
        if let Some(qp) = &mut self.other {
            return by_other(&problem, qp.as_mut());
        }
        if optimum.residual(index) <= KKT_TOLERANCE {
            let motion = rollout(&start, &optimum.jerks(index));
            problem.constrained(set, max_iterations, motion, optimum.scale(index))
        } else {
            problem.solve(set, max_iterations)
        }
    }

    /// Count the position rows from `origin` \[mm\].
    #[inline]
    fn shift(&mut self, origin: f64) {
        let ([.., from_lower], [.., from_upper]) = (&self.rows.lower, &self.rows.upper);
        let ([.., lower], [.., upper]) = (&mut self.shifted.lower, &mut self.shifted.upper);
        *lower = from_lower.map(|bound| bound - origin);
        *upper = from_upper.map(|bound| bound - origin);
    }
}

/// C̃: the rows of [`MotionRows`] as a 4N x N matrix, row by row.
fn constraint_rows<const N: usize>(condensed: &Condensed<N>) -> Vec<[f64; N]> {
    let mut rows = vec![[0.0; N]; N];
    for (i, row) in rows.iter_mut().enumerate() {
        if let Some(entry) = row.get_mut(i) {
            *entry = 1.0;
        }
    }
    let [position, velocity, acceleration] = &condensed.forced;
    rows.extend(acceleration);
    rows.extend(velocity);
    rows.extend(position);
    rows
}

/// The same problem by another solver, judged by the same certificate.
fn by_other<const N: usize>(problem: &AxisProblem<'_, N>, qp: &mut dyn SoftRows) -> ([f64; N], AxisReport) {
    let mut jerks = [0.0; N];
    let mut report = AxisReport { kkt_residual: f64::NAN, ..AxisReport::default() };
    let Some((linear, scale)) = problem.linear_term() else {
        report.status = QpStatus::NotFinite;
        return (jerks, report);
    };
    let free = rollout(&problem.start, &[0.0; N]);
    let relative = |bounds: &MotionRows<N>| {
        let mut rows = *bounds;
        for (bound, free) in rows.as_flattened_mut().iter_mut().zip(free.as_flattened()) {
            *bound -= free;
        }
        rows
    };
    let (lower, upper) = (relative(&problem.bounds.lower), relative(&problem.bounds.upper));
    let mut multipliers = [[0.0; N]; 4];
    let solved = qp.solve(
        problem.cost.hessian().as_flattened(),
        &linear,
        lower.as_flattened(),
        upper.as_flattened(),
        &mut jerks,
        multipliers.as_flattened_mut(),
    );
    report.iterations = solved.iterations;
    report.status = solved.status;
    if solved.status.usable() {
        let ([lower, ..], [upper, ..]) = (&problem.bounds.lower, &problem.bounds.upper);
        for (jerk, (lower, upper)) in jerks.iter_mut().zip(lower.iter().zip(upper)) {
            *jerk = jerk.max(*lower).min(*upper);
        }
        let motion = rollout(&problem.start, &jerks);
        let gradient = problem.gradient(&motion, &multipliers);
        report.kkt_residual = problem.residual(&motion, &multipliers, &gradient, scale);
        report.active = problem.count(&multipliers);
        report.path = SolvePath::Other;
        if report.kkt_residual <= KKT_TOLERANCE {
            report.status = QpStatus::Optimal;
        }
    }
    (jerks, report)
}
