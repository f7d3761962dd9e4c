//! Whether the arm comes to rest with saturated limits too: a large step of the pen, simulated at start-up.
//!
//! Gains alone decide that only far from the limits (`mpc/settle.rs`). With jerk or acceleration of plan or
//! joints saturated, a plan with too short a horizon or too high gains overshoots its target again and again.
//! Here plan, inverse kinematics and guard run exactly as in a tick, over a step long enough to reach full
//! speed.
//!
//! Contract: bounded: at most [`LONGEST_S`] of motion per trust, and a dozen trials of other settings if it
//! oscillates. An arm that cannot be put where the step begins is not judged: it cannot be armed there
//! either.

use crate::follower::io::{Health, NoClock};
use crate::follower::motion::{MotionGoal, Mover};
use crate::follower::settings::RestRemedy;
use crate::follower::{Budget, FollowerError, FollowerSettings};
use crate::ik::{ToolTarget, solve_pose};
use crate::pen::PenReading;
use crate::qp::backend::Backend;
use crate::units::{AxisState, Stamp, Trust};

/// Longest simulation of one step \[s\].
const LONGEST_S: f64 = 1.6;
/// Oscillations below this do not count \[m\]. At long periods the tool may chatter by less than a millimetre
/// from tick to tick and, with saturated joints, drift towards the pen for seconds.
const SWING_M: f64 = 1e-4;
/// This many reversals must follow one another, and the last amplitude be at least this share of the one four
/// reversals before.
const TURNS: usize = 7;
const LASTING: f64 = 0.8;
/// End of the step, as a share of the way from the middle of the workspace to its edge.
const INSIDE: f64 = 0.6;
/// The tool has arrived: position and speed within these bounds for this many ticks.
const NEAR_M: f64 = 5e-4;
const SLOW_MPS: f64 = 5e-3;
const ARRIVED_TICKS: u32 = 8;

/// The reversals of one axis.
#[derive(Debug, Clone, Copy)]
struct Turns {
    last: f64,
    farthest: f64,
    up: bool,
    swings: [f64; TURNS],
    count: usize,
}

impl Turns {
    const fn new(at: f64) -> Self {
        Self { last: at, farthest: at, up: true, swings: [0.0; TURNS], count: 0 }
    }

    /// The amplitude of a sustained oscillation, if there is one \[m\].
    fn see(&mut self, at: f64) -> Option<f64> {
        let farther = if self.up { at > self.farthest } else { at < self.farthest };
        if farther {
            self.farthest = at;
        } else if (at - self.farthest).abs() > 0.5 * SWING_M {
            self.swings.rotate_left(1);
            if let Some(newest) = self.swings.last_mut() {
                *newest = (self.farthest - self.last).abs();
            }
            (self.last, self.farthest, self.up) = (self.farthest, at, !self.up);
            self.count += 1;
        }
        let [.., before, _, _, _, newest] = self.swings;
        (self.count >= TURNS && newest > SWING_M && newest > LASTING * before).then_some(newest)
    }
}

/// Refuses settings with which the arm does not come to rest after a large step of the pen.
#[inline(never)]
pub(in crate::follower::motion) fn comes_to_rest<const N: usize, const J: usize>(
    settings: &FollowerSettings<J>,
) -> Result<(), FollowerError> {
    if settings.mpc.unlimited {
        return Ok(());
    }
    match swing::<N, J>(settings)? {
        Some((axis, swing_m)) => {
            Err(FollowerError::NoRest { axis, swing_m, would: would_do::<N, J>(settings, axis) })
        }
        None => Ok(()),
    }
}

/// The value of one setting, nearest to the present one of those tried, with which it comes to rest.
fn would_do<const N: usize, const J: usize>(settings: &FollowerSettings<J>, axis: usize) -> RestRemedy {
    let rests = |change: &dyn Fn(&mut FollowerSettings<J>)| {
        let mut other = settings.clone();
        change(&mut other);
        matches!(swing::<N, J>(&other), Ok(None))
    };
    let limits = settings.mpc.axes.get(axis).copied();
    for halvings in 1..=4 {
        let share = 0.5_f64.powi(halvings);
        let more = settings.mpc.max_iterations.saturating_mul(10_u32.saturating_pow(halvings.unsigned_abs()));
        let gain = share.powi(2);
        let position = settings.mpc.gains_feedback.map(|gains| gain * gains.position);
        if more <= 1000 && rests(&|other| other.mpc.max_iterations = more) {
            return RestRemedy::Steps(more);
        }
        if let Some(limits) = limits {
            let velocity_mps = share * limits.velocity_mps;
            let acceleration_mps2 = share * limits.acceleration_mps2;
            let with = |other: &mut FollowerSettings<J>, velocity: Option<f64>, acceleration: Option<f64>| {
                for limits in other.mpc.axes.iter_mut().skip(axis).take(1) {
                    limits.velocity_mps = velocity.unwrap_or(limits.velocity_mps);
                    limits.acceleration_mps2 = acceleration.unwrap_or(limits.acceleration_mps2);
                }
            };
            if rests(&|other| with(other, Some(velocity_mps), None)) {
                return RestRemedy::Velocity(velocity_mps);
            }
            if rests(&|other| with(other, None, Some(acceleration_mps2))) {
                return RestRemedy::Acceleration(acceleration_mps2);
            }
        }
        let slower = |other: &mut FollowerSettings<J>| {
            let all = other.mpc.gains_feedback.iter_mut().chain(&mut other.mpc.gains_feedforward);
            all.for_each(|gains| gains.position *= gain);
        };
        if rests(&slower) {
            let [x, ..] = position;
            return RestRemedy::PositionGain(x);
        }
    }
    RestRemedy::Nothing
}

