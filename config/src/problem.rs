//! What can be wrong with a settings file: one variant per bound that can be broken.
//!
//! Contract: each text names file and line, key, value as written, what is legal and what to do.
//! All problems of a file are reported together.

use std::fmt;

use crate::written::Place;

/// Everything that is wrong with the settings that were asked for; never empty.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub struct ConfigError {
    problems: Vec<Problem>,
}

impl ConfigError {
    pub(crate) fn new(problems: Vec<Problem>) -> Self {
        debug_assert!(!problems.is_empty(), "an error without a problem");
        Self { problems }
    }

    /// The problems in the order of the file.
    #[must_use]
    pub fn problems(&self) -> &[Problem] {
        &self.problems
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.problems.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{problem}")?;
        }
        Ok(())
    }
}

/// One thing that is wrong.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// The file cannot be read at all.
    #[error("{place}: cannot be read ({why}): {remedy}")]
    Unreadable {
        /// The file.
        place: Place,
        /// What the operating system said.
        why: String,
        /// What to do.
        remedy: &'static str,
    },
    /// Not TOML.
    #[error("{place}: not valid TOML: {what}")]
    Syntax {
        /// Where.
        place: Place,
        /// What the parser said.
        what: String,
    },
    /// The preset named at the top of the file, or by the caller, does not exist.
    #[error("{place}: preset = {value:?} is unknown: the presets are {known}")]
    UnknownPreset {
        /// Where.
        place: Place,
        /// As written.
        value: String,
        /// The names that exist.
        known: String,
    },
    /// A key that foretrace does not have.
    #[error("{place}: unknown key `{key}`{hint}")]
    UnknownKey {
        /// Where.
        place: Place,
        /// Full dotted key.
        key: String,
        /// Starts with `:` or `;`: the nearest key, or what the section has.
        hint: String,
    },
    /// A section that foretrace does not have.
    #[error("{place}: unknown section `[{section}]`{hint}")]
    UnknownSection {
        /// Where.
        place: Place,
        /// Full dotted name.
        section: String,
        /// The nearest section.
        hint: String,
    },
    /// A key without a default that neither the file nor a preset gives.
    #[error(
        "{place}: key `{key}` is missing: add {example} under [{section}] ({legal}), or start the file with \
         preset = \"ur5\""
    )]
    Missing {
        /// The file as a whole.
        place: Place,
        /// Full dotted key.
        key: String,
        /// Its section.
        section: String,
        /// An example line.
        example: String,
        /// What is legal.
        legal: String,
    },
    /// The value has the wrong kind: text for a number, a number for a list.
    #[error("{place}: key `{key}` = {value} is {found}: it takes {wanted}")]
    WrongType {
        /// Where.
        place: Place,
        /// Full dotted key, with the element where it is one of a list.
        key: String,
        /// As written.
        value: String,
        /// The kind found.
        found: &'static str,
        /// What the key takes.
        wanted: String,
    },
    /// NaN or infinity.
    #[error("{place}: key `{key}` = {value} is not finite: it takes {legal}")]
    NotFinite {
        /// Where.
        place: Place,
        /// Full dotted key.
        key: String,
        /// As written.
        value: String,
        /// What is legal.
        legal: String,
    },
    /// A number outside its legal range.
    #[error("{place}: key `{key}` = {value} is outside {legal}: {remedy}")]
    OutOfRange {
        /// Where.
        place: Place,
        /// Full dotted key.
        key: String,
        /// As written.
        value: String,
        /// Range with unit.
        legal: String,
        /// What to do; says so when the value looks like another unit.
        remedy: String,
    },
    /// A word or number that is not one of the legal ones.
    #[error("{place}: key `{key}` = {value} is not one of {legal}{hint}")]
    NotOneOf {
        /// Where.
        place: Place,
        /// Full dotted key.
        key: String,
        /// As written.
        value: String,
        /// The legal ones.
        legal: String,
        /// The nearest one, or nothing.
        hint: String,
    },
    /// Legal key by key, but refused by the control law that would be built from them.
    #[error("{place}: the settings do not make a working control law; {why}")]
    Refused {
        /// The file as a whole.
        place: Place,
        /// What the law said, with values and ranges.
        why: String,
    },
    /// A value that is legal alone but contradicts another one.
    #[error("{place}: key `{key}` = {value} {conflict}: {remedy}")]
    Conflict {
        /// Where.
        place: Place,
        /// Full dotted key.
        key: String,
        /// As written.
        value: String,
        /// What it contradicts, with the other value.
        conflict: String,
        /// What to do.
        remedy: String,
    },
}

impl Problem {
    /// Where it stands.
    #[must_use]
    pub const fn place(&self) -> &Place {
        match self {
            Self::Unreadable { place, .. }
            | Self::Syntax { place, .. }
            | Self::UnknownPreset { place, .. }
            | Self::UnknownKey { place, .. }
            | Self::UnknownSection { place, .. }
            | Self::Missing { place, .. }
            | Self::WrongType { place, .. }
            | Self::NotFinite { place, .. }
            | Self::OutOfRange { place, .. }
            | Self::NotOneOf { place, .. }
            | Self::Refused { place, .. }
            | Self::Conflict { place, .. } => place,
        }
    }

    /// The key, where it is about one.
    #[must_use]
    pub fn key(&self) -> Option<&str> {
        match self {
            Self::UnknownKey { key, .. }
            | Self::Missing { key, .. }
            | Self::WrongType { key, .. }
            | Self::NotFinite { key, .. }
            | Self::OutOfRange { key, .. }
            | Self::NotOneOf { key, .. }
            | Self::Conflict { key, .. } => Some(key),
            _ => None,
        }
    }

    /// Line for sorting; what is about the whole file comes last.
    pub(crate) const fn line(&self) -> usize {
        match self.place() {
            Place::File { line: 0, .. } | Place::Default | Place::Override => usize::MAX,
            Place::File { line, .. } | Place::Preset { line, .. } => *line,
        }
    }
}
