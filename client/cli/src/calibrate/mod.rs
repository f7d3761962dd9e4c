//! `foretrace calibrate`: measure what the settings need to know about the arm.

mod lag;
mod kinematics;
mod plane;

use crate::failure::Failure;

/// `foretrace calibrate ...`
#[derive(Debug, clap::Subcommand)]
pub(crate) enum CalibrateCommand {
    Lag(lag::LagMeasureArgs),
    Kinematics(kinematics::KinematicsArgs),
    Plane(plane::PlaneArgs),
}

pub(crate) fn run(command: &CalibrateCommand) -> Result<(), Failure> {
    match command {
        CalibrateCommand::Lag(args) => lag::run(args),
        CalibrateCommand::Kinematics(args) => kinematics::run(args),
        CalibrateCommand::Plane(args) => plane::run(args),
    }
}
