//! A program that has been read and understood, but not run.

use super::code::Code;
use super::error::{ScriptError, ScriptPosition};
use super::limits;
use super::tree::{Do, Give, ScriptStatement, Sort};
use super::{compiler, parser};
use std::sync::Arc;

/// A program. Copies share it.
#[derive(Debug, Clone)]
pub struct Program {
    pub(super) code: Arc<Code>,
}

impl Program {
    /// Reads a text as a controller does: one `def` or `sec` is the program; anything else, for instance the
    /// bare line `stopj(2)`, is the body of one.
    ///
    /// # Errors
    /// The first thing that is not URScript, a variable that nothing assigns to, a call that does not fit the
    /// function called, or a bound of `limits`; with its position.
    pub fn parse(text: &str) -> Result<Self, ScriptError> {
        let code = compiler::program(parser::statements(text)?)?;
        Ok(Self { code: Arc::new(code) })
    }

    /// Its name; empty for bare lines.
    #[must_use]
    pub fn name(&self) -> &str {
        self.code.bodies.first().map_or("", |body| &body.name)
    }

    /// Whether it is a `sec`: it runs beside the program that is running, and must be done within one cycle.
    #[must_use]
    pub fn is_secondary(&self) -> bool {
        self.code.bodies.first().is_some_and(|body| body.sort == Sort::Sec)
    }

    /// The functions that it wants of a machine, each with the position of its first call.
    pub fn wanted(&self) -> impl Iterator<Item = (&str, ScriptPosition)> {
        self.code.foreign.iter().map(|(name, position)| (name.as_str(), *position))
    }
}

/// A line of statements for a program in interpreter mode.
#[derive(Debug)]
pub struct Statements {
    items: Vec<ScriptStatement>,
    clears: bool,
}

impl Statements {
    /// Reads one line of statements.
    ///
    /// # Errors
    /// The first thing that is not URScript, or the line is too long.
    pub fn parse(text: &str) -> Result<Self, ScriptError> {
        if text.len() > limits::STATEMENT_BYTES {
            let start = ScriptPosition { line: 1, column: 1 };
            return Err(ScriptError::more_than(start, limits::STATEMENT_BYTES, "bytes in a line"));
        }
        let items = parser::statements(text)?;
        let clear = |statement: &ScriptStatement| {
            let Do::Evaluate(expression) = &statement.what else { return false };
            matches!(&expression.what, Give::Call(asked) if asked.name == "clear_interpreter")
        };
        Ok(Self { clears: items.iter().any(clear), items })
    }

    pub(super) fn items(&self) -> &[ScriptStatement] {
        &self.items
    }

    /// It has a `clear_interpreter`, after which nothing that was taken is left.
    pub(super) const fn clears(&self) -> bool {
        self.clears
    }
}
