//! What a plan is asked for: pen and preview as references, brought within reach of the tool.

use super::Mover;
use crate::pen::PenReading;
use crate::units::{AxisState, Trust};

/// A tool this far from the pen \[m\], or this multiple of the approach distance, has lost it and lifts.
/// Commands lead the pen by the dead time, which is no reason to lift: distance to the preview counts like
/// distance to the pen.
const LOST_M: f64 = 0.05;
const LOST: f64 = 5.0;
/// Feedback approaches a held target about as fast as if it were due after this many steps: its velocity
/// gain.
const HELD_STEPS: f64 = 7.0;

/// What a plan is asked for, along the three axes.
pub(super) struct PlanGoal<const N: usize> {
    /// The states that feedback alone would approach.
    pub(super) conservative: [AxisState; 3],
    pub(super) references: [[AxisState; N]; 3],
    /// How much of the references to use.
    pub(super) trust: Trust,
}

impl<const N: usize, const J: usize> Mover<N, J> {
    /// The goal for the pen, as far as its `preview` is known.
    pub(super) fn goal(
        &mut self,
        pen: &PenReading,
        holding: bool,
        preview: &Option<[[AxisState; N]; 2]>,
        trust: Trust,
    ) -> PlanGoal<N> {
        let [x, y] = pen.position;
        let [tool_x, tool_y, _] = self.tool.map(|axis| axis.position);
        // A silent pen moves nothing, not even the lift; when it returns it may be somewhere else.
        if holding {
            self.approaching = true;
        } else {
            // Lowered from far away at full speed, the tip would not stop at the paper.
            let off = |[x, y]: [f64; 2]| (x - tool_x).hypot(y - tool_y);
            let led = preview.as_ref().filter(|_| trust.alpha() > 0.0);
            let foreseen = led.and_then(|[xs, ys]| Some([xs.first()?.position, ys.first()?.position]));
            let lost = off(foreseen.unwrap_or(pen.position)).min(off(pen.position))
                > LOST_M.max(LOST * self.approach_distance);
            self.approaching = !(off(pen.position) <= self.approach_distance) && (self.approaching || lost);
            let down = pen.contact && !self.approaching;
            self.height = if down { -self.plane.press_depth } else { self.plane.lift_height };
        }
        let conservative = [x, y, self.height].map(AxisState::at_rest);
        let [hold_x, hold_y, hold_z] = conservative;
        match preview {
            Some([xs, ys]) => PlanGoal { conservative, references: [*xs, *ys, [hold_z; N]], trust },
            None => {
                let references = [[hold_x; N], [hold_y; N], [hold_z; N]];
                PlanGoal { conservative, references, trust: Trust::NONE }
            }
        }
    }

    /// The held target and the references, brought into the workspace, and then to within what full speed
    /// reaches by the end of the plan; no faster than `pace_mps` \[m/s\].
    ///
    /// Targets farther away ask for nearly the same motion but cost many more active-set steps. Behind a
    /// servo the target concerns the arm, which may be far behind the command. After ticks without a plan,
    /// distance and speed are scaled by `reach`. Non-finite values stay non-finite.
    pub(super) fn within_reach(&self, goal: &PlanGoal<N>, pace_mps: Option<f64>) -> PlanGoal<N> {
        let PlanGoal { mut conservative, mut references, trust } = *goal;
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
            if let Some(pace) = pace_mps {
                slow_down(pace, self.mpc.step_s(), [behind, ahead], held, references);
            }
        }
        PlanGoal { conservative, references, trust }
    }
}

/// Limits every state to what `pace` \[m/s\] reaches by its time from a tool within `[behind, ahead]` \[m\],
/// and its speed to `pace`.
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

/// The nearest value in `[low, high]`; NaN stays NaN.
fn within(value: f64, [low, high]: [f64; 2]) -> f64 {
    if value < low {
        low
    } else if value > high {
        high
    } else {
        value
    }
}
