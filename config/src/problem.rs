//! What can be wrong with a settings file: one variant per bound that can be broken.
//!
//! Contract: each text names file and line, key, value as written, what is legal and what to do.
//! All problems of a file are reported together.

use std::fmt;

use crate::written::SettingOrigin;

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
#[error("{origin}: {kind}")]
pub struct Problem {
    /// Of the value, or the file as a whole.
    pub origin: SettingOrigin,
    pub kind: ProblemKind,
}

/// What is wrong.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ProblemKind {
    /// The file cannot be read at all.
    #[error("cannot be read ({why}): {remedy}")]
    Unreadable {
        /// The operating system's reason.
        why: String,
        remedy: &'static str,
    },
    /// Not TOML, with the parser's message.
    #[error("not valid TOML: {0}")]
    Syntax(String),
    /// The preset named at the top of the file, or by the caller, does not exist.
    #[error("preset = {value:?} is unknown: the presets are {known}")]
    UnknownPreset { value: String, known: String },
    /// A key that foretrace does not have.
    #[error("unknown key `{key}`{hint}")]
    UnknownKey {
        key: String,
        /// Starts with `:` or `;`: the nearest key, or what the section has.
        hint: String,
    },
    /// A section that foretrace does not have.
    #[error("unknown section `[{section}]`{hint}")]
    UnknownSection { section: String, hint: String },
    /// A key without a default that neither the file nor a preset gives.
    #[error(
        "key `{key}` is missing: add {example} under [{section}] ({legal}), or start the file with preset = \
         \"ur5\""
    )]
    Missing { key: String, section: String, example: String, legal: String },
    /// Legal key by key, but refused by the control law that would be built from them, with its reason.
    #[error("the settings do not make a working control law; {0}")]
    Refused(String),
    /// A value that cannot stay.
    #[error("key `{key}` = {value} {flaw}")]
    Value {
        /// Full dotted key, with the element where it is one of a list.
        key: String,
        /// As written.
        value: String,
        flaw: ValueFlaw,
    },
}

/// What is wrong with a value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ValueFlaw {
    /// The wrong kind: text for a number, a number for a list.
    #[error("is {found}: it takes {wanted}")]
    WrongType { found: &'static str, wanted: String },
    /// NaN or infinity.
    #[error("is not finite: it takes {legal}")]
    NotFinite { legal: String },
    /// A number outside its legal range. The remedy says so when the value looks like another unit.
    #[error("is outside {legal}: {remedy}")]
    OutOfRange { legal: String, remedy: String },
    /// A word or number that is not one of the legal ones; the hint names the nearest one, or is empty.
    #[error("is not one of {legal}{hint}")]
    NotOneOf { legal: String, hint: String },
    /// Legal alone, but it contradicts another value.
    #[error("{conflict}: {remedy}")]
    Conflict { conflict: String, remedy: String },
}

impl Problem {
    pub(crate) fn new(origin: &SettingOrigin, kind: ProblemKind) -> Self {
        Self { origin: origin.clone(), kind }
    }

    /// The key, where it is about one.
    #[must_use]
    pub fn key(&self) -> Option<&str> {
        match &self.kind {
            ProblemKind::UnknownKey { key, .. }
            | ProblemKind::Missing { key, .. }
            | ProblemKind::Value { key, .. } => Some(key),
            _ => None,
        }
    }

    /// Line for sorting; what is about the whole file comes last.
    pub(crate) const fn line(&self) -> usize {
        match self.origin {
            SettingOrigin::File { line: 0, .. } | SettingOrigin::Default | SettingOrigin::Override => {
                usize::MAX
            }
            SettingOrigin::File { line, .. } | SettingOrigin::Preset { line, .. } => line,
        }
    }
}
