//! Failures of the program: the message and the exit code.
//!
//! Contract: one line on stderr, `foretrace: what was wrong; what to do`, and one of the exit codes below.

use std::fmt::{self, Display};
use std::process::ExitCode;

/// Exit codes, shown at the end of `foretrace --help`.
pub(crate) const EXIT_CODES: &str = "\
Exit codes:
  0    done
  1    something failed while it ran
  2    the command line is wrong: an option, a name or a number that no input could make right
  3    no daemon runs under this instance
  4    the daemon refused the request
  5    an input is wrong: settings (also by --set), recording, text, data set, file, reach of the arm
  6    doctor: this machine is unfit for the rate
  7    status: an alarm's bound was broken
  130  interrupted by Ctrl-C before the result was complete";

/// Why the program ends without a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    Failed = 1,
    Usage = 2,
    NoDaemon = 3,
    Refused = 4,
    BadInput = 5,
    Unfit = 6,
    Alarm = 7,
    Interrupted = 130,
}

/// A failure with its remedy.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) cause: Cause,
    what: String,
    remedy: String,
}

impl Failure {
    pub(crate) fn new(cause: Cause, what: impl Display, remedy: impl Display) -> Self {
        Self { cause, what: what.to_string(), remedy: remedy.to_string() }
    }

    pub(crate) fn failed(what: impl Display, remedy: impl Display) -> Self {
        Self::new(Cause::Failed, what, remedy)
    }

    pub(crate) fn bad_input(what: impl Display, remedy: impl Display) -> Self {
        Self::new(Cause::BadInput, what, remedy)
    }

    /// The command line is wrong, whatever the inputs are.
    pub(crate) fn usage(what: impl Display, remedy: impl Display) -> Self {
        Self::new(Cause::Usage, what, remedy)
    }

    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(self.cause as u8)
    }
}

impl Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Messages of other crates often carry their own remedy after a semicolon: then ours would be a
        // second one.
        if self.remedy.is_empty() {
            write!(f, "foretrace: {}", self.what.trim_end())
        } else {
            write!(f, "foretrace: {}; {}", self.what.trim_end().trim_end_matches(['.', ';']), self.remedy)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_names_the_fault_then_the_remedy() {
        let failure = Failure::bad_input("no such file: a.dat.", "give a UNIPEN file");
        assert_eq!(failure.to_string(), "foretrace: no such file: a.dat; give a UNIPEN file");
    }
}
