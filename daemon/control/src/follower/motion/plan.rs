//! The tool state at the end of the period: from a fresh plan, else from the previous one, always such that
//! the tool can still stop inside the workspace.

use super::references::PlanGoal;
use super::{MotionGoal, Mover, PlannedStep};
use crate::follower::Budget;
use crate::follower::io::{Health, PreviewPath, Rung};
use crate::mpc::{PlanReport, Start};
use crate::units::{AxisState, Stamp};

/// A tool outside the workspace by less than this \[m\] counts as inside: rounding.
const OUTSIDE_M: f64 = 1e-9;
/// Factors on `reach` after a tick whose plan failed and after one whose plan succeeded, and its least value.
const FAILED: f64 = 0.5;
const PLANNED: f64 = 1.1;
const LEAST_REACH: f64 = 1e-3;

impl<const N: usize, const J: usize> Mover<N, J> {
    /// The plan for what is wanted; none for a stop and for the way home.
    pub(super) fn plan(
        &mut self,
        start: Stamp,
        wanted: &MotionGoal<N>,
        budget: Budget,
        health: &mut Health,
    ) -> PlannedStep {
        let MotionGoal::Follow { pen, holding, preview, trust, pace_mps } = wanted else {
            let reference = self.tool.map(|axis| axis.position);
            return PlannedStep { reference, path: PreviewPath::default(), next: None, rung: Rung::Stop };
        };
        let path = preview.as_ref().map_or_else(PreviewPath::default, |[xs, ys]| PreviewPath::of(xs, ys));
        let goal = self.goal(pen, *holding, preview, *trust);
        let reference = goal.references.map(|axis| axis.first().map_or(0.0, |state| state.position));
        let (next, rung) = self.plan_next(start, &goal, *pace_mps, budget, health);
        PlannedStep { reference, path, next, rung }
    }

    /// The tool state at the end of the period: from a fresh plan, else from the previous one.
    fn plan_next(
        &mut self,
        start: Stamp,
        goal: &PlanGoal<N>,
        pace_mps: Option<f64>,
        budget: Budget,
        health: &mut Health,
    ) -> (Option<[AxisState; 3]>, Rung) {
        if !budget.shed {
            let report = self.make_plan(goal, pace_mps, budget.max_iterations);
            self.reports.axes = report.axes;
            if report.usable()
                && let Some(next) = self.plan.state_at(self.period_s)
                && next.iter().all(AxisState::is_finite)
            {
                self.plan_start = Some(start);
                self.bent = false;
                return (Some(self.stoppable(next)), Rung::FreshPlan);
            }
            health.set(Health::MPC_FAILED);
        }
        health.set(Health::FALLBACK);
        let next = self.plan_start.and_then(|begin| {
            let elapsed_ns = u64::try_from((start + self.period_ns).since(begin)).ok()?;
            let in_time = elapsed_ns <= self.previous_plan_max_ns;
            let elapsed_s = elapsed_ns as f64 * 1e-9;
            let planned = in_time.then(|| self.plan.state_at(elapsed_s)).flatten()?;
            if !self.bent {
                return Some(planned);
            }
            // After the tool has left the plan, the plan's jerk still applies.
            let mut next = self.tool;
            let before = self.plan.state_at(elapsed_s - self.period_s)?;
            for (next, (before, planned)) in next.iter_mut().zip(before.iter().zip(&planned)) {
                let jerk = (planned.acceleration - before.acceleration) / self.period_s;
                *next = next.advanced(jerk, self.period_s);
            }
            Some(next)
        });
        let next = next.map(|next| self.stoppable(next));
        let rung = if next.is_some() { Rung::PreviousPlan } else { Rung::Stop };
        (next, rung)
    }

    /// A fresh plan for the commanded state.
    ///
    /// Where no plan was found, the next tick asks for less, down to staying at rest, whatever settings,
    /// budget and pen are. An arm at rest therefore never stays there for lack of a plan.
    fn make_plan(&mut self, goal: &PlanGoal<N>, pace_mps: Option<f64>, max_iterations: u32) -> PlanReport {
        let report = self.within_limits(self.within_reach(goal, pace_mps), max_iterations);
        let change = if report.usable() { PLANNED } else { FAILED };
        self.reach = (self.reach * change).clamp(LEAST_REACH, 1.0);
        report
    }

    /// The plan, with the workspace widened where the tool cannot stay inside.
    ///
    /// A tool outside the workspace, or too fast to stop inside it, makes every position row active and may
    /// need more active-set steps than the cap, in this tick and, as the arm then stands still, in all later
    /// ones. If half the cap is not enough, the plan is made once more for a workspace that reaches as far as
    /// the tool must overshoot; the references still ask for the way back. Both together cost at most one and
    /// a half times the cap.
    fn within_limits(&mut self, goal: PlanGoal<N>, max_iterations: u32) -> PlanReport {
        let PlanGoal { mut conservative, mut references, trust } = goal;
        let mut from = Start { command: self.tool, arm: self.arm };
        let beyond = self.unavoidable_overshoot_m();
        let inside = beyond.iter().all(|by| by.abs() < OUTSIDE_M);
        let first = if inside { max_iterations } else { max_iterations / 2 };
        let report = self.mpc.plan_behind(&from, &conservative, &references, trust, first, &mut self.plan);
        if report.usable() || inside {
            return report;
        }
        // The plan depends on position only through the workspace: shift everything else by the opposite
        // amount.
        for (axis, by) in beyond.iter().enumerate() {
            let states = [&mut from.command, &mut from.arm, &mut conservative];
            let states = states.into_iter().filter_map(|all| all.get_mut(axis));
            let ahead = references.get_mut(axis).into_iter().flatten();
            states.chain(ahead).for_each(|state| state.position -= by);
        }
        let before = report.axes;
        let mut report =
            self.mpc.plan_behind(&from, &conservative, &references, trust, max_iterations, &mut self.plan);
        for (axis, before) in report.axes.iter_mut().zip(&before) {
            axis.iterations += before.iterations;
        }
        if report.usable() {
            self.plan.start.iter_mut().zip(&beyond).for_each(|(axis, by)| axis.position += by);
        }
        report
    }

    /// How far the tool overshoots the workspace under full braking \[m\]; negative on the lower side.
    fn unavoidable_overshoot_m(&self) -> [f64; 3] {
        let mut beyond = [0.0; 3];
        for ((beyond, limits), tool) in beyond.iter_mut().zip(&self.limits).zip(&self.tool) {
            let [low, high] = limits.position_m;
            *beyond = (tool.position + limits.braking_m(tool, 1.0) - high).max(0.0)
                + (tool.position - limits.braking_m(tool, -1.0) - low).min(0.0);
        }
        beyond
    }

    /// `next` if the tool can come to rest inside the workspace after it, else the nearest state that can.
    fn stoppable(&mut self, next: [AxisState; 3]) -> [AxisState; 3] {
        let mut kept = next;
        for (kept, (limits, from)) in kept.iter_mut().zip(self.limits.iter().zip(&self.tool)) {
            *kept = limits.kept_stoppable(from, kept, self.period_s);
        }
        self.bent |= kept != next;
        kept
    }
}