/// Axis and amplitude of a sustained oscillation after a step of the pen, at no trust or full trust \[m\].
fn swing<const N: usize, const J: usize>(
    settings: &FollowerSettings<J>,
) -> Result<Option<(usize, f64)>, FollowerError> {
    // The exact solvers find the optimum that the others approximate, a hundred times as fast.
    let mut exact = settings.clone();
    (exact.mpc.backend, exact.ik_backend) = (Backend::Exact, Backend::Exact);
    // Clearance is off: in front of obstacles the arm waits, and the step is not checked for them.
    exact.clearance = None;
    let mut mover = Box::new(Mover::<N, J>::built(&exact)?);
    let horizon_s = mover.mpc.step_s() * N as f64;
    let (mut from, mut to) = ([0.0; 3], [0.0; 3]);
    for ((from, to), limits) in from.iter_mut().zip(&mut to).zip(&mover.limits) {
        let [low, high] = limits.position_m;
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let step = (2.0 * limits.velocity_mps * horizon_s).min(half);
        // Not as far as the edge, whose bound would hold the tool.
        (*from, *to) = (middle - step, middle + step.min(INSIDE * half));
    }
    let ([from_x, from_y, _], [to_x, to_y, _]) = (from, to);
    let begin = settings.plane.point_to_base(&[from_x, from_y, settings.plane.lift_height].into());
    let target = ToolTarget::at_rest(begin, settings.plane.tool_axis(), None);
    let Some(q) = solve_pose(&settings.chain, &settings.ik.home, &target) else { return Ok(None) };
    for trust in [Trust::NONE, Trust::FULL] {
        if mover.seed(Stamp(0), &q).is_err() {
            return Ok(None);
        }
        if let Some(found) = mover.step_to([to_x, to_y], trust) {
            return Ok(Some(found));
        }
    }
    Ok(None)
}

impl<const N: usize, const J: usize> Mover<N, J> {
    /// Moves the pen on the paper to `to` \[m\], plane frame, within one tick, and lets it rest there.
    fn step_to(&mut self, to: [f64; 2], trust: Trust) -> Option<(usize, f64)> {
        let [x, y] = to;
        let rests = [[AxisState::at_rest(x); N], [AxisState::at_rest(y); N]];
        let preview = (trust.alpha() > 0.0).then_some(rests);
        let goal = [x, y, -self.plane.press_depth];
        let begin = self.held.as_ref().map_or(Stamp(0), |held| held.command.stamp());
        let mut turns = self.tool.map(|axis| Turns::new(axis.position));
        let (mut before, mut arrived) = (self.tool.map(|axis| axis.position), 0);
        for tick in 0..(LONGEST_S / self.period_s) as u64 {
            let pen = PenReading::new(begin + tick * self.period_ns, to, true);
            let motion = MotionGoal::Follow { pen, holding: false, preview, trust, pace_mps: None };
            let mut health = Health::default();
            let moved = self.advance(Some(&motion), Budget::default(), &mut health, &mut NoClock);
            let slow = |(at, before): (&f64, &f64)| (at - before).abs() < SLOW_MPS * self.period_s;
            let near = |(at, goal): (&f64, &f64)| (at - goal).abs() < NEAR_M;
            let there = moved.tool.iter().zip(&goal).all(near) && moved.tool.iter().zip(&before).all(slow);
            arrived = if there { arrived + 1 } else { 0 };
            if arrived >= ARRIVED_TICKS {
                return None;
            }
            before = moved.tool;
            let seen = turns.iter_mut().zip(&moved.tool).map(|(turns, at)| turns.see(*at));
            if let Some((axis, Some(swing))) = seen.enumerate().find(|(_, swing)| swing.is_some()) {
                return Some((axis, swing));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first sustained oscillation of a tool that moves to and fro by `size` \[m\], decaying by `decay`
    /// per reversal and chattering by `chatter` \[m\] from tick to tick; and after how many reversals.
    fn lasting(size: f64, decay: f64, chatter: f64) -> Option<(usize, f64)> {
        let mut turns = Turns::new(0.02);
        let (mut at, mut half) = (0.02, 0.5 * size);
        for turn in 0..40 {
            let to = 0.02 + if turn % 2 == 0 { half } else { -half };
            for tick in 0..20 {
                at += (to - at) * 0.3;
                if let Some(swing) = turns.see(at + chatter * f64::from(tick % 2)) {
                    return Some((turn, swing));
                }
            }
            half *= decay;
        }
        None
    }

    #[test]
    fn swings_that_last_are_told_and_those_that_fade_or_are_tiny_are_not() {
        for size in [2e-4, 5e-3, 0.05] {
            let (turn, swing) = lasting(size, 1.0, 0.0).expect("it swings for ever");
            assert!((TURNS - 1..=TURNS + 1).contains(&turn), "{turn} turns");
            assert!((swing / size - 1.0).abs() < 0.02, "{swing} m of {size}");
            // Four reversals later the amplitude is 0.8 of it, or less.
            assert!(lasting(size, 0.96, 0.0).is_some());
            assert_eq!(lasting(size, 0.93, 0.0), None);
        }
        assert_eq!(lasting(0.95 * SWING_M, 1.0, 0.0), None);
        // Chatter is not counted as a reversal, and hides none.
        let (_, swing) = lasting(5e-3, 1.0, 4e-5).expect("it swings for ever");
        assert!((swing / 5e-3 - 1.0).abs() < 0.05, "{swing} m");
        let mut turns = Turns::new(0.0);
        assert!((0..1000).all(|k| turns.see(2e-5 * f64::from(k) + 4e-5 * f64::from(k % 2)).is_none()));
    }
}
