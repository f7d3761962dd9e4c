//! The lag of the arm, estimated from the commands sent and the joint states received in normal operation.
//!
//! Contract: any arm, any motion; pure, total, no allocation, bounded work per tick. Standing still has no
//! effect: evidence is weighted and forgotten by motion ([`MEMORY_S`]). Joint states may come at any rate,
//! late, with jittering stamps, noise, constant offsets and gaps; non-finite ones are ignored. Stretches in
//! which the arm does not follow its commands (slowed down, stopped, moved by hand) have little weight and
//! increase the standard deviation. Absent: clock, the cause of the lag, lags beyond 0.2 s.
//!
//! Two figures, because most arms are filters:
//! - [`LagEstimate::lag_s`], the group delay at low frequency from a command's stamp to the motion: a
//!   property of the arm. For a servo with a look-ahead: cycle + look-ahead + joint loop. It does not depend
//!   on the motion.
//! - [`LagEstimate::shift_s`], the shift of the commands that fits the recent joint states with the least
//!   squared error. A well-damped filter delays fast motion less than slow motion, so this is shorter, the
//!   more so the faster the hand. If commands can only be shifted in time, this one gives the smallest
//!   tracking error: the dead time follows it.
//!
//! For a pure delay both are the same. Joint states that are stamped late make the arm look as much later.

mod dead_time;
mod delay;
mod shift;

use crate::state::state;
pub use dead_time::{Aim, DeadTime, Following};

use crate::arm::response::{Expected, Response, Shape};
use crate::arm::track::{GRID_S, JointTrack};
use crate::units::Stamp;
use delay::DelayFit;
use shift::{CANDIDATES, EARLIEST, ShiftBank};

/// Time constant of forgetting, in time of motion \[s\].
pub const MEMORY_S: f64 = 0.8;
/// Least motion for an estimate \[s\].
const MIN_MOTION_S: f64 = 0.25;
/// Speed of the joints together at which motion has half weight \[rad/s\].
const HALF_RADPS: f64 = 0.05;
/// Smoothing factor of the speed per grid step: the arm still moves when the command has stopped.
const SPEED_SHARE: f64 = 0.1;
/// An arm farther off its commanded path than it moves in this time does not follow \[s\].
const BESIDE_S: f64 = 0.15;
/// Least standard deviation, from stamps and grid \[s\].
const FLOOR_S: f64 = 0.2e-3;
/// Estimates outside this range are rejected \[s\].
const PLAUSIBLE_S: [f64; 2] = [-0.01, 0.3];
/// Fraction of the evidence that remains after a break in the commands.
const AFTER_BREAK: f64 = 0.1;
/// Grid steps that one call may close; the rest is processed later.
const STEPS_PER_CALL: u64 = 8;
/// The estimate is recomputed after this many grid steps.
const SOLVE_EVERY: u64 = 5;

/// How late the arm is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LagEstimate {
    /// Group delay at low frequency from a command's stamp to the measured motion \[s\], −0.01 to 0.3.
    pub lag_s: f64,
    /// Standard deviation of `lag_s` \[s\].
    pub std_s: f64,
    /// Shift of the commands that fits the recent motion best \[s\], −0.01 to 0.2.
    pub shift_s: f64,
}

state! { whole [] LagEstimate { lag_s, std_s, shift_s } }

/// Estimates the lag of an arm of `J` joints.
#[derive(Debug, Clone)]
pub struct LagEstimator<const J: usize> {
    commands: JointTrack<J>,
    joints: JointTrack<J>,
    shift: ShiftBank<J>,
    delay: DelayFit<J>,
    response: Response<J>,
    /// Next grid index to take in.
    next: u64,
    speed2: f64,
    /// Share of the recent motion in which the arm followed.
    followed: f64,
    estimate: Option<LagEstimate>,
}

state! {
    [const J: usize] LagEstimator<J> {
        commands, joints, shift, delay, response, next, speed2, followed, estimate,
    }
}

impl<const J: usize> LagEstimator<J> {
    /// Without evidence: no estimate yet.
    #[must_use]
    pub fn new() -> Self {
        Self {
            commands: JointTrack::new(),
            joints: JointTrack::new(),
            shift: ShiftBank::new(),
            delay: DelayFit::new(),
            response: Response::new(),
            next: 0,
            speed2: 0.0,
            followed: 1.0,
            estimate: None,
        }
    }

