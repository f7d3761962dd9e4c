//! `MixtureLearner`: read-outs, coefficients and weights learn from one displacement per step.
//!
//! The same function serves the daemon's learner thread, replay and the tables.

use std::sync::Arc;

use crate::pen::TARGET_RMS;
use crate::predict::LstmWeights;
use crate::predict::models::ar_rls::{ArRlsLearner, ArRlsSettings};
use crate::predict::models::mixture::mixer::{Mixer, MixerRule};
use crate::predict::models::mixture::readout::{RlsReadout, RlsRule};
use crate::predict::models::mixture::trunk::{ALL, MixtureMemory, PLAIN, Trunk, is_motion};
use crate::predict::models::mixture::{EXPERTS, LEADS, MixtureParameters, Path, preview};
use crate::predict::online::{ModelParameters, OnlineModel, WeightsError};

/// How it learns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MixtureSettings {
    /// λ of the read-outs, 0.99 to 1.
    pub forgetting: f64,
    /// η of the mixture per mean squared error.
    pub rate: f64,
    /// Share of the weight that is redistributed at every step, 0 to 0.1.
    pub share: f64,
}

impl Default for MixtureSettings {
    fn default() -> Self {
        Self { forgetting: 0.99985, rate: 0.1, share: 1e-3 }
    }
}

impl MixtureSettings {
    /// Checks every bound.
    ///
    /// # Errors
    ///
    /// The first bound that is broken.
    pub fn validate(&self) -> Result<(), WeightsError> {
        let within =
            |name, got, min, max| WeightsError::bounded(MixtureParameters::MODEL, name, got, min, max);
        within("forgetting", self.forgetting, 0.99, 1.0)
            .and(within("rate", self.rate, 0.0, 10.0))
            .and(within("share", self.share, 0.0, 0.1))
    }
}

/// Parameters that learn, with their own trunk, memory and accumulators.
#[derive(Debug, Clone)]
pub struct MixtureLearner {
    trunk: Trunk,
    memory: MixtureMemory,
    parameters: Box<MixtureParameters>,
    ar: ArRlsLearner,
    plain: RlsReadout<PLAIN>,
    full: RlsReadout<ALL>,
    mixer: Mixer,
    /// The last displacements summed: `shown[h − 1]` = the newest h.
    shown: [[f64; 2]; LEADS],
    /// The mixture's prediction of the next displacement.
    expected: [f64; 2],
}

impl MixtureLearner {
    /// Starts from `parameters` with empty memory.
    ///
    /// # Errors
    ///
    /// Invalid settings or parameters, or an LSTM of another kind.
    pub fn new(
        settings: MixtureSettings,
        lstm: Option<Arc<LstmWeights>>,
        parameters: MixtureParameters,
    ) -> Result<Self, WeightsError> {
        settings.validate()?;
        parameters.validate()?;
        let trunk = Trunk::new(lstm)?;
        let taking_part = if trunk.trained() { EXPERTS } else { EXPERTS - 2 };
        let rule = |start| RlsRule { forgetting: settings.forgetting, start, ceiling: 100.0, huber: 4.0 };
        let mixing = MixerRule { rate: settings.rate, share: settings.share, cap: 20.0 };
        Ok(Self {
            memory: MixtureMemory::EMPTY,
            ar: ArRlsLearner::new(ArRlsSettings::for_rms(TARGET_RMS), parameters.ar)?,
            parameters: Box::new(parameters),
            plain: RlsReadout::new(rule(10.0)),
            full: RlsReadout::new(rule(1.0)),
            mixer: Mixer::new(mixing, taking_part),
            shown: [[0.0; 2]; LEADS],
            expected: [0.0; 2],
            trunk,
        })
    }

    /// The mixture's and every expert's summed displacements at the nodes, from the present memory.
    #[must_use]
    pub fn experts(&self) -> [Path; EXPERTS] {
        self.parameters.experts(&self.memory)
    }

    /// The sums of the newest h displacements, for every h.
    fn show(&mut self, [x, y]: [f64; 2]) {
        self.shown.rotate_right(1);
        if let Some(newest) = self.shown.first_mut() {
            *newest = [0.0; 2];
        }
        for [sx, sy] in &mut self.shown {
            *sx += x;
            *sy += y;
        }
    }

    fn keep(&mut self, paths: &[Path; EXPERTS]) {
        let [constant, _, _, lstm, _] = *paths;
        self.plain.keep(self.memory.plain(), constant);
        if self.trunk.trained() {
            self.full.keep(&self.memory.features, lstm);
        }
        self.mixer.keep(paths);
    }
}

impl OnlineModel for MixtureLearner {
    type Parameters = MixtureParameters;
    type Memory = MixtureMemory;

    fn learn(&mut self, x: [f64; 2]) -> [f64; 2] {
        let predicted = self.expected;
        if is_motion(x) {
            self.show(x);
            self.mixer.settle(&mut self.parameters.shares, &self.shown);
            self.plain.settle(&mut self.parameters.plain, &self.shown);
            if self.trunk.trained() {
                self.full.settle(&mut self.parameters.full, &self.shown);
            }
            self.ar.learn(x);
            self.parameters.ar = *self.ar.parameters();
        }
        self.observe(x);
        predicted
    }

    fn observe(&mut self, x: [f64; 2]) {
        let motion = is_motion(x);
        if !motion {
            self.reset_state();
        }
        self.trunk.observe(&mut self.memory, x);
        let paths = self.parameters.experts(&self.memory);
        if motion {
            self.keep(&paths);
        }
        let [next, ..] = self.parameters.mix(&paths);
        self.expected = next;
    }

    fn reset_state(&mut self) {
        self.trunk.reset(&mut self.memory);
        self.ar.reset_state();
        self.plain.interrupt();
        self.full.interrupt();
        self.mixer.interrupt();
        self.shown = [[0.0; 2]; LEADS];
        self.expected = [0.0; 2];
    }

    fn parameters(&self) -> &MixtureParameters {
        &self.parameters
    }

    fn memory(&self) -> &MixtureMemory {
        &self.memory
    }

    fn continue_from(&mut self, parameters: &MixtureParameters) -> Result<(), WeightsError> {
        parameters.validate()?;
        self.parameters.accepts(parameters)?;
        self.ar.continue_from(&parameters.ar)?;
        *self.parameters = *parameters;
        Ok(())
    }

    fn restart_from(&mut self, parameters: &MixtureParameters) -> Result<(), WeightsError> {
        self.continue_from(parameters)?;
        self.ar.restart_from(&parameters.ar)?;
        self.plain.restart();
        self.full.restart();
        self.mixer.restart();
        Ok(())
    }

    fn preview_from(
        &self,
        parameters: &MixtureParameters,
        memory: &MixtureMemory,
        limit: f64,
        out: &mut [[f64; 2]],
    ) {
        preview(parameters, memory, limit, out);
    }
}
