//! The contestants by name.
//!
//! DyBM rows: delay 2, decay 0.5, AdaGrad 0.1, three training passes over the train split in its own order,
//! raw units. Models with parameters for displacements of a certain size (networks, gates) get the set's raw
//! units if these are of that size, else the running scale of the loop ([`Scaled`]); the row's note tells
//! which.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use foretrace_config::models::{self, LstmModel, shipped};
use foretrace_control::pen::TARGET_RMS;
use foretrace_control::predict::models::dybm::{DybmShape, TraceInput};
use foretrace_control::predict::models::esn::{ReadoutRule, Reservoir, ReservoirSettings};
use foretrace_control::predict::models::mixture::{MixtureLearner, MixtureParameters, MixtureSettings};
use foretrace_control::predict::{
    ArRlsLearner, ArRlsSettings, ArRlsWeights, DybmEsnLearner, DybmEsnSettings, DybmLearner, DybmSettings,
    DybmWeights, LstmWeights, ModelsError, Optimiser, PredictorKind, WeightsError,
};

use super::CharacterSequence;
use super::Set;
use super::double_exponential::DoubleExponential;
use super::external::OtherProgram;
use super::holdover::{Carried, Holdover};
use super::model::{Contestant, OnScoredSet, Online, constant_velocity, zero};
use super::network::network;
use super::of_the_loop::{of_the_loop, others};
use super::retrain::Retrained;
use super::scaled::Scaled;
use crate::process::{EXTERNAL, PATIENCE, ProcessError, command_of};

/// The baseline of PS-B.
pub const CONSTANT_VELOCITY: &str = "constant-velocity";
/// The network of PS-LSTM.
pub const LSTM_REFERENCE: &str = "lstm10-reference";
/// Names that begin so are networks in files.
pub const LSTM_FILE: &str = "lstm:";
/// Training passes of the models that learn online.
const PASSES: usize = 3;
/// RMS per component of the displacements of unipen-ced, jumps included; and of its moving steps, as the
/// running scale of the loop sees them.
pub(super) const REFERENCE_RMS: f64 = 10.13;
pub(super) const REFERENCE_MOVING_RMS: f64 = 6.24;
/// Raw units are taken as they are up to this ratio to what a model was made for, either way.
const SAME_SIZE: f64 = 2.0;
/// AdaGrad's first step is 0.1: with displacements of another magnitude it would not learn, or not converge.
const LEARNABLE_RMS: std::ops::RangeInclusive<f64> = 0.05..=500.0;

/// Properties of the set known before scoring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// RMS per component of all displacements to be scored \[raw units\].
    pub rms: f64,
    /// Step of the device \[ns\].
    pub step_ns: f64,
    /// There is a train part to learn from before scoring.
    pub trained: bool,
}

impl Setting {
    /// The setting of a set.
    #[must_use]
    pub fn of(set: &Set) -> Self {
        let steps = || set.scored.iter().flat_map(|s| &s.v);
        let squares: f64 = steps().flatten().map(|v| v * v).sum();
        let rate_hz = set.scored.first().map_or(f64::NAN, |s| s.rate_hz);
        Self {
            rms: (squares / (2 * steps().count().max(1)) as f64).sqrt(),
            step_ns: 1e9 / rate_hz,
            trained: !set.cold && !set.train.is_empty(),
        }
    }

    /// Displacements are of the size that a model is made for.
    pub(super) fn is_about(&self, rms: f64) -> bool {
        (1.0 / SAME_SIZE..=SAME_SIZE).contains(&(self.rms / rms))
    }
}

/// An unknown model, or one that cannot start.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegistryError {
    /// No model of that name.
    #[error("no model is called {name:?}; legal: {}, \
             {LSTM_FILE}FILE.safetensors, {EXTERNAL}COMMAND{}", names().join(", "), PredictorKind::renamed(name))]
    Unknown { name: String },
    /// A name stands twice.
    #[error("model {name:?} is named twice; name each model once")]
    Twice { name: String },
    /// Settings that the control law refuses.
    #[error("{model}: {error}")]
    Refused { model: String, error: ModelsError },
    /// A network that cannot be loaded.
    #[error(transparent)]
    Network(#[from] models::ModelError),
    /// Another program that cannot go on.
    #[error("{model}{place}: {error}")]
    Process {
        model: String,
        /// The sequence, where one was begun.
        place: String,
        error: ProcessError,
    },
}

