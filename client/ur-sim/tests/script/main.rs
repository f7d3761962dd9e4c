//! The interpreter of URScript from outside: what scripts do, on a machine that is itself a script.

#[path = "../../../ur/src/tests/fuzz.rs"]
mod fuzz;
mod machine;
mod language;
mod builtins;
mod threads;
mod errors;
mod bounds;
mod hostile;
mod grammar;
mod others;
mod uploads;
