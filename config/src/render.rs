//! Rendering: the settings in force as a commented file, and the table of keys for the documents.

use std::fmt::Write as _;

use crate::config::Config;
use crate::layers::table;
use crate::live::values;
use crate::schema::{Change, Key};
use crate::written::SettingOrigin;

/// Every key, in the order of the sections.
#[must_use]
pub fn keys() -> &'static [Key] {
    &table().keys
}

/// Keys whose value is the name of something embedded, or a path.
const FILE_KEYS: [&str; 5] = [
    "robot.urdf",
    "predictor.lstm",
    "predictor.mixture.network",
    "predictor.mixture.foresight",
    "predictor.refine.prior",
];

impl Config {
    /// Every key with its value, one a line, without where it comes from and without paths of files: settings
    /// that mean the same have the same text on every machine, wherever they lie. What the files hold is in
    /// [`Config::robot`], [`Config::models`] and [`Config::prior`].
    #[must_use]
    pub fn meaning(&self) -> String {
        let values = values(self.settings());
        let line = |key: &Key| {
            let value = values.get(&key.path).and_then(Option::as_deref).unwrap_or("not set");
            // Paths are absolute, names of what is embedded are not.
            let is_path = FILE_KEYS.contains(&key.path.as_str()) && value.starts_with("\"/");
            format!("{} = {}\n", key.path, if is_path { "a file" } else { value })
        };
        keys().iter().map(line).collect()
    }

    /// The settings in force as TOML with comments, each value with its origin. Loads as the same settings.
    #[must_use]
    pub fn render(&self) -> String {
        let values = values(self.settings());
        let mut text =
            format!("# Settings of foretrace in force, from {}. Every key is shown.\n", self.name());
        for (section, title) in &table().sections {
            let _ = write!(text, "\n{}[{section}]\n", comment(title));
            for key in table().keys.iter().filter(|key| key.section == *section) {
                text.push_str(&comment(&format!(
                    "{} ({}; {})",
                    key.meaning,
                    key.legal_text,
                    when(key.change)
                )));
                let name = key.path.rsplit('.').next().unwrap_or_default();
                match values.get(&key.path).and_then(Option::as_ref) {
                    Some(value) => {
                        let from = self.origin(&key.path).unwrap_or(&SettingOrigin::Default);
                        let _ = writeln!(text, "{name} = {value}  # from {}", one_line(&from.to_string()));
                    }
                    None => {
                        let _ = writeln!(text, "# {name} is not set");
                    }
                }
            }
        }
        text
    }

    /// One line per section for `foretrace config check`: what the file means, in short.
    #[must_use]
    pub fn summary(&self) -> String {
        let s = self.settings();
        let count = |wanted: fn(&SettingOrigin) -> bool| {
            keys().iter().filter(|key| self.origin(&key.path).is_some_and(wanted)).count()
        };
        format!(
            "{}: ok\n  {} keys from the file, {} from the preset, {} by default\n  \
             loop {} Hz, pen step {} ms, plan of {} steps of {} ms, predictor {}, trust {}\n  \
             robot {}, dead time {} ms, pen samples predicted while the newest is at most {} ms old",
            self.name(),
            count(|origin| matches!(origin, SettingOrigin::File { .. } | SettingOrigin::Override)),
            count(|origin| matches!(origin, SettingOrigin::Preset { .. })),
            count(|origin| matches!(origin, SettingOrigin::Default)),
            s.control_loop.rate_hz,
            s.pen.step_ms,
            s.mpc.horizon,
            s.plan_step_s() * 1e3,
            s.predictor.kind.name(),
            s.trust.mode.word(),
            s.robot.urdf,
            s.timing.dead_time_ms,
            s.pen.stale_ms,
        )
    }
}

pub(crate) const fn when(change: Change) -> &'static str {
    match change {
        Change::Live => "live",
        Change::AtStart => "at start",
    }
}

/// `text` as comment lines of a readable width.
pub(crate) fn comment(text: &str) -> String {
    const WIDTH: usize = 100;
    let mut lines = String::new();
    let mut line = String::from("#");
    for word in text.split_whitespace() {
        if line.len() + 1 + word.len() > WIDTH && line.len() > 1 {
            lines.push_str(&line);
            lines.push('\n');
            line = String::from("#");
        }
        line.push(' ');
        line.push_str(word);
    }
    lines.push_str(&line);
    lines.push('\n');
    lines
}

/// A path may hold a line break: in a comment it would begin a line of TOML.
fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
