//! Jerk MPC of the writing plane: from the commanded state, the held target and the preview to a [`Plan`].
//!
//! Per axis, ½J = ½(1−α)‖G_c(x_c − x̃)‖² + ½α‖G_f(g − x̃)‖² + ½β‖ũ‖² over the condensed triple integrator, jerk
//! hard, acceleration, velocity and position softened by an exact penalty. The axes are independent. The
//! unconstrained optimum comes from constant gains and *is* the answer if it keeps every limit; else the
//! exact dual active set; else a status, and the caller falls back. Every answer carries its KKT residual:
//! stationarity relative to 1 + max|q| + max|z|, rows relative to 1 + |r|, in units of mm and steps.
//!
//! Contract: no allocation after [`Mpc::new`] with [`Backend::Exact`], bounded work, no panic for any input.
//! Source: Agravante et al. 2018, section 2.

pub mod model;
pub mod condense;
pub mod cost;
pub mod limits;
pub mod settings;
pub mod plan;
mod axis;

pub use cost::Gains;
pub use limits::{AxisLimits, SoftPenalty};
pub use plan::{ActiveLimits, AxisReport, Plan, PlanReport, SolvePath};
pub use settings::{Backend, ClarabelProfile, MpcError, MpcSettings};

use crate::qp::clarabel::SoftRowQp;
use crate::qp::dual::{Bounds, DualActiveSet};
use crate::qp::{KKT_TOLERANCE, QpStatus};
use crate::units::{AxisState, Trust};
use axis::AxisProblem;
use condense::Condensed;
use cost::Cost;
use model::{Motion, Scale, rollout};

/// The planner of three axes over `N` steps.
pub struct Mpc<const N: usize> {
    step_s: f64,
    scale: Scale,
    max_iterations: u32,
    axes: Box<[Axis<N>; 3]>,
    set: Box<DualActiveSet<4, N, N>>,
}

impl<const N: usize> std::fmt::Debug for Mpc<N> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Mpc").field("steps", &N).field("step_s", &self.step_s).finish_non_exhaustive()
    }
}

struct Axis<const N: usize> {
    cost: Cost<N>,
    /// Positions absolute [mm]; the working copy's count from the start.
    rows: Bounds<4, N>,
    shifted: Bounds<4, N>,
    clarabel: Option<SoftRowQp>,
}

impl<const N: usize> Mpc<N> {
    /// Check the settings and compute everything constant.
    ///
    /// # Errors
    /// The first setting outside its range, a cost that double precision cannot invert, or Clarabel's refusal.
    pub fn new(settings: &MpcSettings) -> Result<Self, MpcError> {
        const { assert!(N > 0 && N <= 60, "horizon of 1 to 60 steps") };
        settings.validate()?;
        let scale = Scale::new(settings.step_s);
        let condensed = Condensed::<N>::new();
        let axis = |axis: usize, feedback: &Gains, feedforward: &Gains, limits: &AxisLimits| {
            let cost = Cost::new(&condensed, feedback, feedforward, settings.effort)
                .ok_or(MpcError::Singular { axis })?;
            let rows = limits::rows(limits, &scale, &settings.soft_penalty, &cost);
            let clarabel = match settings.backend {
                Backend::Exact => None,
                Backend::Clarabel(profile) => {
                    let built =
                        SoftRowQp::new(&constraint_rows(&condensed), rows.penalty.as_flattened(), profile);
                    Some(built.ok_or(MpcError::Clarabel { axis })?)
                }
            };
            Ok(Axis { cost, rows, shifted: rows, clarabel })
        };
        let ([cx, cy, cz], [fx, fy, fz], [lx, ly, lz]) =
            (&settings.gains_feedback, &settings.gains_feedforward, &settings.axes);
        let axes = Box::new([axis(0, cx, fx, lx)?, axis(1, cy, fy, ly)?, axis(2, cz, fz, lz)?]);
        Ok(Self {
            step_s: settings.step_s,
            scale,
            max_iterations: settings.max_iterations,
            axes,
            set: Box::default(),
        })
    }

    /// Plan N steps from `start` (the commanded state now).
    ///
    /// `conservative`: the held target x_c, the same at every step; `preview`: the references g at
    /// i·Δ after now, i = 1..N, per axis; all in the writing plane's frame, SI units. At trust 0 the preview
    /// is not read. `max_iterations`: this tick's budget per axis, on top of the settings' ceiling.
    ///
    /// `plan` is written only if the report is usable; it is left alone otherwise.
    pub fn plan(
        &mut self,
        start: &[AxisState; 3],
        conservative: &[AxisState; 3],
        preview: &[[AxisState; N]; 3],
        trust: Trust,
        max_iterations: u32,
        plan: &mut Plan<N>,
    ) -> PlanReport {
        let cap = self.max_iterations.min(max_iterations);
        let mut report = PlanReport::default();
        let mut jerks = [[0.0; N]; 3];
        let references = start.iter().zip(conservative).zip(preview);
        let results = report.axes.iter_mut().zip(&mut jerks);
        for ((axis, ((start, conservative), preview)), (report, jerks)) in
            self.axes.iter_mut().zip(references).zip(results)
        {
            *report = axis.solve(&self.scale, start, conservative, preview, trust, cap, &mut self.set, jerks);
        }
        if report.usable() {
            *plan = Plan { step_s: self.step_s, start: *start, jerks };
        }
        report
    }

