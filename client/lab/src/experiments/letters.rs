//! The letters of an experiment: chosen characters of a set, each as a path of its own in the workspace's
//! centre.

use foretrace_sim::data::{Character, DataSet, median_glyph_height};
use foretrace_sim::path::{Ink, PathError, PenPath, Placement};

/// Which characters take part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Labels {
    /// Those with exactly this label.
    One(String),
    All,
}

/// One character, ready to be written.
#[derive(Debug, Clone)]
pub struct Letter {
    pub label: String,
    /// Writer; empty where unknown.
    pub writer: String,
    /// Its path, beginning at its first sample.
    pub path: PenPath,
}

/// Letters that could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LetterError {
    /// The label does not occur.
    #[error("no character is labelled {label:?} in this split of {set}; it has {examples}")]
    NoSuchLabel {
        label: String,
        /// Name of the set.
        set: String,
        /// Some labels that do occur.
        examples: String,
    },
    /// The set has no height to scale by.
    #[error("{set}: no glyph with a height, nothing to scale by")]
    NoHeight {
        /// Name of the set.
        set: String,
    },
    /// A character that does not fit.
    #[error(transparent)]
    Path(#[from] PathError),
}

/// The letters with the chosen labels; one constant scale for the whole `set`, its median glyph becoming
/// `placement.glyph_height_m` high. Characters whose ink does not fit the workspace are left out and counted.
///
/// # Errors
///
/// No such label, no glyph with a height, an illegal placement.
pub fn letters(
    set: &DataSet,
    labels: &Labels,
    placement: &Placement,
) -> Result<(Vec<Letter>, usize), LetterError> {
    let chosen = |character: &Character| match labels {
        Labels::All => true,
        Labels::One(label) => character.label == *label,
    };
    let name = || set.name.clone();
    let median_height =
        median_glyph_height(set.characters()).ok_or_else(|| LetterError::NoHeight { set: name() })?;
    let (mut letters, mut skipped) = (Vec::new(), 0);
    for file in &set.files {
        let rate_hz = file.recording.rate_hz;
        for character in file.recording.segments.iter().filter(|character| chosen(character)) {
            let characters = std::slice::from_ref(character);
            match PenPath::from_ink(Ink { characters, rate_hz, median_height }, placement) {
                Ok((path, left_out)) if left_out.is_empty() && path.samples.len() > 1 => {
                    letters.push(Letter {
                        label: character.label.clone(),
                        writer: character.writer.clone(),
                        path,
                    });
                }
                Ok(_) | Err(PathError::Nothing { .. }) => skipped += 1,
                Err(error) => return Err(error.into()),
            }
        }
    }
    if letters.is_empty()
        && let Labels::One(label) = labels
    {
        let mut known: Vec<_> = set.characters().map(|character| character.label.as_str()).collect();
        known.sort_unstable();
        known.dedup();
        let examples = known.join(" ");
        return Err(LetterError::NoSuchLabel { label: label.clone(), set: name(), examples });
    }
    Ok((letters, skipped))
}