#[derive(Debug, Clone, PartialEq)]
enum ModelKind {
    Zero,
    ConstantVelocity,
    Holdover(Carried),
    DoubleExponential,
    Dybm(OnScoredSet),
    DybmEsn,
    ArRls,
    Mixture,
    MixtureCold,
    Shipped,
    File(Arc<LstmModel>),
    /// As the loop has it, from the registry of the control law.
    OfTheLoop(PredictorKind),
    Retrained(Arc<LstmModel>, f64),
    /// Another program, by its command.
    External(String),
}

const TABLE: [(&str, ModelKind); 14] = [
    ("hold", ModelKind::Zero),
    (CONSTANT_VELOCITY, ModelKind::ConstantVelocity),
    ("late-constant-velocity", ModelKind::Holdover(Carried::Constant)),
    ("late-holdover", ModelKind::Holdover(Carried::Ramped)),
    ("double-exponential", ModelKind::DoubleExponential),
    (LSTM_REFERENCE, ModelKind::Shipped),
    ("lstm10", ModelKind::Shipped),
    ("dybm-offline", ModelKind::Dybm(OnScoredSet::Frozen)),
    ("dybm", ModelKind::Dybm(OnScoredSet::Learns)),
    ("dybm-esn", ModelKind::DybmEsn),
    ("ar-rls", ModelKind::ArRls),
    ("lstm32", ModelKind::Shipped),
    ("mixture", ModelKind::Mixture),
    ("mixture-cold", ModelKind::MixtureCold),
];

/// The rows of the table, then one for every other predictor that needs nothing but the pen.
fn rows() -> impl Iterator<Item = (&'static str, ModelKind)> {
    TABLE.into_iter().chain(others().map(|kind| (kind.name(), ModelKind::OfTheLoop(kind))))
}

/// A model by name.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    name: String,
    kind: ModelKind,
}

/// A model ready to be scored, with notes for the reader.
pub type Built = (Box<dyn Contestant>, Option<String>);

/// The names that a table may have, in its order; not every build has every network.
#[must_use]
pub fn order() -> Vec<&'static str> {
    rows().map(|(name, _)| name).collect()
}

/// The names that this build has, in the order of the table.
#[must_use]
pub fn names() -> Vec<&'static str> {
    // Networks that are not part of this build are no models of it.
    let there = |(name, kind): &(&str, ModelKind)| *kind != ModelKind::Shipped || shipped(name).is_some();
    rows().filter(there).map(|(name, _)| name).collect()
}

impl Model {
    /// Every model, in the order of the table.
    #[must_use]
    pub fn all() -> Vec<Self> {
        names().into_iter().filter_map(|name| Self::named(name).ok()).collect()
    }

    /// The model of that name; `lstm:FILE` is loaded, `external:COMMAND` started when it is built.
    ///
    /// # Errors
    /// No such model (the message lists the legal names), or a file that is not a network.
    pub fn named(name: &str) -> Result<Self, RegistryError> {
        let kind = if let Some(file) = name.strip_prefix(LSTM_FILE) {
            Some(ModelKind::File(Arc::new(LstmModel::load(Path::new(file))?)))
        } else if let Some(command) = command_of(name) {
            Some(ModelKind::External(command.to_owned()))
        } else if names().contains(&name) {
            rows().find(|(known, _)| *known == name).map(|(_, kind)| kind)
        } else {
            None
        };
        let name = name.to_owned();
        match kind {
            Some(kind) => Ok(Self { name, kind }),
            None => Err(RegistryError::Unknown { name }),
        }
    }

    /// The models of a comma-separated list, in its order.
    ///
    /// # Errors
    /// As `named`, and a repeated name.
    pub fn list(names: &str) -> Result<Vec<Self>, RegistryError> {
        let mut models: Vec<Self> = Vec::new();
        for name in names.split(',').map(str::trim) {
            let model = Self::named(name)?;
            if models.iter().any(|m| m.name == model.name) {
                return Err(RegistryError::Twice { name: name.to_owned() });
            }
            models.push(model);
        }
        Ok(models)
    }