    /// Δ [s].
    #[must_use]
    pub const fn step_s(&self) -> f64 {
        self.step_s
    }
}

impl<const N: usize> Axis<N> {
    #[inline]
    #[expect(clippy::too_many_arguments, reason = "the arguments of Mpc::plan, taken apart per axis")]
    fn solve(
        &mut self,
        scale: &Scale,
        start: &AxisState,
        conservative: &AxisState,
        preview: &[AxisState; N],
        trust: Trust,
        max_iterations: u32,
        set: &mut DualActiveSet<4, N, N>,
        jerks: &mut [f64; N],
    ) -> AxisReport {
        if !self.cost.set_trust(trust) {
            return AxisReport {
                status: QpStatus::NotConvex,
                kkt_residual: f64::NAN,
                ..AxisReport::default()
            };
        }
        let origin = start.position;
        self.shift(origin * scale.position);
        let problem = AxisProblem {
            cost: &self.cost,
            bounds: &self.shifted,
            start: scale.normalised(start, origin),
            pull: pull(&self.cost, scale, origin, conservative, preview),
        };
        let (normalised, report) = match &mut self.clarabel {
            None => problem.solve(set, max_iterations),
            Some(qp) => by_clarabel(&problem, qp),
        };
        *jerks = normalised.map(|jerk| jerk * scale.jerk_inverse);
        report
    }

    /// Count the position rows from `origin` [mm].
    #[inline]
    fn shift(&mut self, origin: f64) {
        let ([.., from_lower], [.., from_upper]) = (&self.rows.lower, &self.rows.upper);
        let ([.., lower], [.., upper]) = (&mut self.shifted.lower, &mut self.shifted.upper);
        *lower = from_lower.map(|bound| bound - origin);
        *upper = from_upper.map(|bound| bound - origin);
    }
}

/// (1−α)G_c² x_c + αG_f² g, in the order acceleration, velocity, position.
#[inline]
fn pull<const N: usize>(
    cost: &Cost<N>,
    scale: &Scale,
    origin: f64,
    conservative: &AxisState,
    preview: &[AxisState; N],
) -> cost::Weights<N> {
    let (feedback, feedforward) = cost.blended();
    let [p, v, a] = scale.normalised(conservative, origin);
    let [mut acceleration, mut velocity, mut position] = *feedback;
    for weight in &mut acceleration {
        *weight *= a;
    }
    for weight in &mut velocity {
        *weight *= v;
    }
    for weight in &mut position {
        *weight *= p;
    }
    // A predictor that is not trusted at all must not be able to spoil Hold.
    if cost.alpha() > 0.0 {
        let [on_acceleration, on_velocity, on_position] = feedforward;
        let pulls = acceleration.iter_mut().zip(&mut velocity).zip(&mut position);
        let weights = on_acceleration.iter().zip(on_velocity).zip(on_position);
        for ((((pa, pv), pp), ((wa, wv), wp)), reference) in pulls.zip(weights).zip(preview) {
            let [p, v, a] = scale.normalised(reference, origin);
            *pa += wa * a;
            *pv += wv * v;
            *pp += wp * p;
        }
    }
    [acceleration, velocity, position]
}

/// C̃: the rows of [`Motion`] as a 4N x N matrix, row by row.
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

/// The same problem by Clarabel, judged by the same certificate.
fn by_clarabel<const N: usize>(problem: &AxisProblem<'_, N>, qp: &mut SoftRowQp) -> ([f64; N], AxisReport) {
    let mut jerks = [0.0; N];
    let mut report = AxisReport { kkt_residual: f64::NAN, ..AxisReport::default() };
    let Some((linear, scale)) = problem.linear_term() else {
        report.status = QpStatus::NotFinite;
        return (jerks, report);
    };
    let free = rollout(&problem.start, &[0.0; N]);
    let relative = |bounds: &Motion<N>| {
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
        let gradient = problem.cost.gradient(&motion, &problem.pull, &multipliers);
        report.kkt_residual = problem.residual(&motion, &multipliers, &gradient, scale);
        report.active = problem.count(&multipliers);
        report.path = SolvePath::Clarabel;
        if report.kkt_residual <= KKT_TOLERANCE {
            report.status = QpStatus::Optimal;
        }
    }
    (jerks, report)
}
