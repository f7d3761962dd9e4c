//! How good previews are: squared error of the predicted way over that of standing still.

use foretrace_control::predict::models::foresight::{OUTPUTS, unit};
use foretrace_control::predict::models::mixture::{NODE_COUNT, NODES};

use crate::train::engine::Scores;

/// Leads that are reported \[s\].
pub const LEADS_S: [f64; 2] = [0.035, 0.055];

/// Weight of each node in the loss: near leads have the smaller errors and matter as much.
#[must_use]
pub(super) fn weights() -> [f32; NODE_COUNT] {
    NODES.map(|node| 4.0 / (node as f32 + 3.0))
}

/// Sums of errors over examples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorSums {
    step_s: f64,
    loss: f64,
    examples: f64,
    /// Squared error of the way and squared way at each of [`LEADS_S`].
    sums: [[f64; 2]; LEADS_S.len()],
}

impl ErrorSums {
    /// Nothing seen, on a grid of `step_s` \[s\].
    #[must_use]
    pub fn new(step_s: f64) -> Self {
        Self { step_s, loss: 0.0, examples: 0.0, sums: [[0.0; 2]; LEADS_S.len()] }
    }

    pub fn add(&mut self, output: &[f32; OUTPUTS], target: &[f32; OUTPUTS], known: u8) {
        let known = usize::from(known);
        self.examples += 1.0;
        for (index, (output, target)) in output.iter().zip(target).take(2 * known).enumerate() {
            let error = f64::from(output - target);
            self.loss += f64::from(weights()[index / 2]) * error * error;
        }
        for (lead_s, [error, still]) in LEADS_S.iter().zip(&mut self.sums) {
            let lead = lead_s / self.step_s;
            let (Some(predicted), Some(real)) = (way(output, known, lead), way(target, known, lead)) else {
                continue;
            };
            *error += (predicted[0] - real[0]).powi(2) + (predicted[1] - real[1]).powi(2);
            *still += real[0].powi(2) + real[1].powi(2);
        }
    }

    /// Adds `other`.
    pub fn merge(&mut self, other: &Self) {
        self.loss += other.loss;
        self.examples += other.examples;
        for (sum, other) in self.sums.as_flattened_mut().iter_mut().zip(other.sums.as_flattened()) {
            *sum += other;
        }
    }

    /// Squared error over that of standing still, at each of [`LEADS_S`].
    #[must_use]
    pub fn shares(&self) -> [f64; LEADS_S.len()] {
        self.sums.map(|[error, still]| if still > 0.0 { error / still } else { 0.0 })
    }

    /// Squared error and squared way at each of [`LEADS_S`].
    #[must_use]
    pub const fn sums(&self) -> &[[f64; 2]; LEADS_S.len()] {
        &self.sums
    }

    /// In the slots that a checkpoint has: the loss, and the shares at both leads and their mean.
    #[must_use]
    pub fn scores(&self) -> Scores {
        let [near, far] = self.shares();
        let loss = self.loss / self.examples.max(1.0);
        Scores { loss, mse: near, within: far, position: 0.5 * (near + far) }
    }
}

/// The way to `lead` steps, on straight lines between nodes; `None` beyond what is known.
fn way(row: &[f32; OUTPUTS], known: usize, lead: f64) -> Option<[f64; 2]> {
    let after = NODES.iter().position(|node| *node as f64 >= lead).filter(|after| *after < known)?;
    let at = |node: usize| {
        let [x, y] = [row[2 * node], row[2 * node + 1]];
        [x, y].map(|x| f64::from(x) * unit(NODES[node]))
    };
    let (from, start) = match after.checked_sub(1) {
        Some(before) => (NODES[before] as f64, at(before)),
        None => (0.0, [0.0; 2]),
    };
    let part = (lead - from) / (NODES[after] as f64 - from);
    let end = at(after);
    Some([0, 1].map(|axis| start[axis] + part * (end[axis] - start[axis])))
}
