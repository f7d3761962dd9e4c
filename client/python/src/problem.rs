//! Exceptions. All derive from `foretrace.Problem`, whose text says what was wrong and what to do.

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    foretrace,
    Problem,
    PyException,
    "Whatever foretrace could not do; the text says what to do."
);
create_exception!(
    foretrace,
    Refused,
    Problem,
    "The daemon or the gateway refused; the text is its reason and remedy. After a request, `status` is a \
     `messages.ControlStatus`, `detail` and `value` are numbers that belong to it."
);
create_exception!(
    foretrace,
    NoDaemon,
    Problem,
    "No daemon of this instance runs, or the one that did is gone."
);
create_exception!(
    foretrace,
    OtherVersion,
    Problem,
    "Daemon or file and this package have different message layouts."
);
create_exception!(foretrace, Taken, Problem, "The place has another holder, whom the text names.");
create_exception!(foretrace, Invalid, Problem, "A value outside its bounds: which, the bound, the unit.");
create_exception!(
    foretrace,
    NoAnswer,
    Problem,
    "Nothing was heard in time. After a stop: use the arm's own stop button."
);

/// Any error of the libraries below, in its own words.
pub fn problem(error: impl std::fmt::Display) -> PyErr {
    Problem::new_err(error.to_string())
}

/// A value that the caller must change.
pub fn invalid(error: impl std::fmt::Display) -> PyErr {
    Invalid::new_err(error.to_string())
}

pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let python = module.py();
    module.add("Problem", python.get_type::<Problem>())?;
    module.add("Refused", python.get_type::<Refused>())?;
    module.add("NoDaemon", python.get_type::<NoDaemon>())?;
    module.add("OtherVersion", python.get_type::<OtherVersion>())?;
    module.add("Taken", python.get_type::<Taken>())?;
    module.add("Invalid", python.get_type::<Invalid>())?;
    module.add("NoAnswer", python.get_type::<NoAnswer>())
}