    /// A command was published: `q` \[rad\] holds at `stamp`, and between commands the line.
    pub fn commanded(&mut self, stamp: Stamp, q: &[f64; J]) {
        self.commands.push(stamp, q);
    }

    /// The arm is no longer in charge: its motion from now on was not commanded.
    pub fn released(&mut self) {
        self.commands.restart();
    }

    /// A joint state was received: `q` \[rad\] was measured at `stamp`. Processes the grid points that it
    /// completes.
    pub fn measured(&mut self, stamp: Stamp, q: &[f64; J]) {
        self.joints.push(stamp, q);
        for _ in 0..STEPS_PER_CALL {
            let lead = (CANDIDATES as i64 - 1 + EARLIEST) as u64;
            let begin = self.joints.begin().max(self.commands.begin().saturating_add(lead));
            let end = self.joints.end().min(self.commands.end().saturating_sub(EARLIEST.unsigned_abs()));
            let follows = (begin..=end).contains(&self.next);
            let k = if follows { self.next } else { begin };
            if k >= end {
                return;
            }
            if !follows {
                self.break_off();
            }
            self.next = k + 1;
            self.take_in(k);
        }
    }

    /// The estimate; `None` until the arm has moved for a while, and while the motion does not determine it.
    #[must_use]
    pub fn estimate(&self) -> Option<LagEstimate> {
        self.estimate
    }

    /// What the arm's own response makes of the commands, at the newest instant of the grid; `None` while
    /// that response is unknown.
    #[must_use]
    pub fn expected(&self) -> Option<&Expected<J>> {
        self.response.expected()
    }

    /// The same for all instants that are kept, the oldest first.
    pub fn expected_lately(&self, visit: impl FnMut(&Expected<J>)) {
        self.response.past(&self.commands, &self.joints, visit);
    }

    /// The response of the arm as a whole; `None` while it is unknown.
    #[must_use]
    pub fn shape(&self) -> Option<Shape> {
        self.response.shape()
    }

    /// A new stretch may concern another arm: earlier evidence counts, but little.
    fn break_off(&mut self) {
        self.delay.restart();
        self.delay.fade(AFTER_BREAK);
        self.response.break_off(AFTER_BREAK);
        self.shift.fade(AFTER_BREAK);
    }

    /// The instant of grid index `k`.
    fn take_in(&mut self, k: u64) {
        let mut recent = [[0.0; J]; CANDIDATES];
        for (recent, k) in recent.iter_mut().zip((0..=k + EARLIEST.unsigned_abs()).rev()) {
            let Some(commanded) = self.commands.at(k) else { return };
            *recent = *commanded;
        }
        let (Some(measured), [ahead, here, ..]) = (self.joints.at(k), &recent) else { return };
        let squares = ahead.iter().zip(here).map(|(ahead, here)| (ahead - here) * (ahead - here));
        self.speed2 += SPEED_SHARE * (squares.sum::<f64>() / (GRID_S * GRID_S) - self.speed2);
        let motion = self.speed2 / (self.speed2 + HALF_RADPS * HALF_RADPS);
        let reach2 = BESIDE_S * BESIDE_S * (self.speed2 + HALF_RADPS * HALF_RADPS);
        let near = reach2 / (reach2 + self.shift.distance2(measured, &recent));
        let weight = motion * near * near;
        let keep = 1.0 - weight * GRID_S / MEMORY_S;
        self.followed += motion * GRID_S / MEMORY_S * (near * near - self.followed);
        self.shift.add(measured, &recent, keep, weight);
        self.delay.add(measured, here, keep, weight);
        self.response.add(k, measured, &self.commands, motion);
        if k.is_multiple_of(SOLVE_EVERY) {
            self.estimate = self.solve();
        }
    }

