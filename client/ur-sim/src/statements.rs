//! Lines for a program in interpreter mode, as they came and while they wait.

use std::collections::VecDeque;
use std::sync::Arc;

use super::outbox::ConnectionOutbox;
use crate::script::{ScriptError, Statements};

/// A line as it came, and what it means.
#[derive(Debug)]
pub struct InterpreterLine {
    pub(super) text: String,
    pub(super) read: Result<Statements, ScriptError>,
    answer: Arc<ConnectionOutbox>,
}

impl InterpreterLine {
    /// Reads a line. Takes as long as it is: not to be done under the lock of the controller.
    #[must_use]
    pub fn read(text: &str, answer: Arc<ConnectionOutbox>) -> Self {
        Self { text: text.to_owned(), read: Statements::parse(text), answer }
    }

    pub(super) fn say(&self, kind: &str, what: &str) {
        // A client that does not read its answers loses them.
        let _ = self.answer.reply(format!("{kind}: {what}: {}\n", self.text).into_bytes());
    }

    pub(super) fn discard(&self, why: &str) {
        self.say("discard", &why.replace(['\n', '\r'], " "));
    }
}

/// The lines that wait until a program can take them.
#[derive(Debug, Default)]
pub struct InterpreterDesk {
    pub(super) waiting: VecDeque<InterpreterLine>,
}