    /// A network that was trained just now, under `name`.
    #[must_use]
    pub fn retrained(name: &str, trained: &Retrained) -> Self {
        let kind = ModelKind::Retrained(Arc::new(trained.model.clone()), trained.train_s_per_epoch);
        Self { name: name.to_owned(), kind }
    }

    /// What an epoch of its training took, where it was trained just now \[s\].
    #[must_use]
    pub fn train_s_per_epoch(&self) -> Option<f64> {
        match self.kind {
            ModelKind::Retrained(_, seconds) => Some(seconds),
            _ => None,
        }
    }

    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The network that was loaded or trained for it: what another run under the same name may not have.
    #[must_use]
    pub fn own_network(&self) -> Option<&LstmModel> {
        match &self.kind {
            ModelKind::File(model) | ModelKind::Retrained(model, _) => Some(model),
            _ => None,
        }
    }

    /// Passes over the train split before scoring.
    #[must_use]
    pub fn passes(&self) -> usize {
        match self.kind {
            ModelKind::Dybm(_) | ModelKind::DybmEsn => PASSES,
            ModelKind::ArRls | ModelKind::DoubleExponential => 1,
            // It learns within a page of writing.
            ModelKind::Zero
            | ModelKind::ConstantVelocity
            | ModelKind::Holdover(_)
            | ModelKind::Mixture
            | ModelKind::MixtureCold
            | ModelKind::OfTheLoop(_)
            | ModelKind::Shipped
            | ModelKind::File(_)
            | ModelKind::Retrained(..)
            | ModelKind::External(_) => 0,
        }
    }

    /// It needs training: weights from a file, or parameters that stay fixed after it.
    #[must_use]
    pub fn needs_training(&self) -> bool {
        matches!(
            self.kind,
            ModelKind::Dybm(OnScoredSet::Frozen)
                | ModelKind::Shipped
                | ModelKind::File(_)
                | ModelKind::Retrained(..)
        )
    }

    /// Builds it for a set.
    ///
    /// # Errors
    /// Settings or weights that the control law refuses.
    pub fn build(&self, setting: &Setting) -> Result<Built, RegistryError> {
        let refused =
            |error: WeightsError| RegistryError::Refused { model: self.name.clone(), error: error.into() };
        let mut notes: Vec<String> = Vec::new();
        if self.passes() > 0 && !setting.trained {
            notes.push("starts cold: no training passes were made before scoring".to_owned());
        }
        let learnable = LEARNABLE_RMS.contains(&setting.rms);
        let contestant: Box<dyn Contestant> = match &self.kind {
            ModelKind::Zero => Box::new(zero()),
            ModelKind::ConstantVelocity => Box::new(constant_velocity()),
            ModelKind::Holdover(carried) => Box::new(Holdover::new(*carried, setting.step_ns)),
            ModelKind::DoubleExponential => Box::new(DoubleExponential::new(setting.step_ns)),
            ModelKind::Dybm(on_scored) => {
                let model = Online::new(dybm().map_err(refused)?, *on_scored);
                fitted(model, learnable, REFERENCE_MOVING_RMS, &mut notes)
            }
            ModelKind::DybmEsn => {
                let model = Online::new(dybm_esn().map_err(refused)?, OnScoredSet::Learns);
                fitted(model, learnable, REFERENCE_MOVING_RMS, &mut notes)
            }
            ModelKind::ArRls => {
                let model = Online::new(ar_rls().map_err(refused)?, OnScoredSet::Learns);
                fitted(model, setting.is_about(REFERENCE_RMS), REFERENCE_MOVING_RMS, &mut notes)
            }
            ModelKind::Mixture => {
                let network = nearest(setting.step_ns)?;
                notes.push(format!("builds on {}", network.file));
                let model =
                    Online::new(mixture(Some(network.weights)).map_err(refused)?, OnScoredSet::Learns);
                Box::new(Scaled::new(model, TARGET_RMS))
            }
            ModelKind::MixtureCold => {
                let model = Online::new(mixture(None).map_err(refused)?, OnScoredSet::Learns);
                Box::new(Scaled::new(model, TARGET_RMS))
            }
            ModelKind::OfTheLoop(kind) => of_the_loop(*kind, setting.step_ns as u64)
                .map_err(|error| RegistryError::Refused { model: self.name.clone(), error })?,
            ModelKind::Shipped => {
                let mut model = LstmModel::find(&self.name)?;
                // The reference file has no such key.
                model.notes.entry("units".to_owned()).or_insert_with(|| "raw".to_owned());
                network(&model, setting, &mut notes)
            }
            ModelKind::File(model) | ModelKind::Retrained(model, _) => network(model, setting, &mut notes),
            ModelKind::External(command) => Box::new(
                OtherProgram::start(command, setting.step_ns, PATIENCE)
                    .map_err(|error| self.failed(String::new(), error))?,
            ),
        };
        Ok((contestant, (!notes.is_empty()).then(|| notes.join("; "))))
    }

