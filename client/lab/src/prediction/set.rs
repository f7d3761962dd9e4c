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
    /// Files of which only a beginning was read, with reasons.
    pub damaged: Vec<String>,
    /// What of the files that are scored or trained on was not taken as it stands, damage included.
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
            set.errors.retain(|error| !scored.errors.contains(error));
            set.damaged.retain(|damage| !scored.damaged.contains(damage));
            train = Some(set);
        }
        let parts = || std::iter::once(&scored).chain(&train);
        Ok(Self {
            name: scored.name.clone(),
            split: split.to_string(),
            scored: sequences(&scored),
            train: train.as_ref().map(sequences).unwrap_or_default(),
            cold,
            refused: parts().flat_map(|set| &set.errors).map(ToString::to_string).collect(),
            damaged: parts().flat_map(|set| &set.damaged).map(ToString::to_string).collect(),
            remarks: DataSet::remarks_of(parts()),
        })
    }

    /// Millimetres per raw unit along x and y, where the whole set agrees on them.
    #[must_use]
    pub fn mm_per_unit(&self) -> Option<[f64; 2]> {
        let first = self.scored.first()?.units_per_m?;
        self.scored.iter().all(|s| s.units_per_m == Some(first)).then(|| first.map(|per_m| 1e3 / per_m))
    }
}
