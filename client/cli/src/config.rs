//! `foretrace config`: judge a settings file, or show the settings in force.

use std::path::PathBuf;

use foretrace_config::Config;

use crate::failure::Failure;
use crate::output::say;
use crate::settings::{SettingsArgs, wrong};
use crate::shapes::{self, ShapesArgs};

/// `foretrace config ...`
#[derive(Debug, clap::Subcommand)]
pub(crate) enum ConfigCommand {
    /// Judge a settings file: every problem with line, key, value and legal range
    Check {
        /// Settings file (TOML)
        file: PathBuf,
    },
    Shapes(ShapesArgs),
    /// Print the settings in force as a commented TOML file, each value with where it comes from
    ///
    /// The output reads back as the same settings: redirect it to begin a file of your own.
    Show {
        /// A preset, as with --preset: ur5, ur5e or ur5-first-run
        #[arg(value_name = "PRESET", conflicts_with_all = ["config", "preset"], value_parser = crate::values::preset)]
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
                say!("  note: {remark}");
            }
        }
        ConfigCommand::Shapes(args) => shapes::run(args)?,
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
