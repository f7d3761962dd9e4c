//! What is wrong with a script, and where.

/// A position in a script's text, both counted from 1, as a controller's log does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct ScriptPosition {
    pub line: u32,
    pub column: u32,
}

/// Why a script was refused or stopped.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {}, column {}: {message}", at.line, at.column)]
pub struct ScriptError {
    /// Where it is wrong.
    pub at: ScriptPosition,
    pub message: String,
}

impl ScriptError {
    pub(super) fn new(at: ScriptPosition, message: impl Into<String>) -> Self {
        Self { at, message: message.into() }
    }

    /// A bound of `limits` was exceeded.
    pub(super) fn more_than(at: ScriptPosition, most: usize, what: &str) -> Self {
        Self::new(at, format!("more than {most} {what}"))
    }
}
