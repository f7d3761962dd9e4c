//! `foretrace calibrate`: measure what the settings need to know about the arm.

mod lag;
mod motion;
mod agreement;
mod listen;
mod picture;
mod report;

use crate::failure::Failure;

/// `foretrace calibrate ...`
#[derive(Debug, clap::Subcommand)]
pub(crate) enum CalibrateCommand {
    Lag(lag::LagArgs),
}

pub(crate) fn run(command: &CalibrateCommand) -> Result<(), Failure> {
    match command {
        CalibrateCommand::Lag(args) => lag::run(args),
    }
}
