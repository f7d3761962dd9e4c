//! The recipes behind the reference rows, as starting points for options.

use foretrace_control::pen::TARGET_RMS;
use foretrace_control::predict::models::mixture;

use super::adam::Schedule;
use super::augment::Augment;
use super::corpus::Units;
use super::loss::{Objective, Padding, Penalty};
use super::parameters::{LstmNetwork, LstmShape};

/// A named way to train.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Recipe {
    /// The paper's: mean squared error, zero padding counted, Adam 1e-3, batch 16, 40 epochs.
    Paper,
    /// `l32h` of the reference tables: inputs cut at 4 RMS, residual output, Huber (0.5 RMS), padding masked,
    /// one-cycle Adam up to 1e-2, batch 32, 60 epochs.
    Robust,
    /// The trunk of `mixture`: 24 direct leads on normalised inputs, positions at every lead, no jump learned
    /// from or across, changed copies for other hands and rates.
    Mixture,
}

/// Displacements beyond this many RMS are jumps to `mixture`.
const MIXTURE_GATE: f64 = mixture::GATE / TARGET_RMS;

impl Recipe {
    pub const ALL: [Self; 3] = [Self::Paper, Self::Robust, Self::Mixture];

    /// Its name in options and metadata.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Robust => "robust",
            Self::Mixture => "mixture",
        }
    }

    /// The network, for `cells` cells and `leads` leads.
    #[must_use]
    pub const fn network(self, cells: usize, leads: usize) -> LstmNetwork {
        let shape = LstmShape { cells, leads };
        match self {
            Self::Paper => LstmNetwork { shape, clip: None, residual: false, reset_beyond: None },
            Self::Robust => LstmNetwork { shape, clip: Some(4.0), residual: true, reset_beyond: None },
            Self::Mixture => {
                LstmNetwork { shape, clip: Some(4.0), residual: true, reset_beyond: Some(MIXTURE_GATE) }
            }
        }
    }

    /// Usual number of leads.
    #[must_use]
    pub const fn leads(self) -> usize {
        match self {
            Self::Paper | Self::Robust => 1,
            Self::Mixture => mixture::LEADS,
        }
    }

    #[must_use]
    pub const fn units(self) -> Units {
        match self {
            Self::Paper | Self::Robust => Units::Raw,
            Self::Mixture => Units::Normalised,
        }
    }

    /// Usual changes of the sequences.
    #[must_use]
    pub fn augment(self) -> Augment {
        match self {
            Self::Paper | Self::Robust => Augment::default(),
            Self::Mixture => Augment {
                scale: Some((0.7, 1.4)),
                time: Some((0.8, 1.25)),
                rotate: 10.0,
                shear: 0.15,
                ..Augment::default()
            },
        }
    }

    #[must_use]
    pub const fn limit_norm(self) -> Option<f64> {
        match self {
            Self::Paper | Self::Robust => None,
            Self::Mixture => Some(1.0),
        }
    }

    /// What is minimised. One lead: the displacement. More: the position at each, weighted by 1 / lead; for
    /// `mixture` by about the inverse of its usual squared error, and the next step 40 times over.
    #[must_use]
    pub fn objective(self, leads: usize) -> Objective {
        let (penalty, padding) = match self {
            Self::Paper => (Penalty::Squared, Padding::Counted),
            Self::Robust => (Penalty::Huber { delta: 0.5 }, Padding::Masked),
            Self::Mixture => (Penalty::Squared, Padding::Masked),
        };
        let weight = |lead: usize| match (self, lead) {
            (Self::Paper | Self::Robust, _) => 1.0 / lead as f64,
            (Self::Mixture, 1) => 40.0,
            (Self::Mixture, _) => (lead as f64).powf(-2.5),
        };
        let gate = (self == Self::Mixture).then_some(MIXTURE_GATE);
        let weights: Vec<f64> = (1..=leads).map(weight).collect();
        let zeros = vec![0.0; leads];
        let (step, position) = if leads == 1 { (weights, zeros) } else { (zeros, weights) };
        Objective { penalty, padding, gate, step, position }
    }

    /// Learning rate over the steps, at the given or usual (peak) rate.
    #[must_use]
    pub fn schedule(self, rate: Option<f64>) -> Schedule {
        match self {
            Self::Paper => Schedule::Constant { rate: rate.unwrap_or(1e-3) },
            Self::Robust => Schedule::OneCycle { peak: rate.unwrap_or(1e-2), warm_up: 0.3 },
            Self::Mixture => Schedule::OneCycle { peak: rate.unwrap_or(1e-2), warm_up: 0.15 },
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
            (Self::Mixture, _) => 60,
        }
    }

    #[must_use]
    pub const fn batch(self) -> usize {
        match self {
            Self::Paper => 16,
            Self::Robust | Self::Mixture => 32,
        }
    }
}
