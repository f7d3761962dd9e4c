//! `MixtureLearner`: read-outs, coefficients and weights learn from one displacement per step.
//!
//! The same function serves the daemon's learner thread, replay and the tables.

use crate::pen::TARGET_RMS;
use crate::predict::PenStep;
use crate::predict::models::ar_rls::{ArRlsLearner, ArRlsSettings};
use crate::predict::models::foresight::READ;
use crate::predict::models::mixture::mixer::{Mixer, MixerRule};
use crate::predict::models::mixture::parameters::taking_part;
use crate::predict::models::mixture::readout::{PLANE, RlsReadout, RlsRule};
use crate::predict::models::mixture::trunk::{ALL, MixtureMemory, PLAIN, TrainedNetworks, Trunk, is_motion};
use crate::predict::models::mixture::{EXPERTS, LEADS, MixtureParameters, NodePath, preview};
use crate::predict::online::{ModelParameters, OnlineModel, WeightsError};

/// How the mixture and its experts learn.
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

/// P₀ of the read-out of `foresight`, over that of a unit matrix.
const FORESIGHT_START: f64 = 1.0;

/// Parameters that learn, with their own trunk, memory and accumulators.
#[derive(Debug, Clone)]
pub struct MixtureLearner {
    trunk: Trunk,
    memory: MixtureMemory,
    parameters: Box<MixtureParameters>,
    ar: ArRlsLearner,
    plain: RlsReadout<PLAIN>,
    full: RlsReadout<ALL>,
    foresight: RlsReadout<READ>,
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
    /// Invalid settings or parameters, or a network of another kind.
    pub fn new(
        settings: MixtureSettings,
        trained: impl Into<TrainedNetworks>,
        parameters: MixtureParameters,
    ) -> Result<Self, WeightsError> {
        settings.validate()?;
        parameters.validate()?;
        let trunk = Trunk::new(trained.into())?;
        let rule = |start| RlsRule { forgetting: settings.forgetting, start, ceiling: 100.0, huber: 4.0 };
        let mixing = MixerRule { rate: settings.rate, share: settings.share, cap: 20.0 };
        Ok(Self {
            memory: MixtureMemory::EMPTY,
            ar: ArRlsLearner::new(ArRlsSettings::for_rms(TARGET_RMS), parameters.ar)?,
            parameters: Box::new(parameters),
            plain: RlsReadout::new(rule(10.0)),
            full: RlsReadout::new(rule(1.0)),
            foresight: RlsReadout::new(rule(FORESIGHT_START)),
            mixer: Mixer::new(mixing, taking_part(trunk.present())),
            shown: [[0.0; 2]; LEADS],
            expected: [0.0; 2],
            trunk,
        })
    }

    /// The mixture's and every expert's summed displacements at the nodes, from the present memory.
    #[must_use]
    pub fn experts(&self) -> [NodePath; EXPERTS] {
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

    fn keep(&mut self, paths: &[NodePath; EXPERTS]) {
        let [constant, _, _, lstm, ..] = *paths;
        self.plain.keep(self.memory.plain(), constant, PLANE);
        if self.trunk.present().lstm {
            self.full.keep(&self.memory.features, lstm, PLANE);
        }
        if let Some(answer) = &self.memory.foresight {
            self.foresight.keep(&answer.read, answer.path, answer.frame);
        }
        self.mixer.keep(paths);
    }
}

impl OnlineModel for MixtureLearner {
    type Parameters = MixtureParameters;
    type Memory = MixtureMemory;

    fn learn(&mut self, x: [f64; 2]) -> [f64; 2] {
        self.learn_pen(&PenStep::of(x))
    }

    fn learn_pen(&mut self, step: &PenStep) -> [f64; 2] {
        let x = step.x;
        let predicted = self.expected;
        if is_motion(x) {
            self.show(x);
            self.mixer.resolve(&mut self.parameters.shares, &self.shown);
            self.plain.resolve(&mut self.parameters.plain, &self.shown);
            if self.trunk.present().lstm {
                self.full.resolve(&mut self.parameters.full, &self.shown);
            }
            if self.trunk.present().foresight {
                self.foresight.resolve(&mut self.parameters.foresight, &self.shown);
            }
            self.ar.learn(x);
            self.parameters.ar = *self.ar.parameters();
        }
        self.observe_pen(step);
        predicted
    }

    fn observe(&mut self, x: [f64; 2]) {
        self.observe_pen(&PenStep::of(x));
    }

    fn observe_pen(&mut self, step: &PenStep) {
        let motion = is_motion(step.x);
        if !motion {
            self.reset_state();
        }
        self.trunk.observe(&mut self.memory, step);
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
        self.foresight.interrupt();
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
        self.foresight.restart();
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
