//! Planning from outside the workspace, where keeping clear or lost time may have led the tool.

use super::Mover;
use crate::mpc::{PlanReport, Start};
use crate::units::{AxisState, Trust};

impl<const N: usize, const J: usize> Mover<N, J> {
    /// A fresh plan for the commanded state.
    ///
    /// Far outside the workspace the plan has every position row against it and may need more steps of the active set than
    /// the tick allows, in this one and, as the arm then stands still, in all that follow. It is then made once more for a
    /// workspace that reaches as far as the tool: the way back is still what the references ask for.
    pub(super) fn planned(
        &mut self,
        conservative: &[AxisState; 3],
        references: &[[AxisState; N]; 3],
        trust: Trust,
        max_iterations: u32,
    ) -> PlanReport {
        let from = Start { command: self.tool, arm: self.arm };
        let mut beyond = [0.0; 3];
        for ((beyond, axis), [low, high]) in beyond.iter_mut().zip(&self.tool).zip(&self.workspace) {
            *beyond = (axis.position - high).max(0.0) + (axis.position - low).min(0.0);
        }
        let inside = beyond.iter().all(|by| *by == 0.0);
        // Two plans may cost no more than one.
        let first = if inside { max_iterations } else { max_iterations / 2 };
        let report = self.mpc.plan_behind(&from, conservative, references, trust, first, &mut self.plan);
        if report.usable() || inside {
            return report;
        }
        let max_iterations = max_iterations - first;
        // A plan depends on where it is only by the workspace: moving everything else moves that the other way.
        let nearer = |states: &[AxisState; 3]| {
            let mut moved = *states;
            moved.iter_mut().zip(&beyond).for_each(|(axis, by)| axis.position -= by);
            moved
        };
        let from = Start { command: nearer(&from.command), arm: nearer(&from.arm) };
        let mut references = *references;
        for (states, by) in references.iter_mut().zip(&beyond) {
            states.iter_mut().for_each(|state| state.position -= by);
        }
        let conservative = nearer(conservative);
        let report =
            self.mpc.plan_behind(&from, &conservative, &references, trust, max_iterations, &mut self.plan);
        if report.usable() {
            self.plan.start.iter_mut().zip(&beyond).for_each(|(axis, by)| axis.position += by);
        }
        report
    }
}
