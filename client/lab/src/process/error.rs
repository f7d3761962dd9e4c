//! What was wrong with a predictor in another program, and where.

use super::{LONGEST_LINE, PROTOCOL};

/// A program that cannot go on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{place}: {fault}")]
pub struct ProcessError {
    /// `at its start`, `in answer to the greeting`, `at step 17`.
    pub place: String,
    pub fault: Box<ProcessFault>,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ProcessFault {
    /// No shell, or no room for it.
    #[error("it cannot be started: {0}; the command is one for /bin/sh")]
    Start(String),
    /// It was silent for too long.
    #[error(
        "no answer within {seconds} s; every line needs an answer of one line, flushed: find out where it \
         hangs, or make it faster"
    )]
    Silent {
        /// How long it may be silent \[s\].
        seconds: f64,
    },
    /// It ended before its time.
    #[error("it {0}; its own output says why, and it has to answer until its input ends")]
    Ended(String),
    /// The system refused to read or write.
    #[error("reading or writing failed: {0}; start again")]
    Io(String),
    /// No end of the line.
    #[error("an answer of more than {LONGEST_LINE} bytes; one line, as short as {{\"positions\": …}} allows")]
    TooLong,
    /// Bytes that nobody asked for.
    #[error(
        "it wrote more than one line for a line; print to standard error what is no answer, and answer each \
         line once"
    )]
    Unasked,
    /// Not what the protocol has.
    #[error(
        "{line:?} is no answer of {PROTOCOL}: {why}; legal: {{\"positions\": [[x, y], …], \"radii\": [r, …]}}, \
         radii only where you have them, and {{}} for no preview, numbers finite"
    )]
    Form {
        /// As much of it as a message can hold.
        line: String,
        why: String,
    },
    /// Another count of positions.
    #[error("{count} positions, wanted are {wanted}; give as many, or {{}} for no preview")]
    Positions { count: usize, wanted: usize },
    /// Radii for some only.
    #[error("{radii} radii for {positions} positions; give one for each, or none")]
    Radii { radii: usize, positions: usize },
    /// A number that is not finite or out of its range.
    #[error("{what} {index} is {value}; positions are finite, radii finite and not negative")]
    Number { what: &'static str, index: usize, value: f64 },
}

impl ProcessFault {
    pub(super) fn at(self, place: impl Into<String>) -> ProcessError {
        ProcessError { place: place.into(), fault: Box::new(self) }
    }
}
