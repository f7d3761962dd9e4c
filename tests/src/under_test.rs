//! The program `foretrace`, under a name of its own.

use std::process::ExitCode;

fn main() -> ExitCode {
    foretrace::main()
}
