//! Shadow comparison: the roll-out error that each set of weights would have had.
//!
//! At every step each contender rolls out to the last lead from the same memory; that many steps later the
//! error is known: e = mean over the leads i of |P_i − S_i|²/i², with P_i and S_i the predicted and the real
//! displacement summed over i steps, i.e. the mean squared error of the mean velocity over every lead that
//! the plan uses. The candidate is judged on predictions made before it learned from their outcome. Pauses
//! are left out; errors are capped, so that one outlier has bounded weight.

use thiserror::Error;

use crate::pen::{REST, TARGET_RMS};

/// Farthest lead of the comparison \[steps\].
pub const MAX_LEAD: usize = 32;

/// Errors are capped at this [in the plane, squared]: three typical displacements.
const ERROR_CAP: f64 = 18.0 * TARGET_RMS * TARGET_RMS;

/// The leads that count, both included \[steps after the newest closed one\].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Leads {
    first: usize,
    last: usize,
}

/// Leads that cannot be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error(
    "leads from {first} to {last} steps cannot be compared, legal are 1 to {MAX_LEAD} in ascending order"
)]
pub struct LeadsError {
    first: usize,
    last: usize,
}

impl Leads {
    /// From `first` to `last`.
    ///
    /// # Errors
    ///
    /// Zero, descending, or beyond [`MAX_LEAD`].
    pub const fn new(first: usize, last: usize) -> Result<Self, LeadsError> {
        if first == 0 || first > last || last > MAX_LEAD {
            return Err(LeadsError { first, last });
        }
        Ok(Self { first, last })
    }

    /// The leads that a plan of `horizon` steps uses behind a dead time of `dead_time_ns`: reference i lies i
    /// steps and the dead time ahead of a grid point that is up to one step old. Leads beyond [`MAX_LEAD`]
    /// are left out.
    #[must_use]
    pub fn of_loop(step_ns: u64, dead_time_ns: u64, horizon: usize) -> Self {
        let step_ns = step_ns.max(1);
        let steps = |ns: u64| usize::try_from(ns).unwrap_or(usize::MAX).min(MAX_LEAD);
        let first = (steps(dead_time_ns / step_ns) + 1).min(MAX_LEAD);
        let last = steps(dead_time_ns.div_ceil(step_ns)).saturating_add(horizon).clamp(first, MAX_LEAD);
        Self { first, last }
    }

    /// Nearest lead that counts.
    #[must_use]
    pub const fn first(self) -> usize {
        self.first
    }

    /// Farthest lead that counts.
    #[must_use]
    pub const fn last(self) -> usize {
        self.last
    }
}

/// Recent errors (mean squared) \[in the plane, per step, squared\] of two sets of weights over the same
/// steps.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Versus {
    /// Moving steps compared since one of the two changed, other than by learning.
    pub compared: u32,
    /// Error of the challenger.
    pub challenger: f64,
    /// Error of the one it is compared with.
    pub other: f64,
}

impl Versus {
    fn add(&mut self, memory: f64, challenger: f64, other: f64) {
        self.compared = self.compared.saturating_add(1);
        let weight = 1.0 / f64::from(self.compared).min(memory);
        self.challenger += weight * (capped(challenger) - self.challenger);
        self.other += weight * (capped(other) - self.other);
    }
}

/// NaN counts as the largest error.
fn capped(error: f64) -> f64 {
    if error < ERROR_CAP { error } else { ERROR_CAP }
}

type RollOutPath = [[f64; 2]; MAX_LEAD];

#[derive(Debug, Clone, Copy)]
struct RollOuts {
    candidate: RollOutPath,
    live: RollOutPath,
    previous: Option<RollOutPath>,
}

#[derive(Debug, Clone)]
pub(super) struct Shadow {
    leads: Leads,
    memory: f64,
    /// Roll-outs whose outcome is pending, newest first; `leads.last` of them.
    pending: Box<[RollOuts]>,
    /// Real displacements since the oldest of them, newest first.
    recent: RollOutPath,
    waiting: usize,
    candidate: Versus,
    live: Versus,
}

impl Shadow {
    pub(super) fn new(leads: Leads, memory: f64) -> Self {
        let nothing = [[0.0; 2]; MAX_LEAD];
        let empty = RollOuts { candidate: nothing, live: nothing, previous: None };
        Self {
            leads,
            memory,
            pending: vec![empty; leads.last].into_boxed_slice(),
            recent: nothing,
            waiting: 0,
            candidate: Versus::default(),
            live: Versus::default(),
        }
    }

