//! Texts in the repository that follow from the table of keys: the list in the documents, and the presets.

use std::fmt::Write as _;

use crate::Config;
use crate::layers::{PRESET, table};
use crate::live::values;
use crate::render::{comment, when};
use crate::schema::{Key, Presence};
use crate::written::SettingOrigin;

/// All keys as a Markdown table per section, for `docs/configure/settings.md`.
pub(crate) fn key_table() -> String {
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

/// A preset's text: its own head (the comment up to the first empty line), then every key with its comment;
/// keys that the preset does not set are commented out. A preset with a base has only the keys that it
/// changes.
pub(crate) fn commented(text: &str, config: &Config) -> String {
    let values = values(config.settings());
    let own = |origin: &SettingOrigin| {
        matches!(origin, SettingOrigin::Preset { name, .. }
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