    fn solve(&self) -> Option<LagEstimate> {
        if !(self.shift.weight() * GRID_S >= MIN_MOTION_S) {
            return None;
        }
        let shift_s = self.shift.best()?;
        let delay = self.delay.best()?;
        // Where the arm was off its path, the sums describe only part of the motion.
        let std_s = delay.std_s.hypot(FLOOR_S) / self.followed.clamp(1e-3, 1.0);
        let [low, high] = PLAUSIBLE_S;
        let plausible = (low..=high).contains(&delay.delay_s) && std_s.is_finite();
        plausible.then_some(LagEstimate { lag_s: delay.delay_s, std_s, shift_s })
    }
}

impl<const J: usize> Default for LagEstimator<J> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An arm 30 ms late and 20 mrad beside its commands, which stands for a while and follows again; all on
    /// the grid.
    fn life() -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
        let wave = |k: usize| {
            let t = k as f64 * GRID_S;
            [1.5 + 0.05 * (6.0 * t).sin(), -0.7 + 0.03 * (11.0 * t).cos()]
        };
        let stuck = 160..220;
        let measured = |k: usize| wave(if stuck.contains(&k) { 157 } else { k - 3 }).map(|q| q + 0.02);
        ((100..320).map(wave).collect(), (100..320).map(measured).collect())
    }

    /// Every sample with its weight, recomputed from all before it.
    #[test]
    fn instants_count_by_motion_and_nearness_and_are_forgotten_by_them() {
        let (commands, joints) = life();
        let at = |samples: &[[f64; 2]], k: usize| samples[k - 100];
        let apart2 = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
        let mut estimator = LagEstimator::<2>::new();
        // Weight, and measured less commanded joints per candidate, of every instant so far.
        let mut past: Vec<(f64, Vec<[f64; 2]>)> = Vec::new();
        let (mut speed2, mut followed, mut least) = (0.0, 1.0, 1.0_f64);
        let half2 = HALF_RADPS * HALF_RADPS;
        for k in 100..320 {
            let stamp = Stamp(k as u64 * crate::arm::track::GRID_NS);
            estimator.commanded(stamp, &at(&commands, k));
            estimator.measured(stamp, &at(&joints, k));
            // The sample before is complete once the commands reach back 20 steps from it.
            let now = k - 1;
            if now < 101 + 20 {
                assert_eq!(estimator.shift.weight(), 0.0, "{k}");
                continue;
            }
            let ahead = apart2(at(&commands, now + 1), at(&commands, now)).sqrt() / GRID_S;
            speed2 += SPEED_SHARE * (ahead * ahead - speed2);
            let motion = speed2 / (speed2 + half2);
            let errors: Vec<[f64; 2]> = (0..CANDIDATES)
                .map(|back| [0, 1].map(|j| at(&joints, now)[j] - at(&commands, now + 1 - back)[j]))
                .collect();
            let total: f64 = past.iter().map(|(weight, _)| weight).sum();
            let mean = |candidate: usize, j: usize| {
                let sum: f64 = past.iter().map(|(weight, errors)| weight * errors[candidate][j]).sum();
                if total > 0.0 { sum / total } else { 0.0 }
            };
            let beside = (0..CANDIDATES).map(|i| apart2(errors[i], [mean(i, 0), mean(i, 1)]));
            let distance2 = beside.fold(f64::INFINITY, f64::min);
            let reach2 = BESIDE_S * BESIDE_S * (speed2 + half2);
            let near = reach2 / (reach2 + distance2);
            let weight = motion * near * near;
            past.iter_mut().for_each(|(before, _)| *before *= 1.0 - weight * GRID_S / MEMORY_S);
            past.push((weight, errors));
            followed += motion * GRID_S / MEMORY_S * (near * near - followed);
            least = least.min(near);
            let total: f64 = past.iter().map(|(weight, _)| weight).sum();
            for (found, expected) in [
                (estimator.speed2, speed2),
                (estimator.shift.weight(), total),
                (estimator.followed, followed),
            ] {
                assert!((found / expected - 1.0).abs() < 1e-9, "{k}: {found} {expected}");
            }
            if estimator.estimate.is_some() {
                assert!(total * GRID_S >= MIN_MOTION_S, "{k}: {total} instants are too few");
            }
        }
        assert!(least < 0.3 && followed < 0.95, "it followed all the time: {least} {followed}");
        assert!(estimator.estimate.is_some());
    }
}
