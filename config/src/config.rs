//! Loading: a draft collects layers of values, a config is the checked result.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use foretrace_control::arm::DynamicsError;
use foretrace_control::estimate::refine::RefinePrior;
use foretrace_control::predict::Models;
use toml::de::DeValue;

use crate::check::check;
use crate::files::{Files, LONGEST_SETTINGS};
use crate::headroom::{Headroom, headroom};
use crate::layers::{self, NodesByKey};
use crate::models::{SHIPPED_PRIOR, shipped};
use crate::nearest::gone;
use crate::plain::plain;
use crate::predictor::NO_NETWORK;
use crate::presets;
use crate::problem::{ConfigError, Problem, ProblemKind};
use crate::remarks;
use crate::robot::Robot;
use crate::settings::Settings;
use crate::unarmed;
use crate::written::{Raw, SettingOrigin};

/// Settings that are complete, inside their ranges, and fit together.
#[derive(Clone)]
pub struct Config {
    settings: Settings,
    robot: Robot,
    models: Models,
    prior: RefinePrior,
    found: NodesByKey,
    name: String,
}

impl fmt::Debug for Config {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Robot and origins follow from the settings and would hide them.
        f.debug_struct("Config")
            .field("name", &self.name)
            .field("settings", &self.settings)
            .finish_non_exhaustive()
    }
}

impl Config {
    /// Loads a settings file.
    ///
    /// # Errors
    ///
    /// Everything that is wrong with the file, each with line, key, value, legal range and what to
    /// do.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, ConfigError> {
        Draft::file(path).finish()
    }

    /// The settings of an embedded preset, for example `ur5`.
    ///
    /// # Errors
    ///
    /// There is no preset of that name.
    pub fn preset(name: &str) -> Result<Self, ConfigError> {
        Draft::preset(name).finish()
    }

    /// Judges `text` as if it were a file called `name` in the folder `folder` (for relative paths in it).
    ///
    /// # Errors
    ///
    /// As [`Config::load`].
    pub fn parse(text: &str, name: &str, folder: impl AsRef<Path>) -> Result<Self, ConfigError> {
        Draft::text(text, name, folder).finish()
    }

    /// Judges the settings in a recording, in which sections and predictors may have names of earlier
    /// versions.
    ///
    /// # Errors
    ///
    /// As [`Config::load`].
    pub fn recorded(text: &str) -> Result<Self, ConfigError> {
        Draft::recorded(text).finish()
    }

    /// The settings, section by section.
    #[must_use]
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The arm that the settings and the URDF describe together.
    #[must_use]
    pub const fn robot(&self) -> &Robot {
        &self.robot
    }

    /// What the predictors are made of, the trained network included.
    #[must_use]
    pub const fn models(&self) -> &Models {
        &self.models
    }

    /// The weights from which refinement starts.
    #[must_use]
    pub const fn prior(&self) -> &RefinePrior {
        &self.prior
    }

    /// Remarks on legal settings: what they lack, or what will refuse them later; one line each.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        remarks::remarks(self)
    }

    /// Smaller things to know about legal settings, which the shipped ones have as well; one line each.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        remarks::notes(self)
    }

    /// Keys of a recording that are gone, each with the reason; they had no effect on [`Config::recorded`].
    #[must_use]
    pub fn gone(&self) -> Vec<String> {
        let reason = |key: &String| gone(key).map(|why| format!("`{key}` is gone: {why}"));
        self.found.keys().filter_map(reason).collect()
    }

    /// What the effort of the arm's joints leaves for acceleration over the writing plane.
    ///
    /// # Errors
    ///
    /// The URDF has no usable masses.
    pub fn headroom(&self) -> Result<Headroom, DynamicsError> {
        headroom(&self.settings, &self.robot)
    }

    /// What was loaded: the path of the file, or `preset ur5`.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Where the value of `key` (for example `loop.rate_hz`) comes from; `None` for a key that is not set.
    #[must_use]
    pub fn origin(&self, key: &str) -> Option<&SettingOrigin> {
        self.found.get(key).map(|node| &node.origin)
    }
}