    /// Whether `contestant`, built from this, could predict all of `sequence`.
    ///
    /// # Errors
    /// Another program that cannot go on.
    pub(super) fn check(
        &self,
        contestant: &dyn Contestant,
        sequence: &CharacterSequence,
    ) -> Result<(), RegistryError> {
        let Some(error) = contestant.failure() else { return Ok(()) };
        let CharacterSequence { file, segment, label, .. } = sequence;
        Err(self.failed(format!(", {file}, character {segment} ({label:?})"), error))
    }

    fn failed(&self, place: String, error: ProcessError) -> RegistryError {
        RegistryError::Process { model: self.name.clone(), place, error }
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

/// As it is where the raw units fit, else through the running scale.
pub(super) fn fitted<C: Contestant + 'static>(
    model: C,
    fits: bool,
    rms: f64,
    notes: &mut Vec<String>,
) -> Box<dyn Contestant> {
    if fits {
        return Box::new(model);
    }
    notes.push(format!(
        "does not get the set's raw units: scaled as it goes, to moving steps of RMS {rms:.2}"
    ));
    Box::new(Scaled::new(model, rms))
}

/// The DyBM of the paper's Table 1.
fn paper_dybm() -> DybmSettings {
    let shape = DybmShape::new(2, &[0.5], TraceInput::Newest);
    DybmSettings { shape, optimiser: Optimiser::ada_grad(0.1), l1: 0.0, l2: 0.0 }
}

/// Steps and input scales of weights mean nothing here: the tables are in raw units.
const ANY_STEP_NS: u64 = 0;

fn dybm() -> Result<DybmLearner, WeightsError> {
    let settings = paper_dybm();
    DybmLearner::new(settings, DybmWeights::zero(ANY_STEP_NS, settings.shape))
}

fn dybm_esn() -> Result<DybmEsnLearner, WeightsError> {
    let dybm = paper_dybm();
    let settings = DybmEsnSettings { dybm, readout: Optimiser::ada_grad(0.1), rule: ReadoutRule::OwnError };
    let reservoir = Reservoir::shared(&ReservoirSettings::default())?;
    DybmEsnLearner::untrained(settings, DybmWeights::zero(ANY_STEP_NS, dybm.shape), reservoir)
}

/// Experts and mixture that know nothing yet, with the LSTM that they build on where there is one.
fn mixture(lstm: Option<Arc<LstmWeights>>) -> Result<MixtureLearner, WeightsError> {
    let parameters = MixtureParameters::untrained(ANY_STEP_NS, lstm.is_some());
    MixtureLearner::new(MixtureSettings::default(), lstm, parameters)
}

/// The shipped network of `mixture` whose step is nearest to the device's, by ratio.
fn nearest(step_ns: f64) -> Result<LstmModel, models::ModelError> {
    // Half way between 5 and 10 ms.
    let name = if step_ns < 7_071_000.0 { "mixture-5ms" } else { "mixture-10ms" };
    LstmModel::find(name)
}

/// Gate 40 and Huber bound 6 raw units of unipen-ced.
fn ar_rls() -> Result<ArRlsLearner, WeightsError> {
    ArRlsLearner::new(ArRlsSettings::for_rms(10.0), ArRlsWeights::constant_velocity(ANY_STEP_NS))
}
