//! Where the tool is to be at the end of the period: from a fresh plan, else from the previous one, and
//! always such that it can still stop inside the workspace.

use super::{Mover, Planned, Wanted};
use crate::follower::Budget;
use crate::follower::io::{Health, Rung};
use crate::mpc::{PlanReport, Start};
use crate::units::{AxisState, Stamp, Trust};

/// Beyond the workspace by less than this \[m\] is inside: rounding.
const OUTSIDE_M: f64 = 1e-9;
/// What becomes of the share of the reach in a tick without a plan of its own and in one with, and where it
/// ends.
const FAILED: f64 = 0.5;
const PLANNED: f64 = 1.1;
const LEAST_REACH: f64 = 1e-3;

impl<const N: usize, const J: usize> Mover<N, J> {
    /// The plan for what is wanted; none for a stop and for the way home.
    pub(super) fn plan(
        &mut self,
        start: Stamp,
        wanted: &Wanted<N>,
        budget: Budget,
        health: &mut Health,
    ) -> Planned {
        let Wanted::Follow { pen, holding, preview, trust } = wanted else {
            let reference = self.tool.map(|axis| axis.position);
            return Planned { reference, next: None, rung: Rung::Stop };
        };
        let (references, conservative, trust) = self.references(pen, *holding, preview, *trust);
        let reference = references.map(|axis| axis.first().map_or(0.0, |state| state.position));
        let (next, rung) = self.plan_next(start, &conservative, &references, trust, budget, health);
        Planned { reference, next, rung }
    }

    /// The tool state at the end of the period: from a fresh plan, else from the previous one.
    fn plan_next(
        &mut self,
        start: Stamp,
        conservative: &[AxisState; 3],
        references: &[[AxisState; N]; 3],
        trust: Trust,
        budget: Budget,
        health: &mut Health,
    ) -> (Option<[AxisState; 3]>, Rung) {
        if !budget.shed {
            let report = self.make_plan(conservative, references, trust, budget.max_iterations);
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
            // A plan that the tool has left still says how to go on.
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
    /// Whatever settings, budget and pen are: where no plan was found, less is asked for in the next tick,
    /// down to staying at rest. An arm at rest therefore never stands there for want of a plan.
    fn make_plan(
        &mut self,
        conservative: &[AxisState; 3],
        references: &[[AxisState; N]; 3],
        trust: Trust,
        max_iterations: u32,
    ) -> PlanReport {
        let (conservative, references) = self.within_reach(conservative, references);
        let report = self.within_limits(conservative, references, trust, max_iterations);
        let change = if report.usable() { PLANNED } else { FAILED };
        self.reach = (self.reach * change).clamp(LEAST_REACH, 1.0);
        report
    }

    /// The plan as far as the workspace and its steps allow.
    ///
    /// Beyond the workspace, or too fast to stop inside it, a plan has every position row against it and may
    /// need more steps of the active set than there may be, in this tick and, as the arm then stands still,
    /// in all that follow. If half of them are not enough it is made once more, for a workspace that reaches
    /// as far as the tool cannot help going: the way back is still what the references ask for. Both together
    /// take half as many steps again as one plan may, at most.
    fn within_limits(
        &mut self,
        mut conservative: [AxisState; 3],
        mut references: [[AxisState; N]; 3],
        trust: Trust,
        max_iterations: u32,
    ) -> PlanReport {
        let mut from = Start { command: self.tool, arm: self.arm };
        let beyond = self.cannot_help();
        let inside = beyond.iter().all(|by| by.abs() < OUTSIDE_M);
        let first = if inside { max_iterations } else { max_iterations / 2 };
        let report = self.mpc.plan_behind(&from, &conservative, &references, trust, first, &mut self.plan);
        if report.usable() || inside {
            return report;
        }
        // A plan depends on where it is only by the workspace: moving everything else moves that the other
        // way.
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

    /// How far beyond the workspace the tool gets when it brakes as hard as its limits allow \[m\]; negative
    /// on the lower side.
    fn cannot_help(&self) -> [f64; 3] {
        let mut beyond = [0.0; 3];
        for ((beyond, limits), tool) in beyond.iter_mut().zip(&self.limits).zip(&self.tool) {
            let [low, high] = limits.position_m;
            *beyond = (tool.position + limits.braking_m(tool, 1.0) - high).max(0.0)
                + (tool.position - limits.braking_m(tool, -1.0) - low).min(0.0);
        }
        beyond
    }

    /// `next` where the tool can come to rest inside the workspace after it, else the nearest on the way to
    /// such a stop.
    fn stoppable(&mut self, next: [AxisState; 3]) -> [AxisState; 3] {
        let mut kept = next;
        for (kept, (limits, from)) in kept.iter_mut().zip(self.limits.iter().zip(&self.tool)) {
            *kept = limits.kept_stoppable(from, kept, self.period_s);
        }
        self.bent |= kept != next;
        kept
    }
}
