//! What a plan is asked for: pen and preview as references, also out of reach, and from where the workspace
//! cannot be kept.

use super::Mover;
use crate::mpc::{PlanReport, Start};
use crate::pen::PenReading;
use crate::units::{AxisState, Trust};

/// A tool this far from the pen \[m\], or so many times as far as it may be lowered from, has lost it and
/// lifts. Commands lead the pen by the dead time, which is no reason to lift: what is foreseen counts like
/// the pen.
const LOST_M: f64 = 0.05;
const LOST: f64 = 5.0;
/// Beyond the workspace by less than this \[m\] is inside: rounding.
const OUTSIDE_M: f64 = 1e-9;
/// What becomes of the share of the reach in a tick without a plan of its own and in one with, and where it
/// ends.
const FAILED: f64 = 0.5;
const PLANNED: f64 = 1.1;
const LEAST_REACH: f64 = 1e-3;
/// Feedback closes in on a held target about as fast as if it were to be there after so many steps: its
/// velocity gain.
const HELD_STEPS: f64 = 7.0;

impl<const N: usize, const J: usize> Mover<N, J> {
    /// References of the three axes, the conservative states, and the trust that they deserve.
    pub(super) fn references(
        &mut self,
        pen: &PenReading,
        holding: bool,
        preview: &Option<[[AxisState; N]; 2]>,
        trust: Trust,
    ) -> ([[AxisState; N]; 3], [AxisState; 3], Trust) {
        let [x, y] = pen.position;
        let [tool_x, tool_y, _] = self.tool.map(|axis| axis.position);
        // A pen that fell silent moves nothing, not even the lift; when it speaks again it may be somewhere
        // else.
        if holding {
            self.approaching = true;
        } else {
            // Lowered from afar, at full speed, the tip would not be stopped at the paper.
            let off = |[x, y]: [f64; 2]| (x - tool_x).hypot(y - tool_y);
            let led = preview.as_ref().filter(|_| trust.alpha() > 0.0);
            let foreseen = led.and_then(|[xs, ys]| Some([xs.first()?.position, ys.first()?.position]));
            let lost = off(foreseen.unwrap_or(pen.position)).min(off(pen.position))
                > LOST_M.max(LOST * self.approach_distance);
            self.approaching = !(off(pen.position) <= self.approach_distance) && (self.approaching || lost);
            let down = pen.contact && !self.approaching;
            self.height = if down { 0.0 } else { self.plane.lift_height };
        }
        let conservative = [x, y, self.height].map(AxisState::at_rest);
        let [hold_x, hold_y, hold_z] = conservative;
        match preview {
            Some([xs, ys]) => ([*xs, *ys, [hold_z; N]], conservative, trust),
            None => ([[hold_x; N], [hold_y; N], [hold_z; N]], conservative, Trust::NONE),
        }
    }

    /// A fresh plan for the commanded state.
    ///
    /// Whatever settings, budget and pen are: where no plan was found, less is asked for in the next tick,
    /// down to staying at rest. An arm at rest therefore never stands there for want of a plan.
    pub(super) fn planned(
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

    /// The held target and the references, brought into the workspace, and then to where full speed takes the
    /// tool by the end of the plan.
    ///
    /// What lies farther away asks for nearly the same motion, but for more steps of the active set: pens
    /// that jump from corner to corner beyond the workspace took up to 337 of them. Behind a servo what is
    /// asked for is where the arm gets to, which may be far behind the command. After ticks without a plan it
    /// is only a share of that, at that share of the speed. What is no number stays none.
    fn within_reach(
        &self,
        conservative: &[AxisState; 3],
        references: &[[AxisState; N]; 3],
    ) -> ([AxisState; 3], [[AxisState; N]; 3]) {
        let (mut conservative, mut references) = (*conservative, *references);
        let plan_s = self.reach * self.mpc.step_s() * N as f64;
        let arm = if self.servo.is_some() { &self.arm } else { &self.tool };
        let axes = self.limits.iter().zip(self.tool.iter().zip(arm));
        for ((held, references), (limits, (tool, arm))) in
            conservative.iter_mut().zip(&mut references).zip(axes)
        {
            let (behind, ahead) = (tool.position.min(arm.position), tool.position.max(arm.position));
            let far = limits.velocity_mps * plan_s;
            for state in references.iter_mut().chain([&mut *held]) {
                state.position =
                    within(within(state.position, limits.position_m), [behind - far, ahead + far]);
                state.velocity *= self.reach;
                state.acceleration *= self.reach;
            }
            if let Some(pace) = self.pace_mps {
                slow_down(pace, self.mpc.step_s(), [behind, ahead], held, references);
            }
        }
        (conservative, references)
    }
}

/// No state farther from the tool, which is within `[behind, ahead]` \[m\], than `pace` \[m/s\] gets until
/// then, nor faster.
fn slow_down(
    pace: f64,
    step_s: f64,
    [behind, ahead]: [f64; 2],
    held: &mut AxisState,
    references: &mut [AxisState],
) {
    let limit = |state: &mut AxisState, steps: f64| {
        let far = pace * step_s * steps;
        state.position = within(state.position, [behind - far, ahead + far]);
        state.velocity = within(state.velocity, [-pace, pace]);
    };
    for (index, state) in references.iter_mut().enumerate() {
        limit(state, (index + 1) as f64);
    }
    limit(held, HELD_STEPS);
}

/// The nearest that is not outside of `[low, high]`; what is no number stays none.
fn within(value: f64, [low, high]: [f64; 2]) -> f64 {
    if value < low {
        low
    } else if value > high {
        high
    } else {
        value
    }
}
