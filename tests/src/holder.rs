//! A process that attaches and does nothing; or takes a place for operators and keeps it, which no program of
//! ours does.
//!
//! Contract: `hold-node` and `hold-place`, with `--instance=N --root=DIR`, print one line once they have it,
//! then sleep for an hour.

use std::io::Write as _;
use std::process::ExitCode;
use std::time::Duration;

use foretrace_shm::{Services, Session};

use crate::instance_of;

/// The role, with the arguments after its name.
#[must_use]
pub fn main(arguments: &[String], place: bool) -> ExitCode {
    match run(arguments, place) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[String], place: bool) -> Result<(), Box<dyn std::error::Error>> {
    let session = Session::open(&instance_of(arguments)?, "holder")?;
    let services = Services::open(&session)?;
    let _place = place.then(|| services.control.client()).transpose()?;
    println!("held");
    std::io::stdout().flush()?;
    std::thread::sleep(Duration::from_secs(3600));
    Ok(())
}
