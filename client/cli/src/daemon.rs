//! `foretrace daemon`: the real-time daemon, the same library that `foretraced` runs.

use foretraced::{DaemonError, LogError, Options, Reading, Rights};

use crate::failure::Failure;
use crate::settings::{SettingsArgs, wrong};

/// Run the real-time daemon in the foreground
///
/// It creates the instance's shared memory, waits for an arm and a pen, moves nothing until it is asked to
/// (`foretrace request arm`), and ends on Ctrl-C or SIGTERM with a smooth stop. SIGHUP reloads the settings.
/// Without real-time rights it runs on and reports which ones are missing.
#[derive(Debug, clap::Args)]
pub(crate) struct DaemonCommandArgs {
    /// Rate of the loop [Hz]: 125, 250, 500 or 1000; the grid step is adapted where necessary
    #[arg(long, value_name = "HZ", value_parser = foretraced::options::rate)]
    rate: Option<u32>,

    /// Ask for no real-time rights: no priority, no CPU of its own, no spinning, no locked memory
    #[arg(long)]
    no_rights: bool,

    /// Log level on stderr: error, warn, info, debug
    #[arg(long, value_name = "FILTER", default_value = "info")]
    log: String,

    #[command(flatten)]
    settings: SettingsArgs,
}

pub(crate) fn run(args: &DaemonCommandArgs) -> Result<(), Failure> {
    let _log = foretraced::log_to_stderr(&args.log).map_err(|error| match error {
        LogError::Filter(text) => Failure::usage(text, ""),
        LogError::Start(text) => Failure::failed(text, ""),
    })?;
    let mut source = args.settings.source()?;
    source.rate_hz = args.rate;
    let rights = if args.no_rights { Rights::Leave } else { Rights::Ask };
    match foretraced::run(&Options { rights, reading: Reading::Child, ..Options::new(source) }) {
        Ok(_) => Ok(()),
        Err(DaemonError::Config(error)) => Err(wrong(&error)),
        Err(error) => Err(Failure::failed(error, "")),
    }
}
