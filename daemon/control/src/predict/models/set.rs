//! `Models`: the constant part of the predictors: sizes, learning rules, the reservoir, trained networks. The
//! loop and the learner are built from the same, so that weights learned in one fit the other.

use std::sync::Arc;

use thiserror::Error;

use crate::predict::models::dybm::{DybmShape, TraceInput};
use crate::predict::models::esn::{Reservoir, ReservoirSettings};
use crate::predict::models::foresight::{ForesightError, ForesightWeights};
use crate::predict::models::lstm::{LstmError, LstmWeights};
use crate::predict::online::WeightsError;
use crate::predict::{ArRlsSettings, DybmSettings, MixtureSettings, OnlineWeights, Optimiser, PredictorKind};

/// Initial weights of a DyBM.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InitialWeights {
    /// All zero, as in the paper: predicts like Hold at first.
    Zero,
    /// W_1 = this·I: predicts the last displacement, decaying by this factor per step.
    Persistent(f64),
}

/// Sizes and learning rules of the models that learn online.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelSettings {
    /// Δ \[ns\].
    pub step_ns: u64,
    /// The linear DyBM, alone and beside a reservoir.
    pub dybm: DybmSettings,
    /// Weights that the DyBM starts with.
    pub initial: InitialWeights,
    /// What the reservoir is made from.
    pub reservoir: ReservoirSettings,
    /// How the reservoir's read-out learns.
    pub readout: Optimiser,
    /// Those of AR-RLS, an expert too.
    pub ar_rls: ArRlsSettings,
    /// How the mixture learns online.
    pub mixture: MixtureSettings,
}

impl ModelSettings {
    /// Longer displacements are jumps for the AR-RLS of the preset loop [in the plane]: seven ordinary steps.
    /// The pen tracker detects jumps first; this catches the rest.
    pub const AR_RLS_GATE: f64 = 100.0;
    /// Its errors are clipped to this [per axis]: 1.2 ordinary steps.
    pub const AR_RLS_HUBER: f64 = 12.0;

    /// The models of the preset loop; how they were chosen stands in
    /// [`crate::learn::LearnerSettings::preset`].
    #[must_use]
    pub fn preset(step_ns: u64) -> Self {
        Self {
            step_ns,
            dybm: DybmSettings {
                shape: DybmShape::new(9, &[0.5], TraceInput::Delayed),
                optimiser: Optimiser::ada_grad(0.01),
                l1: 0.0,
                l2: 0.0,
            },
            initial: InitialWeights::Persistent(0.95),
            reservoir: ReservoirSettings::default(),
            readout: Optimiser::ada_grad(0.01),
            ar_rls: ArRlsSettings {
                gate: Self::AR_RLS_GATE,
                huber: Self::AR_RLS_HUBER,
                ..ArRlsSettings::default()
            },
            mixture: MixtureSettings::default(),
        }
    }
}

/// Models that cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ModelsError {
    /// A model that learns online.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// A trained network.
    #[error(transparent)]
    Lstm(#[from] LstmError),
    /// The trained network that sees contact, direction and time.
    #[error(transparent)]
    Foresight(#[from] ForesightError),
}

/// Settings, reservoir and trained networks; clones share the large parts.
#[derive(Debug, Clone, PartialEq)]
pub struct Models {
    settings: ModelSettings,
    reservoir: Arc<Reservoir>,
    networks: Networks,
}

/// Networks that were trained offline.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Networks {
    /// The network of predictor `lstm`; without it that predictor is absent.
    pub lstm: Option<Arc<LstmWeights>>,
    /// The expert of `mixture`, with a direct output per lead; without it the mixture starts cold.
    pub mixture: Option<Arc<LstmWeights>>,
    /// Its expert that sees contact, direction and time; without it the mixture does without.
    pub foresight: Option<Arc<ForesightWeights>>,
}

impl Models {
    /// Builds the reservoir.
    ///
    /// # Errors
    ///
    /// Settings outside their bounds, or a network of another kind or trained for another loop.
    pub fn new(settings: ModelSettings, networks: Networks) -> Result<Self, ModelsError> {
        for network in networks.lstm.iter().chain(&networks.mixture) {
            network.fits(settings.step_ns)?;
        }
        if let Some(network) = &networks.foresight {
            network.fits(settings.step_ns)?;
        }
        let models = Self { settings, reservoir: Reservoir::shared(&settings.reservoir)?, networks };
        // Later builds use settings that were checked here.
        models.initial_weights().can_be_taught(&models)?;
        Ok(models)
    }

    /// The settings they were built from.
    #[must_use]
    pub const fn settings(&self) -> &ModelSettings {
        &self.settings
    }

    /// The networks that were trained offline.
    #[must_use]
    pub const fn networks(&self) -> &Networks {
        &self.networks
    }

    /// `kind` can be chosen. The oracle needs a recording as well.
    #[must_use]
    pub fn has(&self, kind: PredictorKind) -> bool {
        kind.is_in(self)
    }

    /// The reservoir of those that have one.
    #[must_use]
    pub const fn reservoir(&self) -> &Arc<Reservoir> {
        &self.reservoir
    }

    /// The weights before anything is learned.
    #[must_use]
    pub fn initial_weights(&self) -> OnlineWeights {
        OnlineWeights::start(self)
    }
}
