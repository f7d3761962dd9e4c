//! Whether plans come to rest at their limits as well as inside them: large steps of the target, planned through at start-up.
//!
//! Gains alone decide that only far from the limits (`mpc/settle.rs`). With jerk or acceleration at their limits a plan that looks
//! too little ahead goes past its target, comes back and goes past it again. Here the shipped planner is followed exactly as in
//! a tick, the joints left out, over a step long enough to reach full speed.
//!
//! Contract: bounded: at most [`TICKS`] plans per trust, and ten trials of slower limits where it does not come to rest.

use super::Mover;
use super::parts::{paced, planner};
use crate::follower::io::{Health, Rung};
use crate::follower::settings::Would;
use crate::follower::{Budget, FollowerError, FollowerSettings};
use crate::units::{AxisState, Stamp, Trust};

/// Longest look at one step.
const TICKS: u64 = 600;
/// Swings below this do not count [m].
const SWING_M: f64 = 1e-3;
/// So many turns have to follow one another, and the last swing be no smaller than this share of the one four turns before.
const TURNS: usize = 7;
const LASTING: f64 = 0.8;
/// The tool has arrived: so near, so slow, for so long.
const NEAR_M: f64 = 5e-4;
const SLOW_MPS: f64 = 5e-3;
const ARRIVED_TICKS: u32 = 8;

/// The turns of one axis.
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

    /// The size of a swing that lasts, if there is one [m].
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

impl<const N: usize, const J: usize> Mover<N, J> {
    /// Refuses settings with which a plan does not come to rest after a large step of its target.
    #[inline(never)]
    pub(super) fn comes_to_rest(&mut self, settings: &FollowerSettings<J>) -> Result<(), FollowerError> {
        if settings.mpc.unlimited {
            return Ok(());
        }
        let Some((axis, swing_m)) = self.swing(settings) else { return Ok(()) };
        let (mut slower, mut would) = (settings.clone(), None);
        for _ in 0..10 {
            for limits in slower.mpc.axes.iter_mut().skip(axis).take(1) {
                limits.velocity_mps *= 0.5;
            }
            self.limits = paced::<N, J>(&slower).limits();
            self.mpc = planner(&slower)?;
            if self.swing(&slower).is_none() {
                would = slower.mpc.axes.get(axis).map(|limits| limits.velocity_mps);
                break;
            }
        }
        let velocity_mps = settings.mpc.axes.get(axis).map_or(0.0, |limits| limits.velocity_mps);
        Err(FollowerError::NoRest { axis, swing_m, velocity_mps, would: Would(would) })
    }

    /// Axis and size of a swing that lasts, after a step of the target at no trust or full trust.
    fn swing(&mut self, settings: &FollowerSettings<J>) -> Option<(usize, f64)> {
        let horizon_s = self.mpc.step_s() * N as f64;
        let (mut from, mut to) = ([0.0; 3], [0.0; 3]);
        for ((from, to), limits) in from.iter_mut().zip(&mut to).zip(&self.limits) {
            let [low, high] = limits.position_m;
            let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
            let step = (2.0 * limits.velocity_mps * horizon_s).min(half);
            (*from, *to) = (middle - step, middle + step);
        }
        // Along the normal the step is that of a pen that touches the paper.
        let ([from_x, from_y, _], [to_x, to_y, _]) = (from, to);
        let (from, to) = ([from_x, from_y, settings.plane.lift_height], [to_x, to_y, 0.0]);
        let found = [Trust::NONE, Trust::FULL].into_iter().find_map(|trust| self.step_to(from, to, trust));
        (self.plan_start, self.bent, self.reach) = (None, false, 1.0);
        found
    }

    fn step_to(&mut self, from: [f64; 3], to: [f64; 3], trust: Trust) -> Option<(usize, f64)> {
        self.tool = from.map(AxisState::at_rest);
        (self.arm, self.plan_start, self.bent, self.reach) = (self.tool, None, false, 1.0);
        let (target, mut turns, mut arrived) = (to.map(AxisState::at_rest), from.map(Turns::new), 0);
        let references = target.map(|at| [at; N]);
        for tick in 0..TICKS {
            let start = Stamp(tick * self.period_ns);
            let mut health = Health::default();
            let (next, rung) =
                self.plan_next(start, &target, &references, trust, Budget::default(), &mut health);
            let at_rest = self.tool.map(|axis| AxisState::at_rest(axis.position));
            let next = next.filter(|_| rung != Rung::Stop).unwrap_or(at_rest);
            if let Some(servo) = self.servo {
                for (arm, (from, to)) in self.arm.iter_mut().zip(self.tool.iter().zip(&next)) {
                    *arm = servo.follow(arm, from.position, to.position, self.period_s);
                }
            }
            self.tool = next;
            let near = next
                .iter()
                .zip(&to)
                .all(|(axis, to)| (axis.position - to).abs() < NEAR_M && axis.velocity.abs() < SLOW_MPS);
            arrived = if near { arrived + 1 } else { 0 };
            if arrived >= ARRIVED_TICKS {
                return None;
            }
            let seen = turns.iter_mut().zip(&next).map(|(turns, axis)| turns.see(axis.position));
            if let Some((axis, Some(swing))) = seen.enumerate().find(|(_, swing)| swing.is_some()) {
                return Some((axis, swing));
            }
        }
        None
    }
}
