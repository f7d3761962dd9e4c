//! What every arm writes: the hands of a data set, or texts in the hand of the built-in writer.

use std::fmt::Display;
use std::path::Path;

use foretrace_config::Config;
use foretrace_failure::Failure;
use foretrace_sim::data::{CsvUnits, DataSet, Split, median_glyph_height};
use foretrace_sim::path::Lift;

use super::{BenchArm, Hand, hand_of_text, hands};

/// The hands to write, on the paper of each arm.
pub type HandsOfArms = Vec<(BenchArm, Vec<Hand>)>;

/// What is chosen of a data set.
#[derive(Debug, Clone)]
pub struct HandOptions {
    /// Usually the part `test`, or all where there is none.
    pub split: Option<Split>,
    /// A bad file is an error, and not left out.
    pub strict: bool,
    pub lift: Lift,
    /// Most sequences of a hand, and most hands.
    pub sequences: Option<usize>,
    pub hands: Option<usize>,
    /// Units for columns whose names have none.
    pub units: CsvUnits,
}

/// The texts, each in a hand of its own, on the paper of each arm.
///
/// # Errors
///
/// The writer does not know a sign.
pub fn hands_of_texts(
    texts: &[String],
    arms: Vec<BenchArm>,
    config: &Config,
) -> Result<HandsOfArms, Failure> {
    let of_arm = |arm| {
        let hand = |(style, text): (u64, &String)| {
            hand_of_text(text, style, arm, config).map_err(|error| {
                Failure::bad_input(format_args!("--text {text:?}: {error}"), "give another text")
            })
        };
        Ok((arm, (1..).zip(texts).map(hand).collect::<Result<Vec<_>, Failure>>()?))
    };
    arms.into_iter().map(of_arm).collect()
}

/// The title of the data set in `folder`, and its hands on the paper of each arm: one scale for all, by the
/// median glyph of the part `train`, or of all files without one. `tell` hears what is left out.
///
/// # Errors
///
/// There is no such set or part, or nothing in it to scale by.
pub fn hands_of_set(
    folder: &Path,
    options: &HandOptions,
    arms: Vec<BenchArm>,
    config: &Config,
    tell: &dyn Fn(&str),
) -> Result<(String, HandsOfArms), Failure> {
    let wrong = |error: &dyn Display| {
        Failure::bad_input(error, "give a data-set folder (--data) and a part of it (--split)")
    };
    let parts = DataSet::splits(folder).map_err(|error| wrong(&error))?;
    let has = |wanted: &str| parts.iter().any(|part| part == wanted);
    let split = match &options.split {
        Some(split) => split.clone(),
        None if has("test") => Split::test(),
        None => Split::All,
    };
    let scored =
        DataSet::load_in(folder, &split, options.strict, options.units).map_err(|error| wrong(&error))?;
    for error in &scored.errors {
        tell(&format!("lab: left out: {error}"));
    }
    for remark in scored.remarks() {
        tell(&format!("lab: {remark}"));
    }
    let scale_by = if has("train") { "train".parse().map_err(|error| wrong(&error))? } else { Split::All };
    let scale =
        DataSet::load_in(folder, &scale_by, options.strict, options.units).map_err(|error| wrong(&error))?;
    let median_height = median_glyph_height(scale.characters())
        .ok_or_else(|| wrong(&format_args!("{}: no glyph with a height to scale by", folder.display())))?;
    let title = match &split {
        Split::All => scored.name.clone(),
        part => format!("{} ({part})", scored.name),
    };
    let of_arm = |arm: BenchArm| {
        let (mut hands, left_out) = hands(&scored, median_height, arm, config, options.lift)
            .map_err(|error| Failure::bad_input(error, "give a set whose rate and heights are positive"))?;
        if left_out > 0 {
            let name = arm.name();
            tell(&format!("lab: {left_out} sequences do not fit the paper of {name} and are left out"));
        }
        hands.iter_mut().for_each(|hand| hand.sequences.truncate(options.sequences.unwrap_or(usize::MAX)));
        hands.truncate(options.hands.unwrap_or(usize::MAX));
        Ok((arm, hands))
    };
    Ok((title, arms.into_iter().map(of_arm).collect::<Result<_, Failure>>()?))
}
