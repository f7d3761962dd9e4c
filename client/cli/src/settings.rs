//! `--config`, `--preset`, `--set`, `--instance`, `--root`: which settings, and which daemon.

use std::path::PathBuf;

use foretrace_config::{Config, ConfigError, plain};
use foretraced::{Base, Source};

use crate::failure::Failure;
use crate::values;

/// Which daemon, for commands that only attach to one.
#[derive(Debug, Clone, Default, clap::Args)]
pub(crate) struct InstanceArgs {
    /// Number of the daemon's instance; two daemons on one machine need two numbers [default: 0]
    #[arg(
        long,
        value_name = "N",
        global = true,
        env = "FORETRACE_INSTANCE",
        value_parser = clap::value_parser!(u32).range(0..=99)
    )]
    pub(crate) instance: Option<u32>,

    /// Folder for the shared memory's bookkeeping, for tests and private demos (at most 38 bytes)
    #[arg(
        long,
        value_name = "DIR",
        global = true,
        hide_short_help = true,
        env = "FORETRACE_ROOT",
        value_parser = values::root
    )]
    pub(crate) root: Option<PathBuf>,
}

/// Settings of the daemon, for commands that need to know them.
#[derive(Debug, Clone, Default, clap::Args)]
pub(crate) struct SettingsArgs {
    /// Settings file (TOML); see `foretrace config show`
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    pub(crate) config: Option<PathBuf>,

    /// Built-in settings: ur5, ur5e or ur5-first-run
    #[arg(long, value_name = "NAME", default_value = "ur5", value_parser = values::preset)]
    pub(crate) preset: String,

    /// Put one value over the file or preset, for example --set loop.rate_hz=250
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = values::pair)]
    pub(crate) set: Vec<String>,

    #[command(flatten)]
    pub(crate) instance: InstanceArgs,
}

impl SettingsArgs {
    /// Loads and judges the settings.
    pub(crate) fn load(&self) -> Result<Config, Failure> {
        judged(&self.source()?)
    }

    /// Where the settings come from; `--instance`, `--root` and `--set` win over the file.
    pub(crate) fn source(&self) -> Result<Source, Failure> {
        let base = match &self.config {
            Some(file) => Base::File(file.clone()),
            None => Base::Preset(self.preset.clone()),
        };
        let mut overrides = Vec::new();
        for pair in &self.set {
            let (key, value) = pair.split_once('=').ok_or_else(|| {
                Failure::usage(format_args!("--set {pair} has no value"), "write --set KEY=VALUE")
            })?;
            overrides.push((key.trim().to_owned(), value.trim().to_owned()));
        }
        if let Some(number) = self.instance.instance {
            overrides.push(("instance.number".to_owned(), number.to_string()));
        }
        if let Some(root) = &self.instance.root {
            overrides.push(("instance.root_dir".to_owned(), quoted(&root.to_string_lossy())));
        }
        Ok(Source { base, rate_hz: None, overrides })
    }
}

/// Loads and judges the settings of `source`.
pub(crate) fn judged(source: &Source) -> Result<Config, Failure> {
    source.load().map_err(|error| wrong(&error))
}

/// The failure that tells everything that is wrong with the settings.
pub(crate) fn wrong(error: &ConfigError) -> Failure {
    let lines: Vec<String> =
        error.problems().iter().map(|problem| plain(&problem.to_string()).into_owned()).collect();
    match lines.as_slice() {
        [only] => Failure::bad_input(only, ""),
        many => Failure::bad_input(
            format_args!("{} problems in the settings:\n  {}", many.len(), many.join("\n  ")),
            "",
        ),
    }
}

/// `text` as a TOML string.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}
