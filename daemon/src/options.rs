//! Options of the daemon's start, and the settings that follow from them.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use foretrace_config::files::Files;
use foretrace_config::{Config, ConfigError, Draft, Settings};

use crate::rt::cyclic::Rhythm;
use crate::rt::overruns::OverrunLimit;
use crate::rt::thread::RtSettings;

/// Source of the settings: a file or a preset, with overrides.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// The file or preset.
    pub base: Base,
    /// Ticks per second instead of the file's; the grid step follows if needed.
    pub rate_hz: Option<u32>,
    /// Overrides, keys and values as in the file.
    pub overrides: Vec<(String, String)>,
}

/// A file or a preset.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Base {
    /// Path of a settings file.
    File(PathBuf),
    /// Name of an embedded preset.
    Preset(String),
}

impl Source {
    /// A preset without overrides.
    #[must_use]
    pub fn preset(name: &str) -> Self {
        Self { base: Base::Preset(name.to_owned()), rate_hz: None, overrides: Vec::new() }
    }

    /// A file without overrides.
    #[must_use]
    pub fn file(path: impl Into<PathBuf>) -> Self {
        Self { base: Base::File(path.into()), rate_hz: None, overrides: Vec::new() }
    }

    #[must_use]
    pub fn with(mut self, key: &str, value: impl ToString) -> Self {
        self.overrides.push((key.to_owned(), value.to_string()));
        self
    }

    /// Reads and checks the settings.
    ///
    /// # Errors
    /// Everything that is wrong with the settings.
    pub fn load(&self) -> Result<Config, ConfigError> {
        self.load_from(&Files::Disk)
    }

    /// As [`Source::load`], with the file and all that it names read from `files`.
    ///
    /// # Errors
    /// Everything that is wrong with the settings.
    pub fn load_from(&self, files: &Files) -> Result<Config, ConfigError> {
        let mut draft = match &self.base {
            Base::File(path) => Draft::file_of(path, files.clone()),
            Base::Preset(name) => Draft::preset(name).files(files.clone()),
        };
        if let Some(rate_hz) = self.rate_hz {
            draft = draft.rate(rate_hz);
        }
        for (key, value) in &self.overrides {
            draft = draft.set(key, value);
        }
        draft.finish()
    }
}

/// Who reads the settings first when they are read again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reading {
    /// This process: what makes reading fail badly (stack, memory) ends it. For tests inside a process.
    #[default]
    Here,
    /// A child of this program, whose `main` begins with [`crate::reload::child`].
    Child,
}

/// Whether the loop asks the system for real-time rights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Rights {
    /// As the settings say.
    #[default]
    Ask,
    /// No priority, no CPU of its own, no spinning, no locked memory: for tests and small machines.
    Leave,
}

impl Rights {
    /// Rights and rhythm of the real-time thread.
    #[must_use]
    pub fn rt_settings(self, settings: &Settings) -> RtSettings {
        let section = &settings.control_loop;
        let period_ns = settings.period_ns();
        let overruns = OverrunLimit {
            share: settings.safety.late_ticks_max,
            window: (settings.safety.late_ticks_window_ms * 1e6 / period_ns as f64).round() as usize,
        };
        let asks = self == Self::Ask;
        let spin_ns = if asks { u64::from(section.spin_us) * 1000 } else { 0 };
        RtSettings {
            rhythm: Rhythm { period_ns, spin_ns },
            priority: asks.then_some(section.priority),
            cpu: section.cpu.filter(|_| asks).map(|cpu| cpu as usize),
            max_iterations: settings.mpc.max_iterations,
            overruns,
        }
    }
}

/// Ends a running daemon from within the process, like a signal from outside.
#[derive(Debug, Clone, Default)]
pub struct StopHandle(Arc<AtomicBool>);

