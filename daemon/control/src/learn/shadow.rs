//! Shadow comparison: what would each set of weights have predicted, and how wrong was it?
//!
//! At every step each contender rolls out `lead` steps from the same memory; `lead` steps later the error is known:
//! e = (1/lead) Σ_i |P_i − S_i|²/i², with P_i and S_i the predicted and the real displacement summed over i steps, i.e.
//! the mean squared error of the mean velocity over every lead that the MPC looks at. The candidate is judged on
//! predictions made before it learned from what they predict. Pauses say nothing and are left out; one wild step counts
//! no more than a bounded error.

use crate::pen::TARGET_RMS;
use crate::predict::DybmWeights;
use crate::predict::dybm::{DybmState, roll_out};

/// Longest lead of the comparison [steps].
pub const MAX_LEAD: usize = 16;

/// Errors count no more than this: three typical displacements.
const ERROR_CAP: f64 = 18.0 * TARGET_RMS * TARGET_RMS;
/// Mean squared displacement per step below which the pen pauses: a tenth of the typical one.
const PAUSE: f64 = 0.02 * TARGET_RMS * TARGET_RMS;

/// Recent errors (mean squared, normalised), all over the same steps.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ShadowErrors {
    /// Moving steps compared since the last change.
    pub compared: u32,
    /// Of the weights that learn.
    pub candidate: f64,
    /// Of the weights in the loop.
    pub live: f64,
    /// Of the weights before those; 0 when there are none.
    pub previous: f64,
}

/// The weights that compete.
pub(super) struct Contenders<'a> {
    pub(super) candidate: &'a DybmWeights,
    pub(super) live: &'a DybmWeights,
    pub(super) previous: Option<&'a DybmWeights>,
}

type Path = [[f64; 2]; MAX_LEAD];

/// One step's roll-outs: candidate, live, previous.
type Rollouts = [Path; 3];

#[derive(Debug, Clone, Copy)]
pub(super) struct Shadow {
    lead: usize,
    memory: f64,
    /// Roll-outs that wait for their future, newest first; MAX_LEAD x 3 x MAX_LEAD x 2.
    pending: [Rollouts; MAX_LEAD],
    /// Real displacements since the oldest of them, newest first.
    recent: Path,
    waiting: usize,
    errors: [f64; 3],
    compared: u32,
}

impl Shadow {
    pub(super) fn new(lead: usize, memory: f64) -> Self {
        Self {
            lead,
            memory,
            pending: [[[[0.0; 2]; MAX_LEAD]; 3]; MAX_LEAD],
            recent: [[0.0; 2]; MAX_LEAD],
            waiting: 0,
            errors: [0.0; 3],
            compared: 0,
        }
    }

    /// The memory was emptied: nothing that waits will see its future.
    pub(super) fn interrupt(&mut self) {
        self.waiting = 0;
    }

    /// Other weights compete from here on.
    pub(super) fn restart(&mut self) {
        self.waiting = 0;
        self.errors = [0.0; 3];
        self.compared = 0;
    }

    pub(super) fn errors(&self) -> ShadowErrors {
        let [candidate, live, previous] = self.errors;
        ShadowErrors { compared: self.compared, candidate, live, previous }
    }

    /// Judges the roll-outs whose last step has just been seen.
    pub(super) fn settle(&mut self, x: [f64; 2]) {
        self.recent.rotate_right(1);
        if let Some(newest) = self.recent.first_mut() {
            *newest = x;
        }
        if self.waiting < self.lead {
            return;
        }
        self.waiting -= 1;
        let Some(rollouts) = self.pending.get(self.waiting) else { return };
        let Some(real) = self.recent.get(..self.lead) else { return };
        let moved: f64 = real.iter().flatten().map(|x| x * x).sum();
        if moved < PAUSE * self.lead as f64 {
            return;
        }
        self.compared = self.compared.saturating_add(1);
        let weight = 1.0 / f64::from(self.compared).min(self.memory);
        for (mean, rollout) in self.errors.iter_mut().zip(rollouts) {
            let error = path_error(rollout, real);
            *mean += weight * (if error < ERROR_CAP { error } else { ERROR_CAP } - *mean);
        }
    }

    /// Lets every contender predict from `state`.
    pub(super) fn preview(&mut self, contenders: &Contenders<'_>, state: &DybmState) {
        self.pending.rotate_right(1);
        let Some([candidate, live, previous]) = self.pending.first_mut() else { return };
        let entries = [
            (candidate, Some(contenders.candidate)),
            (live, Some(contenders.live)),
            (previous, contenders.previous),
        ];
        for (path, weights) in entries {
            if let (Some(weights), Some(path)) = (weights, path.get_mut(..self.lead)) {
                roll_out(weights, *state, f64::INFINITY, path);
            }
        }
        self.waiting = (self.waiting + 1).min(self.lead);
    }
}

/// e of the module's doc; `predicted` oldest first, `real` newest first, both per step.
fn path_error(predicted: &Path, real: &[[f64; 2]]) -> f64 {
    let mut error = 0.0;
    let mut ahead = 0.0;
    let [mut off_x, mut off_y] = [0.0; 2];
    for ([px, py], [x, y]) in predicted.iter().zip(real.iter().rev()) {
        ahead += 1.0;
        off_x += px - x;
        off_y += py - y;
        error += (off_x * off_x + off_y * off_y) / (ahead * ahead);
    }
    error / f64::max(ahead, 1.0)
}
