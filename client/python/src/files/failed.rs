//! Errors of the libraries as exceptions: another version, a value to change, or any other problem.

use foretrace_record::RecordError;
use foretrace_record::replay::ReplayError;
use foretrace_record::what_if::WhatIfError;
use foretrace_sim::data::SetError;
use pyo3::prelude::*;

use crate::problem::{OtherVersion, invalid, problem};

pub fn of_record(error: RecordError) -> PyErr {
    match error {
        RecordError::OtherLayout { .. } => OtherVersion::new_err(error.to_string()),
        other => problem(other),
    }
}

pub fn of_replay(error: ReplayError) -> PyErr {
    match error {
        ReplayError::File(error) => of_record(error),
        ReplayError::State(_) => OtherVersion::new_err(error.to_string()),
        other => problem(other),
    }
}

pub fn of_what_if(error: WhatIfError) -> PyErr {
    match error {
        WhatIfError::File(error) => of_record(error),
        WhatIfError::Settings { .. } | WhatIfError::Change { .. } => invalid(error),
        other => problem(other),
    }
}

pub fn of_set(error: SetError) -> PyErr {
    match error {
        SetError::NoSuchSplit { .. } => invalid(error),
        other => problem(other),
    }
}
