//! A predictor that is another program, in lock-step: a line of JSON there, a line of JSON back.
//!
//! Contract: one program per hand or per set, and one answer before anything goes on, so that results depend
//! neither on the machine's speed nor on its cores. Nothing is trusted: a line that is too long, late, not
//! asked for, no JSON or of another form, a wrong count, a number that is not finite, a program that ends: an
//! error that says what and where. The program gets `/bin/sh -c`, its standard error is ours, and it has
//! ended, with all that it started, when its handle is dropped. Who it is says who asks. Absent: what is done
//! with the answers.

mod child;
mod error;
mod partner;

pub use error::{ProcessError, ProcessFault};
pub use partner::{AnsweredPositions, Greeting, PROTOCOL, Partner, StepQuestion};

use std::time::Duration;

/// Names that begin so are commands for `/bin/sh -c`.
pub const EXTERNAL: &str = "external:";
/// Longest line of an answer \[bytes\].
pub const LONGEST_LINE: usize = 1 << 20;
/// An answer may take so long.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// The command in a name that begins with [`EXTERNAL`]; none if nothing follows.
#[must_use]
pub fn command_of(name: &str) -> Option<&str> {
    name.strip_prefix(EXTERNAL).map(str::trim).filter(|command| !command.is_empty())
}
