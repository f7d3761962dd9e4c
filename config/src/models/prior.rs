//! Where refinement starts: coefficients from a TOML file, [`RefinePrior`] out.
//!
//! Contract: what is loaded is complete, has no unknown key, and every number is finite and bounded, or the
//! error names file, key, what was found and what is legal. No file content panics, and no more than
//! [`MAX_BYTES`] of a file are read. The format is explained at the top of the shipped file,
//! `config/models/refine-prior.toml`; what its numbers are, in the card beside it.

use std::path::Path;

use foretrace_control::estimate::refine::{CURVE_PARTS, Curve, CurvePart, CurveShape, Curves, RefinePrior};
use serde::Deserialize;

use super::problem::ModelError;
use crate::files::Files;

/// Twenty times the shipped file.
const MAX_BYTES: u64 = 32 << 10;
/// Longest part of the parser's message that is repeated: keys in a hostile file may be long.
const LONGEST: usize = 200;

/// The prior that is part of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShippedPrior {
    /// Its name in settings.
    pub name: &'static str,
    pub text: &'static str,
    /// The model card, Markdown.
    pub card: &'static str,
}

pub const SHIPPED_PRIOR: ShippedPrior = ShippedPrior {
    name: "refine-prior",
    text: include_str!("../../models/refine-prior.toml"),
    card: include_str!("../../models/refine-prior.md"),
};

/// The shipped prior, if that is its name, or else the one in the file.
///
/// # Errors
///
/// See [`ModelError`].
pub fn find_prior(name_or_path: &str) -> Result<RefinePrior, ModelError> {
    find_prior_in(name_or_path, &Files::Disk)
}

/// As [`find_prior`], with the file read from `files`.
pub(crate) fn find_prior_in(name_or_path: &str, files: &Files) -> Result<RefinePrior, ModelError> {
    if name_or_path == SHIPPED_PRIOR.name {
        return parse_prior(SHIPPED_PRIOR.name, SHIPPED_PRIOR.text.as_bytes());
    }
    let failed = |error: &std::io::Error| ModelError::File {
        file: name_or_path.to_owned(),
        what: "read",
        why: error.to_string(),
        remedy: format!("name a readable .toml file, or the shipped {}", SHIPPED_PRIOR.name),
    };
    let bytes = files.read(Path::new(name_or_path), MAX_BYTES).map_err(|error| failed(&error))?;
    parse_prior(name_or_path, &bytes)
}

/// Reads a file's bytes; `file` is what messages call it.
///
/// # Errors
///
/// See [`ModelError`].
pub fn parse_prior(file: &str, bytes: &[u8]) -> Result<RefinePrior, ModelError> {
    let wrong = |what: String| ModelError::Prior { file: file.to_owned(), what };
    if bytes.len() as u64 > MAX_BYTES {
        return Err(wrong(format!("it is longer than {MAX_BYTES} bytes")));
    }
    let text = std::str::from_utf8(bytes).map_err(|error| wrong(format!("it is not text ({error})")))?;
    let read: Coefficients = toml::from_str(text).map_err(|error| wrong(parser_message(text, &error)))?;
    let prior = RefinePrior { coarse: read.coarse.into(), clean: read.clean.into() };
    prior.validate().map_err(|why| ModelError::PriorRefused { file: file.to_owned(), why })?;
    Ok(prior)
}

/// The parser's message, with the line.
fn parser_message(text: &str, error: &toml::de::Error) -> String {
    let start = error.span().map_or(0, |span| span.start);
    let line = 1 + text.bytes().take(start).filter(|byte| *byte == b'\n').count();
    let message = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
    format!("line {line}: {}", message.chars().take(LONGEST).collect::<String>())
}

/// The file as written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Coefficients {
    coarse: PriorTerms,
    clean: PriorTerms,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PriorTerms {
    left: Term,
    innovation: Term,
    velocity: Term,
    acceleration: Term,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Term {
    base: f64,
    #[serde(deserialize_with = "few")]
    parts: [Option<CurvePart>; CURVE_PARTS],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Part {
    amplitude: f64,
    shape: Word,
    reach_steps: f64,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Word {
    Fading,
    Growing,
    Falling,
    Rising,
}

/// A list of no more parts than there is room for.
fn few<'de, D: serde::Deserializer<'de>>(source: D) -> Result<[Option<CurvePart>; CURVE_PARTS], D::Error> {
    let given = Vec::<Part>::deserialize(source)?;
    if given.len() > CURVE_PARTS {
        let what = format!("a term has {} parts, there is room for {CURVE_PARTS}", given.len());
        return Err(serde::de::Error::custom(what));
    }
    let mut given = given.into_iter().map(CurvePart::from);
    Ok(std::array::from_fn(|_| given.next()))
}

impl From<Part> for CurvePart {
    fn from(part: Part) -> Self {
        let shape = match part.shape {
            Word::Fading => CurveShape::Fading,
            Word::Growing => CurveShape::Growing,
            Word::Falling => CurveShape::Falling,
            Word::Rising => CurveShape::Rising,
        };
        Self { amplitude: part.amplitude, shape, reach_steps: part.reach_steps }
    }
}

impl From<Term> for Curve {
    fn from(Term { base, parts }: Term) -> Self {
        Self { base, parts }
    }
}

impl From<PriorTerms> for Curves {
    fn from(terms: PriorTerms) -> Self {
        Self {
            left: terms.left.into(),
            innovation: terms.innovation.into(),
            velocity: terms.velocity.into(),
            acceleration: terms.acceleration.into(),
        }
    }
}
