//! `Models`: what the predictors are made of and never changes while they run: sizes, learning rules, the reservoir,
//! trained networks. The loop and the learner are built from the same, so that weights learned in one fit the other.

use std::sync::Arc;

use thiserror::Error;

use crate::predict::bands::BandTable;
use crate::predict::models::dybm::{DybmShape, TraceInput};
use crate::predict::models::esn::{ReadoutRule, Reservoir, ReservoirSettings};
use crate::predict::models::lstm::{Lstm, LstmError, LstmWeights};
use crate::predict::online::WeightsError;
use crate::predict::{
    ArRls, ArRlsLearner, ArRlsSettings, ArRlsWeights, Dybm, DybmEsn, DybmEsnLearner, DybmEsnSettings,
    DybmEsnWeights, DybmLearner, DybmSettings, DybmWeights, Mixture, MixtureLearner, MixtureParameters,
    MixtureSettings, OnlineWeights, Optimiser, PredictorKind,
};

/// A DyBM before anything was learned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InitialWeights {
    /// All zero, as in the paper: predicts like Hold at first.
    Zero,
    /// W_1 = this·I: predicts the last displacement, fading by this factor per step.
    Persistent(f64),
}

/// Sizes and learning rules of the models that learn online.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelSettings {
    /// Δ [ns].
    pub step_ns: u64,
    /// The linear DyBM, alone and beside a reservoir.
    pub dybm: DybmSettings,
    /// Its start.
    pub initial: InitialWeights,
    /// The reservoir.
    pub reservoir: ReservoirSettings,
    /// How the reservoir's read-out learns.
    pub readout: Optimiser,
    /// AR-RLS.
    pub ar_rls: ArRlsSettings,
    /// The mixture.
    pub mixture: MixtureSettings,
}

impl ModelSettings {
    /// The models of the preset loop; how they were chosen stands in [`crate::learn::LearnerSettings::preset`].
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
            // Jumps have been recognised before a displacement comes here; the gate is for what is left.
            ar_rls: ArRlsSettings { gate: 100.0, huber: 12.0, ..ArRlsSettings::default() },
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
    /// The predictor `lstm`; without it there is none.
    pub lstm: Option<Arc<LstmWeights>>,
    /// The expert of `mixture`, with a direct output per lead; without it the mixture starts cold.
    pub mixture: Option<Arc<LstmWeights>>,
}

impl Models {
    /// Builds the reservoir.
    ///
    /// *Errors*: settings outside their bounds, or a network of another kind or trained for another loop.
    pub fn new(settings: ModelSettings, networks: Networks) -> Result<Self, ModelsError> {
        for network in networks.lstm.iter().chain(&networks.mixture) {
            network.fits(settings.step_ns)?;
        }
        let models =
            Self { settings, reservoir: Arc::new(Reservoir::seeded(&settings.reservoir)?), networks };
        // Whatever is built later is built from settings that were judged here.
        let weights = models.initial_weights();
        models.dybm_learner(&weights)?;
        models.dybm_esn_learner(&weights)?;
        models.ar_rls_learner(&weights)?;
        models.mixture_learner(&weights)?;
        Ok(models)
    }

    /// What they were built from.
    #[must_use]
    pub const fn settings(&self) -> &ModelSettings {
        &self.settings
    }

    /// The trained networks.
    #[must_use]
    pub const fn networks(&self) -> &Networks {
        &self.networks
    }

    /// `kind` can be chosen. The oracle needs a recording as well.
    #[must_use]
    pub const fn has(&self, kind: PredictorKind) -> bool {
        !matches!(kind, PredictorKind::LSTM) || self.networks.lstm.is_some()
    }

    /// The weights before anything was learned.
    #[must_use]
    pub fn initial_weights(&self) -> OnlineWeights {
        let ModelSettings { step_ns, dybm: DybmSettings { shape, .. }, initial, .. } = self.settings;
        let dybm = match initial {
            InitialWeights::Zero => DybmWeights::zero(step_ns, shape),
            InitialWeights::Persistent(factor) => DybmWeights::persistent(step_ns, shape, factor),
        };
        OnlineWeights {
            version: 0,
            dybm,
            dybm_esn: DybmEsnWeights::new(dybm, self.reservoir.digest()),
            ar_rls: ArRlsWeights::constant_velocity(step_ns),
            mixture: MixtureParameters::untrained(step_ns, self.networks.mixture.is_some()),
            bands: BandTable::default(),
        }
    }

    /// A linear DyBM with its part of `weights`, to predict with.
    ///
    /// *Errors*: weights that are invalid or do not fit; so for the others.
    pub fn dybm(&self, weights: &OnlineWeights) -> Result<Dybm, WeightsError> {
        Dybm::new(weights.dybm)
    }

    /// The same, to learn with.
    pub fn dybm_learner(&self, weights: &OnlineWeights) -> Result<DybmLearner, WeightsError> {
        DybmLearner::new(self.settings.dybm, weights.dybm)
    }

    /// A DyBM with a reservoir, to predict with.
    pub fn dybm_esn(&self, weights: &OnlineWeights) -> Result<DybmEsn, WeightsError> {
        DybmEsn::new(weights.dybm_esn, self.reservoir.clone())
    }

    /// The same, to learn with.
    pub fn dybm_esn_learner(&self, weights: &OnlineWeights) -> Result<DybmEsnLearner, WeightsError> {
        let ModelSettings { dybm, readout, .. } = self.settings;
        let settings = DybmEsnSettings { dybm, readout, rule: ReadoutRule::SharedResidual };
        DybmEsnLearner::new(settings, weights.dybm_esn, self.reservoir.clone())
    }

    /// An AR-RLS model, to predict with.
    pub fn ar_rls(&self, weights: &OnlineWeights) -> Result<ArRls, WeightsError> {
        ArRls::new(weights.ar_rls, self.settings.ar_rls.gate)
    }

    /// The same, to learn with.
    pub fn ar_rls_learner(&self, weights: &OnlineWeights) -> Result<ArRlsLearner, WeightsError> {
        ArRlsLearner::new(self.settings.ar_rls, weights.ar_rls)
    }

    /// The mixture, to predict with.
    pub fn mixture(&self, weights: &OnlineWeights) -> Result<Mixture, WeightsError> {
        Mixture::new(self.networks.mixture.clone(), weights.mixture)
    }

    /// The same, to learn with.
    pub fn mixture_learner(&self, weights: &OnlineWeights) -> Result<MixtureLearner, WeightsError> {
        MixtureLearner::new(self.settings.mixture, self.networks.mixture.clone(), weights.mixture)
    }

    /// The trained network, with empty memory.
    #[must_use]
    pub fn lstm(&self) -> Option<Lstm> {
        self.networks.lstm.clone().map(Lstm::new)
    }
}