impl StopHandle {
    /// Stops the arm smoothly, then ends the daemon.
    pub fn stop(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// Whether a stop was requested since the last call.
    pub(crate) fn take(&self) -> bool {
        self.0.swap(false, Ordering::AcqRel)
    }

    pub(crate) fn flag(&self) -> Arc<AtomicBool> {
        self.0.clone()
    }
}

/// Options of a run.
#[derive(Debug, Clone)]
pub struct Options {
    /// Where settings come from; read again at a reload.
    pub source: Source,
    pub rights: Rights,
    /// Who reads them first then.
    pub reading: Reading,
    /// SIGINT and SIGTERM end the daemon, SIGHUP reloads the settings. If off, only `stop` ends it.
    pub signals: bool,
    pub stop: StopHandle,
}

impl Options {
    /// Settings from `source`, and the options of a service.
    #[must_use]
    pub fn new(source: Source) -> Self {
        Self {
            source,
            rights: Rights::Ask,
            reading: Reading::Here,
            signals: true,
            stop: StopHandle::default(),
        }
    }
}

/// The command line of `foretraced`, and of `foretrace daemon`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct DaemonArgs {
    /// Settings file
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    pub config: Option<PathBuf>,
    /// Embedded settings: ur5, ur5e or ur5-first-run
    #[arg(long, value_name = "NAME", default_value = "ur5", value_parser = preset)]
    pub preset: String,
    /// Instance number, 0 to 99; programs that attach use the same
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=99))]
    pub instance: Option<u32>,
    /// Ticks per second: 125, 250, 500 or 1000
    #[arg(long, value_name = "HZ", value_parser = rate)]
    pub rate: Option<u32>,
    /// Put VALUE over KEY of the settings, for example loop.spin_us=0; may be repeated
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_value)]
    pub set: Vec<(String, String)>,
    /// Ask for no real-time rights: no priority, no CPU of its own, no spinning, no locked memory
    #[arg(long)]
    pub no_rights: bool,
}

impl DaemonArgs {
    /// The options they mean.
    #[must_use]
    pub fn options(&self) -> Options {
        let base = match &self.config {
            Some(path) => Base::File(path.clone()),
            None => Base::Preset(self.preset.clone()),
        };
        let mut overrides = self.set.clone();
        if let Some(number) = self.instance {
            overrides.push(("instance.number".to_owned(), number.to_string()));
        }
        let source = Source { base, rate_hz: self.rate, overrides };
        let rights = if self.no_rights { Rights::Leave } else { Rights::Ask };
        Options { rights, reading: Reading::Child, ..Options::new(source) }
    }
}

/// Checks a loop rate, as in `loop.rate_hz`.
///
/// # Errors
/// The legal ones in words.
pub fn rate(text: &str) -> Result<u32, String> {
    let rate = text.parse().ok().filter(|rate| [125, 250, 500, 1000].contains(rate));
    rate.ok_or_else(|| "the rates are 125, 250, 500 and 1000".to_owned())
}

fn preset(text: &str) -> Result<String, String> {
    match foretrace_config::presets::text(text) {
        Some(_) => Ok(text.to_owned()),
        None => Err(format!("the presets are {}", foretrace_config::presets::names())),
    }
}

fn key_value(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => Ok((key.trim().to_owned(), value.trim().to_owned())),
        _ => Err("expected KEY=VALUE, for example loop.rate_hz=250".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_stand_over_the_preset() {
        let args = DaemonArgs {
            config: None,
            preset: "ur5e".to_owned(),
            instance: Some(7),
            rate: Some(250),
            set: vec![("loop.spin_us".to_owned(), "0".to_owned())],
            no_rights: true,
        };
        let options = args.options();
        assert_eq!(options.rights, Rights::Leave);
        let config = options.source.load().unwrap();
        let settings = config.settings();
        assert_eq!(settings.instance.number, 7);
        assert_eq!(settings.control_loop.rate_hz, 250);
        assert_eq!(settings.control_loop.spin_us, 0);
        assert_eq!(settings.step_ns() % settings.period_ns(), 0);
    }

    #[test]
    fn a_wrong_key_is_refused_by_name() {
        let error = Source::preset("ur5").with("loop.rate_hertz", 500).load().unwrap_err();
        assert!(error.to_string().contains("rate_hertz"), "{error}");
    }

    #[test]
    fn a_rate_is_one_that_the_settings_take() {
        for rate_hz in [125, 250, 500, 1000] {
            assert_eq!(rate(&rate_hz.to_string()), Ok(rate_hz));
            assert!(Source { rate_hz: Some(rate_hz), ..Source::preset("ur5") }.load().is_ok(), "{rate_hz}");
        }
        for wrong in ["333", "0", "-500", "500.5", ""] {
            assert!(rate(wrong).unwrap_err().contains("125, 250, 500 and 1000"), "{wrong}");
        }
    }

    #[test]
    fn an_override_without_a_value_is_refused() {
        assert!(key_value("loop.rate_hz").is_err());
        assert!(key_value("=5").is_err());
        assert_eq!(key_value("a.b = 5").unwrap(), ("a.b".to_owned(), "5".to_owned()));
    }
}
