//! The recipes behind the reference rows, as starting points for options.

use super::adam::Schedule;
use super::loss::{Objective, Padding, Penalty};
use super::parameters::{Network, Shape};

/// A named way to train.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Recipe {
    /// The paper's: mean squared error, zero padding counted, Adam 1e-3, batch 16, 40 epochs.
    Paper,
    /// `l32h` of the reference tables: inputs cut at 4 RMS, residual output, Huber (0.5 RMS), padding masked, one-cycle
    /// Adam up to 1e-2, batch 32, 60 epochs.
    Robust,
}

impl Recipe {
    /// Its name in options and metadata.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Robust => "robust",
        }
    }

    /// The network, for `cells` cells and `leads` leads.
    #[must_use]
    pub const fn network(self, cells: usize, leads: usize) -> Network {
        let shape = Shape { cells, leads };
        match self {
            Self::Paper => Network { shape, clip: None, residual: false, reset_beyond: None },
            Self::Robust => Network { shape, clip: Some(4.0), residual: true, reset_beyond: None },
        }
    }

    /// What is minimised. One lead: the displacement. More: the position at each, weighted by 1 / lead.
    #[must_use]
    pub fn objective(self, leads: usize) -> Objective {
        let (penalty, padding) = match self {
            Self::Paper => (Penalty::Squared, Padding::Counted),
            Self::Robust => (Penalty::Huber { delta: 0.5 }, Padding::Masked),
        };
        let weights: Vec<f64> = (1..=leads).map(|lead| 1.0 / lead as f64).collect();
        let zeros = vec![0.0; leads];
        let (step, position) = if leads == 1 { (weights, zeros) } else { (zeros, weights) };
        Objective { penalty, padding, gate: None, step, position }
    }

    /// Learning rate over the steps, at the given or usual (peak) rate.
    #[must_use]
    pub fn schedule(self, rate: Option<f64>) -> Schedule {
        match self {
            Self::Paper => Schedule::Constant { rate: rate.unwrap_or(1e-3) },
            Self::Robust => Schedule::OneCycle { peak: rate.unwrap_or(1e-2), warm_up: 0.3 },
        }
    }

    /// Usual number of epochs.
    #[must_use]
    pub const fn epochs(self, cells: usize) -> usize {
        match (self, cells) {
            (Self::Paper, _) => 40,
            // As the reference rows: larger networks need fewer passes.
            (Self::Robust, ..=31) => 60,
            (Self::Robust, 32..=63) => 40,
            (Self::Robust, _) => 30,
        }
    }

    /// Usual batch.
    #[must_use]
    pub const fn batch(self) -> usize {
        match self {
            Self::Paper => 16,
            Self::Robust => 32,
        }
    }
}
