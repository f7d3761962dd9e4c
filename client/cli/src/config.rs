//! `foretrace config`: check a settings file, or show the settings in force.

use std::path::PathBuf;

use foretrace_config::Config;

use crate::failure::Failure;
use crate::output::say;
use crate::settings::{SettingsArgs, wrong};
use crate::shapes::{self, ShapesArgs};
use crate::torque;

/// `foretrace config ...`
#[derive(Debug, clap::Subcommand)]
pub(crate) enum ConfigCommand {
    /// Check a settings file: every problem with line, key, value and legal range
    Check {
        /// Settings file (TOML)
        file: PathBuf,
    },
    Shapes(ShapesArgs),
    /// Show which accelerations the joints' effort leaves over the writing plane, with the payload
    ///
    /// Per joint: its effort limit, the largest torque of gravity, friction, the largest inertia, and what is
    /// left for this joint alone, over some 400 poses of the pen; with the share of poses that leave
    /// robot.acceleration_radps2 and robot.stale_deceleration_radps2. It moves nothing.
    #[command(after_help = "Examples:\n  foretrace config torque --preset ur5e\n  foretrace config torque \
                      --preset ur5e --set robot.payload.mass_kg=3")]
    Torque {
        #[command(flatten)]
        settings: SettingsArgs,
    },
    /// Print the settings in force as a commented TOML file, each value with its origin
    ///
    /// The output loads as the same settings: redirect it to start a file of your own.
    Show {
        /// A preset, as with --preset: ur5, ur5e or ur5-first-run
        #[arg(value_name = "PRESET", conflicts_with_all = ["config", "preset"],
            value_parser = crate::values::preset)]
        name: Option<String>,

        #[command(flatten)]
        settings: SettingsArgs,
    },
}

pub(crate) fn run(command: &ConfigCommand) -> Result<(), Failure> {
    match command {
        ConfigCommand::Check { file } => {
            let config = Config::load(file).map_err(|error| wrong(&error))?;
            say!("{}", config.summary().trim_end());
            for remark in config.remarks() {
                say!("  warning: {remark}");
            }
            for note in config.notes() {
                say!("  note: {note}");
            }
        }
        ConfigCommand::Shapes(args) => shapes::run(args)?,
        ConfigCommand::Torque { settings } => torque::run(settings)?,
        ConfigCommand::Show { name, settings } => {
            let mut settings = settings.clone();
            if let Some(name) = name {
                settings.preset.clone_from(name);
            }
            say!("{}", settings.load()?.render().trim_end());
        }
    }
    Ok(())
}
