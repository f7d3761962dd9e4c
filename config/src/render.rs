//! Rendering: the settings in force as a commented file, and the table of keys for the documents.

use std::fmt::Write as _;

use crate::config::Config;
#[cfg(test)]
use crate::layers::PRESET;
use crate::layers::table;
use crate::live::values;
use crate::schema::{Change, Key, Presence};
use crate::written::Place;

/// Every key, in the order of the sections.
#[must_use]
pub fn keys() -> &'static [Key] {
    &table().keys
}

impl Config {
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
                        let from = self.origin(&key.path).unwrap_or(&Place::Default);
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
        let count = |wanted: fn(&Place) -> bool| {
            keys().iter().filter(|key| self.origin(&key.path).is_some_and(wanted)).count()
        };
        format!(
            "{}: ok\n  {} keys from the file, {} from the preset, {} by default\n  \
             loop {} Hz, pen step {} ms, plan of {} steps of {} ms, predictor {}, trust {}\n  \
             robot {}, dead time {} ms",
            self.name(),
            count(|place| matches!(place, Place::File { .. } | Place::Override)),
            count(|place| matches!(place, Place::Preset { .. })),
            count(|place| matches!(place, Place::Default)),
            s.control_loop.rate_hz,
            s.pen.step_ms,
            s.mpc.horizon,
            s.plan_step_s() * 1e3,
            s.predictor.kind.name(),
            s.trust.mode.word(),
            s.robot.urdf,
            s.timing.dead_time_ms,
        )
    }
}

/// All keys as a Markdown table per section, for `docs/configure/settings.md`.
#[must_use]
pub fn key_table() -> String {
    let mut text = String::new();
    for (section, title) in &table().sections {
        let _ = write!(text, "\n### `[{section}]`\n\n{title}\n");
        let here: Vec<&Key> = table().keys.iter().filter(|key| key.section == *section).collect();
        if here.is_empty() {
            continue;
        }
        text.push_str(
            "\n| key | meaning | legal | when absent | changes | start with |\n|---|---|---|---|---|---|\n",
        );
        for key in here {
            let name = key.path.rsplit('.').next().unwrap_or_default();
            let absent = match key.presence {
                Presence::Required => "error".to_owned(),
                Presence::Default(value) => format!("`{value}`"),
                Presence::Optional => "not set".to_owned(),
            };
            let _ = writeln!(
                text,
                "| `{name}` | {} | {} | {absent} | {} | {} |",
                key.meaning.replace('|', "\\|"),
                key.legal_text,
                when(key.change),
                key.start_with
            );
        }
    }
    text
}

const fn when(change: Change) -> &'static str {
    match change {
        Change::Live => "live",
        Change::AtStart => "at start",
    }
}

/// `text` as comment lines of a readable width.
fn comment(text: &str) -> String {
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

/// A preset's text: its own head (the comment up to the first empty line), then every key with its comment;
/// keys that the preset does not set are commented out. A preset with a base has only the keys that it
/// changes.
#[cfg(test)]
pub(crate) fn commented(text: &str, config: &Config) -> String {
    let values = values(config.settings());
    let own = |place: &Place| {
        matches!(place, Place::Preset { name, .. }
        if config.name() == format!("preset {name}"))
    };
    let given = |key: &Key| config.origin(&key.path).is_some_and(own);
    let over = text.lines().find(|line| line.starts_with(PRESET));
    let mut out: String = text
        .lines()
        .take_while(|line| line.starts_with('#'))
        .fold(String::new(), |all, line| all + line + "\n");
    if let Some(line) = over {
        let _ = write!(out, "\n{line}\n");
    }
    for (section, title) in &table().sections {
        let here = table().keys.iter().filter(|key| key.section == *section);
        let shown: Vec<&Key> = here.filter(|key| over.is_none() || given(key)).collect();
        if over.is_some() && shown.is_empty() {
            continue;
        }
        let _ = write!(out, "\n{}[{section}]\n", comment(title));
        for key in shown {
            let name = key.path.rsplit('.').next().unwrap_or_default();
            out.push_str(&comment(&key.meaning));
            out.push_str(&comment(&format!(
                "Legal: {}. Takes effect {}. Start with: {}.",
                key.legal_text,
                when(key.change),
                key.start_with
            )));
            match values.get(&key.path).and_then(Option::as_ref) {
                Some(value) if given(key) => drop(writeln!(out, "{name} = {value}")),
                Some(value) => drop(writeln!(out, "# {name} = {value}")),
                None => drop(writeln!(out, "# {name} =")),
            }
        }
    }
    out
}
