//! Joint velocities that carry the tool along the plan or the way home, else those of a stop.

use nalgebra::Vector3;

use super::{HomeNews, JointStep, MotionGoal, Mover, PlannedStep};
use crate::follower::io::{Health, Rung};
use crate::ik::{IkSource, PathKept, ToolTarget};
use crate::units::{AxisState, Stamp};

/// Velocity error of the IK that the plan need not know about \[m/s\]; it is corrected as pose error later.
const IK_TOLERANCE_MPS: f64 = 1e-3;

impl<const N: usize, const J: usize> Mover<N, J> {
    /// Joint velocities for what was planned, and their rung on the ladder.
    pub(super) fn solve(
        &mut self,
        start: Stamp,
        wanted: &MotionGoal<N>,
        planned: &PlannedStep,
        health: &mut Health,
    ) -> JointStep<J> {
        let (qd, home) = match wanted {
            MotionGoal::Home => self.homeward(start, health),
            _ => (planned.next.and_then(|next| self.joint_velocities(&next, health)), HomeNews::None),
        };
        let rung = match (planned.next.is_some(), qd.is_some()) {
            (false, true) => Rung::FreshPlan,
            (true, false) => Rung::Stop,
            _ => planned.rung,
        };
        if wanted.follows() && rung == Rung::Stop {
            health.set(Health::FALLBACK);
        }
        let follows = qd.is_some();
        if follows {
            self.kept = None;
        }
        let qd = qd.unwrap_or_else(|| self.stopping(start + self.period_ns, health));
        JointStep { qd, follows, rung, home }
    }

    /// The next step of a stop, which ends at `reach`: joint velocities \[rad/s\].
    fn stopping(&mut self, reach: Stamp, health: &mut Health) -> [f64; J] {
        let (wanted, path) = self.next_of_stop(reach, health);
        let Some(held) = &self.held else { return wanted };
        let (motion, h, solve) = (held.command.motion(), self.period_s, !health.has(Health::SHED));
        let step = self.ik.stopping(&held.kinematics, motion, &wanted, h, path.as_ref(), solve);
        let [rows_held, rows_yielded] = step.envelope;
        if step.clearance.held | step.clearance.yielded | rows_held | rows_yielded != 0 {
            health.set(Health::CLEARANCE);
        }
        if step.path == PathKept::Lost {
            health.set(Health::PATH_LOST);
        }
        step.qd
    }

    /// Joint velocities that carry the tool from its commanded state to `next` in one period.
    fn joint_velocities(&mut self, next: &[AxisState; 3], health: &mut Health) -> Option<[f64; J]> {
        let held = self.held.as_ref()?;
        let here: Vector3<f64> = self.tool.map(|axis| axis.position).into();
        let there: Vector3<f64> = next.map(|axis| axis.position).into();
        let target = ToolTarget {
            position: self.plane.point_to_base(&here),
            velocity: self.plane.vector_to_base(&((there - here) / self.period_s)),
            axis: self.plane.tool_axis(),
            spin: None,
        };
        let step = self.ik.step(&held.kinematics, held.command.motion(), &target, self.period_s);
        self.reports.ik = step.report;
        if step.report.source != IkSource::Optimum {
            health.set(Health::IK_FAILED);
        }
        let (clearance, [rows_held, rows_yielded]) = (step.report.clearance, step.report.envelope);
        if clearance.held | clearance.yielded | rows_held | rows_yielded != 0 {
            health.set(Health::CLEARANCE);
        }
        if !(step.report.velocity_error.norm() <= IK_TOLERANCE_MPS) {
            health.set(Health::IK_LIMITED);
        }
        (step.report.source != IkSource::Brake).then_some(step.qd)
    }
}
