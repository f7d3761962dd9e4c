//! The program `foretrace`, under a name of its own; with `observe` or `trespass` as its first word, the tests' observer and
//! trespasser.

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.split_first() {
        Some((first, rest)) if first == "observe" => foretrace_tests::observer::main(rest),
        Some((first, rest)) if first == "trespass" => foretrace_tests::trespass::main(rest),
        _ => foretrace::main(),
    }
}