/// Layers of settings that have not been checked yet.
///
/// For programs that put command-line options over a file: `Draft::preset("ur5").set("loop.rate_hz",
/// "125").finish()`.
#[derive(Debug, Clone)]
pub struct Draft {
    found: NodesByKey,
    whole: SettingOrigin,
    folder: PathBuf,
    problems: Vec<Problem>,
    files: Files,
}

impl Draft {
    /// Starts from a settings file; [`Draft::finish`] reports what is wrong with it.
    #[must_use]
    pub fn file(path: impl AsRef<Path>) -> Self {
        Self::file_of(path, Files::Disk)
    }

    /// As [`Draft::file`], with that file and all that it names read from `files`.
    #[must_use]
    pub fn file_of(path: impl AsRef<Path>, files: Files) -> Self {
        let path = path.as_ref();
        let name: Arc<str> = Arc::from(plain(&path.display().to_string()));
        let origin = SettingOrigin::File { path: name.clone(), line: 0 };
        let unreadable = |why: String, remedy| {
            let mut draft = Self::new(origin.clone(), PathBuf::new());
            draft.problems.push(Problem::new(&origin, ProblemKind::Unreadable { why, remedy }));
            draft
        };
        let bytes = match files.read(path, LONGEST_SETTINGS) {
            Ok(bytes) => bytes,
            Err(error) => {
                return unreadable(
                    error.to_string(),
                    "check the path, or begin with a preset: foretrace config show ur5",
                );
            }
        };
        match String::from_utf8(bytes) {
            Ok(text) => {
                Self { files, ..Self::text(&text, &name, path.parent().unwrap_or_else(|| Path::new("."))) }
            }
            Err(error) => {
                let at = error.utf8_error().valid_up_to();
                let line = 1 + error.as_bytes().iter().take(at).filter(|byte| **byte == b'\n').count();
                let remedy = "save the file as UTF-8 text";
                unreadable(format!("not UTF-8 at byte {at}, line {line}"), remedy)
            }
        }
    }

    /// Starts from an embedded preset.
    #[must_use]
    pub fn preset(name: &str) -> Self {
        let origin = SettingOrigin::Preset { name: Arc::from(name), line: 0 };
        let mut draft = Self::new(origin.clone(), PathBuf::from("."));
        match presets::text(name) {
            Some(text) => layers::overlay(text, &origin, &mut draft.found, &mut draft.problems),
            None => {
                let kind = ProblemKind::UnknownPreset { value: name.to_owned(), known: presets::names() };
                draft.problems.push(Problem::new(&SettingOrigin::Override, kind));
            }
        }
        draft
    }

    /// Starts from `text` as if it were a file called `name` in `folder`.
    #[must_use]
    pub fn text(text: &str, name: &str, folder: impl AsRef<Path>) -> Self {
        Self::written(text, name, folder, layers::overlay)
    }

    /// Starts from the settings of a recording: names of earlier versions are translated, and keys that are
    /// gone have no effect ([`Config::gone`]).
    #[must_use]
    pub fn recorded(text: &str) -> Self {
        Self::written(text, "the recording", ".", layers::overlay_recorded)
    }

    fn written(
        text: &str,
        name: &str,
        folder: impl AsRef<Path>,
        overlay: fn(&str, &SettingOrigin, &mut NodesByKey, &mut Vec<Problem>),
    ) -> Self {
        let origin = SettingOrigin::File { path: Arc::from(name), line: 0 };
        let mut draft = Self::new(origin.clone(), folder.as_ref().to_owned());
        if text.len() as u64 > LONGEST_SETTINGS {
            let why = format!("it has {} bytes, {LONGEST_SETTINGS} are the most that are read", text.len());
            let kind = ProblemKind::Unreadable { why, remedy: "write only what a preset lacks" };
            draft.problems.push(Problem::new(&origin, kind));
            return draft;
        }
        overlay(text, &origin, &mut draft.found, &mut draft.problems);
        draft
    }

    /// Reads the files that the settings name from `files`.
    #[must_use]
    pub fn files(self, files: Files) -> Self {
        Self { files, ..self }
    }