    /// The memory was cleared: pending roll-outs have no outcome.
    pub(super) fn interrupt(&mut self) {
        self.waiting = 0;
    }

    /// Starts the comparison of the candidate again.
    pub(super) fn restart(&mut self) {
        self.waiting = 0;
        self.candidate = Versus::default();
        self.restart_previous();
    }

    /// Starts the comparison with the previous weights again.
    pub(super) fn restart_previous(&mut self) {
        self.live = Versus::default();
        for rollouts in &mut self.pending {
            rollouts.previous = None;
        }
    }

    /// The candidate against the live weights.
    pub(super) const fn candidate(&self) -> Versus {
        self.candidate
    }

    /// The live weights against the previous ones.
    pub(super) const fn live(&self) -> Versus {
        self.live
    }

    /// Judges the roll-outs whose last step has just been observed; `true` if they carry information.
    pub(super) fn resolve(&mut self, x: [f64; 2]) -> bool {
        self.recent.rotate_right(1);
        if let Some(newest) = self.recent.first_mut() {
            *newest = x;
        }
        if self.waiting < self.leads.last {
            return false;
        }
        self.waiting -= 1;
        let Some(rollouts) = self.pending.get(self.waiting) else { return false };
        let Some(real) = self.recent.get(..self.leads.last) else { return false };
        let moved: f64 = real.iter().flatten().map(|x| x * x).sum();
        // NaN counts as motion.
        if moved < REST * REST * self.leads.last as f64 {
            return false;
        }
        let error = |path: &RollOutPath| path_error(path, real, self.leads.first);
        let live = error(&rollouts.live);
        self.candidate.add(self.memory, error(&rollouts.candidate), live);
        if let Some(previous) = &rollouts.previous {
            self.live.add(self.memory, live, error(previous));
        }
        true
    }

    /// Stores the contenders' roll-outs from the present memory: candidate, live, previous.
    pub(super) fn preview(&mut self, mut roll_out: impl FnMut(Contender, &mut [[f64; 2]]) -> bool) {
        self.pending.rotate_right(1);
        let Some(RollOuts { candidate, live, previous }) = self.pending.first_mut() else { return };
        let mut fill = |contender, path: &mut RollOutPath| {
            path.get_mut(..self.leads.last).is_some_and(|path| roll_out(contender, path))
        };
        fill(Contender::Candidate, candidate);
        fill(Contender::Live, live);
        let mut path = [[0.0; 2]; MAX_LEAD];
        *previous = fill(Contender::Previous, &mut path).then_some(path);
        self.waiting = (self.waiting + 1).min(self.leads.last);
    }
}

/// Which weights roll out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Contender {
    Candidate,
    Live,
    /// There may be none.
    Previous,
}

/// e of the module; `predicted` oldest first, `real` newest first, both per step.
fn path_error(predicted: &RollOutPath, real: &[[f64; 2]], first: usize) -> f64 {
    let mut error = 0.0;
    let mut ahead = 0.0;
    let mut counted = 0.0;
    let [mut off_x, mut off_y] = [0.0; 2];
    for ([px, py], [x, y]) in predicted.iter().zip(real.iter().rev()) {
        ahead += 1.0;
        off_x += px - x;
        off_y += py - y;
        if ahead >= first as f64 {
            counted += 1.0;
            error += (off_x * off_x + off_y * off_y) / (ahead * ahead);
        }
    }
    error / f64::max(counted, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leads_of_a_loop_begin_behind_its_dead_time() {
        let leads = Leads::of_loop(10_000_000, 34_500_000, 10);
        assert_eq!((leads.first(), leads.last()), (4, 14));
        let ideal = Leads::of_loop(10_000_000, 0, 10);
        assert_eq!((ideal.first(), ideal.last()), (1, 10));
        let far = Leads::of_loop(4_000_000, 500_000_000, 30);
        assert_eq!((far.first(), far.last()), (MAX_LEAD, MAX_LEAD));
        for (first, last) in [(0, 3), (4, 3), (1, MAX_LEAD + 1)] {
            assert!(Leads::new(first, last).is_err());
        }
    }

    #[test]
    fn only_leads_that_count_are_judged() {
        let mut predicted = [[0.0; 2]; MAX_LEAD];
        predicted[0] = [4.0, 0.0];
        predicted[1] = [-4.0, 0.0];
        let real = [[0.0; 2]; 3];
        // Off by 4 after one step, right after two and three.
        assert_eq!(path_error(&predicted, &real, 1), 16.0 / 3.0);
        assert_eq!(path_error(&predicted, &real, 2), 0.0);
    }
}
