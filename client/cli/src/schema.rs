//! `foretrace schema`: the messages of shared memory, for other languages.

use std::path::PathBuf;

use crate::failure::Failure;
use crate::output::{say, write_file};

/// Print the messages of shared memory for another language
#[derive(Debug, clap::Subcommand)]
pub(crate) enum SchemaCommand {
    /// As a header for C11 and C++17, which asserts sizes and offsets
    C {
        /// Write to FILE instead of stdout
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// As a module for Python 3.10 and later: records, enumerations, flags; numpy is not needed
    Python {
        /// Write to FILE instead of stdout
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
}

pub(crate) fn run(command: &SchemaCommand) -> Result<(), Failure> {
    let (text, out) = match command {
        SchemaCommand::C { out } => (foretrace_shm::c_header(), out),
        SchemaCommand::Python { out } => (foretrace_shm::python_module(), out),
    };
    match out {
        Some(file) => write_file(file, &text, "--out"),
        None => {
            say!("{}", text.trim_end());
            Ok(())
        }
    }
}
