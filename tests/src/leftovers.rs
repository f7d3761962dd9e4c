//! A process that reports what an instance has left behind, as the user that owns it.
//!
//! Contract: `leftovers --instance=N --root=DIR` prints `alive`, `dead`, `damaged`, `held`, `segments`.

use std::process::ExitCode;

use serde_json::json;

use crate::instance_of;

/// The role, with the arguments after `leftovers`.
#[must_use]
pub fn main(arguments: &[String]) -> ExitCode {
    let found = instance_of(arguments).and_then(|instance| Ok(instance.leftovers()?));
    match found {
        Ok(found) => {
            println!(
                "{}",
                json!({
                    "alive": found.alive, "dead": found.dead, "damaged": found.damaged,
                    "held": found.held, "segments": found.memory.segments,
                })
            );
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
