//! A built-in writer: text to human-like ink by the kinematic theory of rapid movements (sigma-lognormal
//! model).
//!
//! A glyph is a list of virtual targets; the hand aims at them with strokes of lognormal speed that overlap
//! in time, so corners round off and speed dips where the path bends. Hover between components is a stroke
//! like any other, with contact = false. One seed is one person on one day: the same text and seed give the
//! same ink. Lengths in em (capital height 1); [`crate::path`] makes metres of them. Absent: joined-up
//! writing, kerning. Source: Plamondon, "A kinematic theory of rapid human movements", Biol. Cybern. 72
//! (1995), 295-307.

mod glyphs;
mod hand;
mod lognormal;

pub use hand::Style;

use crate::data::{Character, Quantity, Recording};
use crate::path::{Anchor, Ink, PathError, PenPath, Placement};
use hand::GlyphWriter;
use std::path::PathBuf;

/// Median height of the built-in glyphs \[em\]: most are capitals or figures. Fixes the scale of every text
/// alike.
pub const MEDIAN_HEIGHT_EM: f64 = 1.0;

/// Text that the built-in writer cannot turn into ink.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WriterError {
    /// A character without a glyph.
    #[error("no built-in glyph for {glyph:?} (character {index} of the text); legal: {legal} and blanks")]
    UnknownGlyph {
        glyph: char,
        /// Its index in the text, from 0.
        index: usize,
        /// All glyphs there are.
        legal: String,
    },
    /// Nothing to write.
    #[error("the text is empty or blank; write at least one of {legal}")]
    Blank {
        /// All glyphs there are.
        legal: String,
    },
    /// A rate outside its range.
    #[error("rate {rate_hz} Hz is outside [20, 10000] Hz")]
    Rate { rate_hz: f64 },
    /// Some of the ink does not fit the workspace.
    #[error("{} of the text's characters do not fit; make the workspace larger or the glyphs smaller; first: \
             {}", skipped.len(), skipped.first().map_or("", String::as_str))]
    DoesNotFit {
        /// Each with its reason.
        skipped: Vec<String>,
    },
    /// No path could be made.
    #[error(transparent)]
    Path(#[from] PathError),
}

/// Every glyph that can be written.
#[must_use]
pub fn glyphs() -> String {
    glyphs::all().collect()
}

/// Writes `text` with the hand of `seed`: one character per glyph, points in em on the base line y = 0,
/// sampled at `rate_hz`.
///
/// Blanks become characters without components.
///
/// # Errors
/// [`WriterError`]: a character without a glyph, nothing but blanks, a rate outside \[20, 10000\] Hz.
pub fn write_text(text: &str, seed: u64, rate_hz: f64) -> Result<Recording, WriterError> {
    write_with(text, &Style::from_seed(seed), rate_hz)
}

/// Writes `text` as [`write_text`] does, with a style of one's own.
///
/// # Errors
/// As [`write_text`].
pub fn write_with(text: &str, style: &Style, rate_hz: f64) -> Result<Recording, WriterError> {
    if !(20.0..=10_000.0).contains(&rate_hz) {
        return Err(WriterError::Rate { rate_hz });
    }
    if text.chars().all(char::is_whitespace) {
        return Err(WriterError::Blank { legal: glyphs() });
    }
    let mut hand = GlyphWriter::new(style);
    let mut segments = Vec::new();
    for (index, glyph) in text.chars().enumerate() {
        let components = match glyphs::components(glyph) {
            Some(targets) => hand.write(targets, rate_hz),
            None if glyph.is_whitespace() => Vec::new(),
            None => return Err(WriterError::UnknownGlyph { glyph, index, legal: glyphs() }),
        };
        segments.push(Character {
            label: glyph.to_string(),
            segment_index: index,
            components,
            ..Character::default()
        });
    }
    let source = PathBuf::from(format!("glyphs:{text}"));
    let quantity = Quantity::Position;
    Ok(Recording {
        source,
        rate_hz,
        rate_assumed: false,
        damage: None,
        units_per_m: None,
        quantity,
        segments,
        remarks: Vec::new(),
    })
}

/// Writes `text` straight into the workspace; capitals get the placement's glyph height.
///
/// On a line, letters keep their common base line whatever the placement's anchor.
///
/// # Errors
/// As [`write_text`], and where a glyph does not fit the workspace.
pub fn text_path(text: &str, seed: u64, rate_hz: f64, placement: &Placement) -> Result<PenPath, WriterError> {
    let recording = write_text(text, seed, rate_hz)?;
    let placement = Placement { anchor: Anchor::Baseline, ..*placement };
    let ink = Ink { characters: &recording.segments, rate_hz, median_height: MEDIAN_HEIGHT_EM };
    let (path, skipped) = PenPath::from_ink(ink, &placement)?;
    if skipped.is_empty() { Ok(path) } else { Err(WriterError::DoesNotFit { skipped }) }
}

#[cfg(test)]
mod tests;
