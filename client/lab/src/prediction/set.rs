//! `Set`: what a table is made of: the scored sequences of a data set and those to train on.

use std::path::Path;

use foretrace_sim::data::{CsvUnits, DataSet, SetError, Split};

use super::{CharacterSequence, sequences};

/// Scored and train sequences of one data set.
#[derive(Debug, Clone)]
pub struct Set {
    /// Name of the folder.
    pub name: String,
    /// Which part is scored, as chosen.
    pub split: String,
    pub scored: Vec<CharacterSequence>,
    /// Sequences for training passes; empty where the set has none or the scored ones are among them.
    pub train: Vec<CharacterSequence>,
    /// Models that learn online start without training passes.
    pub cold: bool,
    /// Files that were left out, with reasons.
    pub refused: Vec<String>,
    /// What of the others was not taken as it stands.
    pub remarks: Vec<String>,
}

impl Set {
    /// Loads the part `split` of the set in `folder` to score, and its part `train` to learn from.
    ///
    /// Nothing is learned from beforehand where the scored part is `train` itself or `all`: it would be
    /// learned from what is scored.
    ///
    /// # Errors
    /// [`SetError`]: a folder, table or part that cannot be read.
    pub fn load(folder: &Path, split: &Split, cold: bool) -> Result<Self, SetError> {
        Self::load_in(folder, split, cold, CsvUnits::default())
    }

    /// As [`Set::load`], with units for columns whose names have none.
    ///
    /// # Errors
    /// As [`Set::load`].
    pub fn load_in(folder: &Path, split: &Split, cold: bool, units: CsvUnits) -> Result<Self, SetError> {
        let scored = DataSet::load_in(folder, split, false, units)?;
        let held_out = *split != Split::All && *split != Split::train();
        let has_train = DataSet::splits(folder)?.iter().any(|word| word == "train");
        let mut train = None;
        if held_out && has_train && !cold {
            let mut set = DataSet::load_in(folder, &Split::train(), false, units)?;
            // A table may put a file into several parts.
            set.files.retain(|file| scored.files.iter().all(|other| other.file != file.file));
            train = Some(set);
        }
        let errors = scored.errors.iter().chain(train.iter().flat_map(|t| &t.errors));
        Ok(Self {
            name: scored.name.clone(),
            split: split.to_string(),
            scored: sequences(&scored),
            train: train.as_ref().map(sequences).unwrap_or_default(),
            cold,
            refused: errors.map(ToString::to_string).collect(),
            remarks: scored.remarks(),
        })
    }

    /// Millimetres per raw unit along x and y, where the whole set agrees on them.
    #[must_use]
    pub fn mm_per_unit(&self) -> Option<[f64; 2]> {
        let first = self.scored.first()?.units_per_m?;
        self.scored.iter().all(|s| s.units_per_m == Some(first)).then(|| first.map(|per_m| 1e3 / per_m))
    }
}
