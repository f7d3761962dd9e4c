//! The program `foretrace`, under a name of its own; with one of the tests' own roles as its first word, that
//! role.

use std::process::ExitCode;

use foretrace_tests::{forger, holder, leftovers, observer, recorder, trespass};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((first, rest)) = arguments.split_first() else { return foretrace::main() };
    match first.as_str() {
        "observe" => observer::main(rest),
        "trespass" => trespass::main(rest),
        "recorder" => recorder::main(rest),
        "forge" => forger::main(rest),
        "hold-place" => holder::main(rest, true),
        "hold-node" => holder::main(rest, false),
        "leftovers" => leftovers::main(rest),
        _ => foretrace::main(),
    }
}
