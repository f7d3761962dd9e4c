//! `foretrace arm`: arms to plug into the loop.

pub(crate) mod options;
mod sim;
mod ur;

use crate::failure::Failure;

/// `foretrace arm ...`
#[derive(Debug, clap::Subcommand)]
pub(crate) enum ArmCommand {
    Sim(Box<sim::SimArgs>),
    Ur(Box<ur::UrArgs>),
}

pub(crate) fn run(command: &ArmCommand) -> Result<(), Failure> {
    match command {
        ArmCommand::Sim(args) => sim::run(args),
        ArmCommand::Ur(args) => ur::run(args),
    }
}
