//! The guard's verdict on a step, and the tool state after it: what is really published, not what was
//! planned.

use nalgebra::Vector3;

use super::{Mover, PlannedStep, SentCommand};
use crate::arm::servo::ServoModel;
use crate::follower::io::Health;
use crate::units::{AxisState, Stamp};

impl<const N: usize, const J: usize> Mover<N, J> {
    /// Lets the guard judge the step with `qd` \[rad/s\] to `reach`, makes the result the commanded state and
    /// returns why the guard altered it, one bit each.
    pub(super) fn publish(&mut self, reach: Stamp, qd: &[f64; J], health: &mut Health) -> u32 {
        let Some(held) = &mut self.held else { return 0 };
        let mut q = *held.command.q();
        for (q, qd) in q.iter_mut().zip(qd) {
            *q += qd * self.period_s;
        }
        let verdict = self.guard.clamp(&held.command, &q, reach);
        if verdict.altered != 0 {
            health.set(Health::GUARD_ALTERED);
        }
        held.command = verdict.command;
        self.issued = held.command.stamp();
        held.valid_until = held.command.stamp() + self.valid_ns;
        held.kinematics = self.chain.forward(held.command.q());
        held.made = SentCommand { command: held.command, valid_until: held.valid_until };
        u32::from(verdict.reasons.bits())
    }

    /// Where the published joints put the tool \[m\], plane frame.
    pub(super) fn commanded_tool(&self) -> Vector3<f64> {
        let tool = self.held.as_ref().map_or_else(Vector3::zeros, |held| held.kinematics.position);
        self.plane.point_from_base(&tool)
    }

    /// Advances the modelled arm by `elapsed_s`, in which the command moved from `from` to where it is.
    pub(super) fn trail(&mut self, servo: &ServoModel, from: &Vector3<f64>, elapsed_s: f64) {
        let to = self.commanded_tool();
        for ((axis, from), to) in self.arm.iter_mut().zip(from.iter()).zip(to.iter()) {
            *axis = servo.follow(axis, *from, *to, elapsed_s);
        }
    }

    /// Takes the tool state from joints that were limited on the way to `planned`.
    ///
    /// Commands carry the mean velocity of the step that ended and the acceleration at its beginning. Taken
    /// for those at the end, they would lose half of the acceleration in every limited step. The acceleration
    /// at the end is the planned one plus half of the error at the beginning: all of it would oscillate, none
    /// of it would wind up.
    fn fall_behind(&mut self, planned: &[AxisState; 3]) {
        let assumed = self.tool;
        self.resynchronise();
        for ((axis, planned), assumed) in self.tool.iter_mut().zip(planned).zip(&assumed) {
            let wrong = axis.acceleration - assumed.acceleration;
            axis.acceleration = planned.acceleration + 0.5 * wrong;
            axis.velocity += 0.5 * self.period_s * axis.acceleration;
        }
    }

    /// Takes the tool state from the commanded joints.
    pub(super) fn resynchronise(&mut self) {
        let Some(held) = &self.held else { return };
        let tool = held.kinematics.tool_motion(held.command.qd(), held.command.qdd());
        self.tool = self.plane.axes_from_base(&tool.position, &tool.velocity, &tool.acceleration);
    }

    /// Updates the state that the next plan begins from: the planned one if the joints did it, else the one
    /// that they reached.
    pub(super) fn keep_up(
        &mut self,
        planned: &PlannedStep,
        follows_plan: bool,
        limited: bool,
        from: &Vector3<f64>,
        health: &mut Health,
    ) {
        if let Some(servo) = self.servo {
            self.trail(&servo, from, self.period_s);
        }
        match planned.next {
            Some(next) if follows_plan && !limited => self.tool = next,
            next => {
                health.set(Health::RESYNCHRONISED);
                match next.filter(|_| follows_plan) {
                    Some(planned) => self.fall_behind(&planned),
                    None => self.resynchronise(),
                }
            }
        }
        if !follows_plan {
            self.plan_start = None;
        }
    }
}
