//! Where the tool is to be at the end of the period: from a fresh plan, else from the previous one, and
//! always such that it can still stop inside the workspace.

use super::{Mover, Planned, Wanted};
use crate::follower::Budget;
use crate::follower::io::{Health, Rung};
use crate::units::{AxisState, Stamp, Trust};

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
            let report = self.planned(conservative, references, trust, budget.max_iterations);
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
