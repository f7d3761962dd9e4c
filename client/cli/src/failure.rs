//! Failures of the program: one line on stderr, `foretrace: what was wrong; what to do`, and an exit code.

pub(crate) use foretrace_failure::{Cause, Failure};

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
