//! The contestants by name.
//!
//! DyBM rows: delay 2, decay 0.5, AdaGrad 0.1, three training passes over the train split in its own order, raw units.

use std::fmt;

use foretrace_control::predict::dybm::{DybmShape, TraceInput};
use foretrace_control::predict::{DybmSettings, Optimiser, WeightsError};

use super::Set;
use super::model::{Contestant, LinearDybm, OnScoredSet, constant_velocity, zero};

/// The baseline of PS-B.
pub const CONSTANT_VELOCITY: &str = "constant-velocity";
/// The network of PS-LSTM.
pub const LSTM_REFERENCE: &str = "lstm10-reference";
/// Training passes of the models that learn online.
const PASSES: usize = 3;

/// What a model may know of the set before it starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// Units and rate are those of unipen-ced (50 units/mm, 200 Hz), for which the raw-unit networks were trained.
    pub reference_units: bool,
    /// There is a train split to learn from before scoring.
    pub trained: bool,
}

impl Setting {
    /// The setting of a set.
    #[must_use]
    pub fn of(set: &Set) -> Self {
        let reference_units =
            set.scored.iter().all(|s| s.units_per_m == Some([50_000.0; 2]) && s.rate_hz == 200.0);
        Self { reference_units, trained: !set.cold && !set.train.is_empty() }
    }
}

/// A model that is not there or cannot start.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// No model of that name.
    #[error("no model is called {name:?}; legal: {}", NAMES.join(", "))]
    Unknown {
        /// As given.
        name: String,
    },
    /// A name stands twice.
    #[error("model {name:?} is named twice; name each model once")]
    Twice {
        /// As given.
        name: String,
    },
    /// Settings that the control law refuses.
    #[error("{model}: {error}")]
    Refused {
        /// Which model.
        model: String,
        /// Its reason.
        error: WeightsError,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Zero,
    ConstantVelocity,
    Dybm(OnScoredSet),
}

const TABLE: [(&str, Kind); 4] = [
    ("zero", Kind::Zero),
    (CONSTANT_VELOCITY, Kind::ConstantVelocity),
    ("dybm-offline", Kind::Dybm(OnScoredSet::Frozen)),
    ("dybm-online", Kind::Dybm(OnScoredSet::Learns)),
];

/// Every name, in the order of the table.
pub const NAMES: [&str; TABLE.len()] = {
    let mut names = [""; TABLE.len()];
    let mut index = 0;
    while index < TABLE.len() {
        names[index] = TABLE[index].0;
        index += 1;
    }
    names
};

/// A model by name.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    name: String,
    kind: Kind,
}

/// A model ready to be scored, and what the reader must know about it.
pub type Built = (Box<dyn Contestant>, Option<String>);

impl Model {
    /// Every model, in the order of the table.
    #[must_use]
    pub fn all() -> Vec<Self> {
        TABLE.iter().map(|(name, kind)| Self { name: (*name).to_owned(), kind: *kind }).collect()
    }

    /// The model of that name.
    ///
    /// # Errors
    /// No such model; the message lists the legal names.
    pub fn named(name: &str) -> Result<Self, ModelError> {
        let known = TABLE.iter().find(|(known, _)| *known == name);
        let (_, kind) = known.ok_or_else(|| ModelError::Unknown { name: name.to_owned() })?;
        Ok(Self { name: name.to_owned(), kind: *kind })
    }

    /// The models of a comma-separated list, in its order.
    ///
    /// # Errors
    /// An unknown or repeated name.
    pub fn list(names: &str) -> Result<Vec<Self>, ModelError> {
        let mut models: Vec<Self> = Vec::new();
        for name in names.split(',').map(str::trim) {
            let model = Self::named(name)?;
            if models.iter().any(|m| m.name == model.name) {
                return Err(ModelError::Twice { name: name.to_owned() });
            }
            models.push(model);
        }
        Ok(models)
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Passes over the train split before scoring.
    #[must_use]
    pub fn passes(&self) -> usize {
        match self.kind {
            Kind::Zero | Kind::ConstantVelocity => 0,
            Kind::Dybm(_) => PASSES,
        }
    }

    /// It is of no use without training: weights from a file, or parameters that stay as training left them.
    #[must_use]
    pub fn needs_training(&self) -> bool {
        match self.kind {
            Kind::Zero | Kind::ConstantVelocity | Kind::Dybm(OnScoredSet::Learns) => false,
            Kind::Dybm(OnScoredSet::Frozen) => true,
        }
    }

    /// Builds it for a set.
    ///
    /// # Errors
    /// Settings or weights that the control law refuses.
    pub fn build(&self, setting: &Setting) -> Result<Built, ModelError> {
        let refused = |error| ModelError::Refused { model: self.name.clone(), error };
        let contestant: Box<dyn Contestant> = match self.kind {
            Kind::Zero => Box::new(zero()),
            Kind::ConstantVelocity => Box::new(constant_velocity()),
            Kind::Dybm(on_scored) => Box::new(LinearDybm::new(paper_dybm(), on_scored).map_err(refused)?),
        };
        Ok((contestant, self.note(setting)))
    }

    fn note(&self, setting: &Setting) -> Option<String> {
        (self.passes() > 0 && !setting.trained)
            .then(|| "starts cold: no training passes were made before scoring".to_owned())
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

/// The DyBM of the paper's Table 1.
fn paper_dybm() -> DybmSettings {
    let shape = DybmShape::new(2, &[0.5], TraceInput::Newest);
    DybmSettings { shape, optimiser: Optimiser::ada_grad(0.1), l1: 0.0, l2: 0.0 }
}
