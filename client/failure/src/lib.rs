//! Why something ended without a result: the cause, what was wrong, what to do.
//!
//! Contract: one line, `what was wrong; what to do`. The program turns the cause into its exit code.

#![forbid(unsafe_code)]

use std::fmt::{self, Display};

/// Why there is no result; the number is the program's exit code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    Failed = 1,
    Usage = 2,
    NoDaemon = 3,
    Refused = 4,
    BadInput = 5,
    Unfit = 6,
    Alarm = 7,
    Interrupted = 130,
}

/// A failure with its remedy, which may be empty.
#[derive(Debug)]
pub struct Failure {
    pub cause: Cause,
    pub what: String,
    pub remedy: String,
}

impl Failure {
    pub fn new(cause: Cause, what: impl Display, remedy: impl Display) -> Self {
        Self { cause, what: what.to_string(), remedy: remedy.to_string() }
    }

    pub fn failed(what: impl Display, remedy: impl Display) -> Self {
        Self::new(Cause::Failed, what, remedy)
    }

    pub fn bad_input(what: impl Display, remedy: impl Display) -> Self {
        Self::new(Cause::BadInput, what, remedy)
    }

    /// The command line is wrong, whatever the inputs are.
    pub fn usage(what: impl Display, remedy: impl Display) -> Self {
        Self::new(Cause::Usage, what, remedy)
    }

    /// Somebody asked to end.
    pub fn interrupted(what: impl Display, remedy: impl Display) -> Self {
        Self::new(Cause::Interrupted, what, remedy)
    }
}

impl Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Messages of other crates often carry their own remedy after a semicolon: then ours would be a
        // second one.
        if self.remedy.is_empty() {
            return f.write_str(self.what.trim_end());
        }
        write!(f, "{}; {}", self.what.trim_end().trim_end_matches(['.', ';']), self.remedy)
    }
}

impl std::error::Error for Failure {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_names_the_fault_then_the_remedy() {
        let failure = Failure::bad_input("no such file: a.dat.", "give a UNIPEN file");
        assert_eq!(failure.to_string(), "no such file: a.dat; give a UNIPEN file");
    }
}
