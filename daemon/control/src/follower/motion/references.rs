//! What a plan is asked for: pen and preview as references, brought within reach of the tool.

use super::Mover;
use crate::pen::PenReading;
use crate::units::{AxisState, Trust};

/// A tool this far from the pen \[m\], or so many times as far as it may be lowered from, has lost it and
/// lifts. Commands lead the pen by the dead time, which is no reason to lift: what is foreseen counts like
/// the pen.
const LOST_M: f64 = 0.05;
const LOST: f64 = 5.0;
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

    /// The held target and the references, brought into the workspace, and then to where full speed takes the
    /// tool by the end of the plan.
    ///
    /// What lies farther away asks for nearly the same motion, but for more steps of the active set: pens
    /// that jump from corner to corner beyond the workspace took up to 337 of them. Behind a servo what is
    /// asked for is where the arm gets to, which may be far behind the command. After ticks without a plan it
    /// is only a share of that, at that share of the speed. What is no number stays none.
    pub(super) fn within_reach(
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