    /// Puts a value over what the file says. `value` is TOML; a bare word is taken as text.
    #[must_use]
    pub fn set(mut self, key: &str, value: &str) -> Self {
        let value = match DeValue::parse(value) {
            Ok(_) => value.to_owned(),
            Err(_) => toml::Value::String(value.to_owned()).to_string(),
        };
        layers::overlay(
            &format!("{key} = {value}"),
            &SettingOrigin::Override,
            &mut self.found,
            &mut self.problems,
        );
        self
    }

    /// Sets the rate of the loop, and with it the grid step where that is not a multiple of the new period
    /// (the nearest that is: 8 ms for 10 ms at 125 and 250 Hz).
    #[must_use]
    pub fn rate(self, rate_hz: u32) -> Self {
        let step = self.found.get("pen.step_ms").and_then(|node| match node.raw {
            Raw::Whole(step_ms) => u32::try_from(step_ms).ok(),
            _ => None,
        });
        let fitting = step.zip(1000_u32.checked_div(rate_hz)).and_then(|(step, period_ms)| {
            (4..=20_u32).filter(|ms| ms.checked_rem(period_ms) == Some(0)).min_by_key(|ms| ms.abs_diff(step))
        });
        let draft = self.set("loop.rate_hz", &rate_hz.to_string());
        match fitting {
            Some(fitting) if Some(fitting) != step => draft.set("pen.step_ms", &fitting.to_string()),
            _ => draft,
        }
    }

    /// Judges everything.
    ///
    /// # Errors
    ///
    /// All that is wrong, in the order of the file.
    pub fn finish(self) -> Result<Config, ConfigError> {
        let Self { found: written, whole, folder, mut problems, files } = self;
        let unreadable = problems
            .iter()
            .any(|p| matches!(p.kind, ProblemKind::Unreadable { .. } | ProblemKind::Syntax(_)));
        if !unreadable {
            let mut found = layers::defaults(&mut problems);
            found.extend(written);
            let unknown_preset = problems.iter().any(|p| matches!(p.kind, ProblemKind::UnknownPreset { .. }));
            let settings = layers::settings(&found, &whole, &mut problems);
            if unknown_preset {
                // Without its preset every key is missing: report the one cause.
                problems.retain(|problem| !matches!(problem.kind, ProblemKind::Missing { .. }));
            }
            if let Some(mut settings) = settings {
                settings.robot.urdf =
                    resolved(&settings.robot.urdf, &folder, |name| presets::robot(name).is_some());
                let predictor = &mut settings.predictor;
                let (mixture, foresight) = (&mut predictor.mixture.network, &mut predictor.mixture.foresight);
                for network in [&mut predictor.lstm, mixture, foresight] {
                    let known = |name: &str| name == NO_NETWORK || shipped(name).is_some();
                    *network = network.take().map(|name| resolved(&name, &folder, known));
                }
                let prior = &mut settings.predictor.refine.prior;
                *prior = prior.take().map(|name| resolved(&name, &folder, |name| name == SHIPPED_PRIOR.name));
                let built = check(&settings, &found, &whole, &mut problems, &files);
                if let (Some((robot, models, prior)), true) = (built, problems.is_empty()) {
                    let name = whole.to_string();
                    let config = Config { settings, robot, models, prior, found, name };
                    match unarmed::at_home(&config) {
                        None => return Ok(config),
                        Some(problem) => problems.push(problem),
                    }
                }
            }
        }
        problems.sort_by_key(Problem::line);
        Err(ConfigError::new(problems))
    }

    fn new(whole: SettingOrigin, folder: PathBuf) -> Self {
        Self { found: NodesByKey::new(), whole, folder, problems: Vec::new(), files: Files::Disk }
    }
}

/// The name of something embedded as it is; a path made absolute, so that settings shown here load elsewhere.
fn resolved(name: &str, folder: &Path, embedded: impl Fn(&str) -> bool) -> String {
    if embedded(name) {
        return name.to_owned();
    }
    let path = folder.join(name);
    std::path::absolute(&path).unwrap_or(path).to_string_lossy().into_owned()
}
