//! Models that are part of the program, each with its card: data, licence and citation, split, seed, scores.

use super::lstm::{Assumed, LstmModel};
use super::problem::ModelError;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shipped {
    /// Its name in settings.
    pub name: &'static str,
    pub bytes: &'static [u8],
    /// The model card, Markdown.
    pub card: &'static str,
}

macro_rules! shipped {
    ($($name:literal),* $(,)?) => {
        [$(Shipped {
            name: $name,
            bytes: include_bytes!(concat!("../../models/", $name, ".safetensors")),
            card: include_str!(concat!("../../models/", $name, ".md")),
        }),*]
    };
}

const MODELS: &[Shipped] = &shipped![
    "lstm10-reference",
    "lstm10",
    "lstm32",
    "lstm10-10ms",
    "mixture-5ms",
    "mixture-8ms",
    "mixture-10ms",
    "foresight-5ms",
    "foresight-8ms",
    "foresight-10ms"
];

impl Shipped {
    /// The model as an LSTM.
    ///
    /// # Errors
    ///
    /// It is another kind of model.
    pub fn lstm(&self) -> Result<LstmModel, ModelError> {
        LstmModel::parse(self.name, self.bytes, Assumed::default())
    }

    #[must_use]
    pub const fn all() -> &'static [Self] {
        MODELS
    }
}

/// The model of that name.
#[must_use]
pub fn shipped(name: &str) -> Option<&'static Shipped> {
    MODELS.iter().find(|model| model.name == name)
}

/// The names of all shipped models, for a message.
#[must_use]
pub fn shipped_names() -> String {
    MODELS.iter().map(|model| model.name).collect::<Vec<_>>().join(", ")
}
