//! From text to settings: the default, the preset, the file and the caller's overrides, one over the other.
//!
//! Contract: all problems of the file are reported at once; a key that is not in the table is a problem.

use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

use crate::nearest::{current, gone, nearest, without_unit};
use crate::presets;
use crate::problem::{Problem, ProblemKind, ValueFlaw};
use crate::schema::{Presence, Section, SectionReader, Table, joined};
use crate::settings::Settings;
use crate::written::{self, Node, Raw, SettingOrigin};

/// The key that names a preset, at the top of a file.
pub(crate) const PRESET: &str = "preset";

/// The key whose value is the name of a predictor.
const KIND: &str = "predictor.kind";

/// All sections and keys, made once.
pub(crate) fn table() -> &'static Table {
    static TABLE: LazyLock<Table> = LazyLock::new(|| {
        let mut table = Table::default();
        Settings::describe("", &mut table);
        table.sections.retain(|(name, _)| !name.is_empty());
        table
    });
    &TABLE
}

/// The values in force, by full key, each with where it comes from.
pub(crate) type NodesByKey = BTreeMap<String, Node>;

/// The default of every key that has one.
pub(crate) fn defaults(problems: &mut Vec<Problem>) -> NodesByKey {
    let mut found = NodesByKey::new();
    for key in &table().keys {
        if let Presence::Default(value) = key.presence {
            overlay(&format!("{} = {value}", key.path), &SettingOrigin::Default, &mut found, problems);
        }
    }
    found
}

/// Puts the values of `text` over those in `found`; a preset named in it goes under them.
pub(crate) fn overlay(
    text: &str,
    origin: &SettingOrigin,
    found: &mut NodesByKey,
    problems: &mut Vec<Problem>,
) {
    put_over(written::parse(text, origin, problems), found, problems);
}

/// As [`overlay`], for the text of a recording, in which sections and predictors may have names of earlier
/// versions, and keys may be gone: those stay in `found`, without effect.
pub(crate) fn overlay_recorded(
    text: &str,
    origin: &SettingOrigin,
    found: &mut NodesByKey,
    problems: &mut Vec<Problem>,
) {
    let mut root = written::parse(text, origin, problems);
    translate("", &mut root, found);
    put_over(root, found, problems);
}

fn translate(at: &str, entries: &mut Vec<(String, Node)>, found: &mut NodesByKey) {
    for (name, node) in entries.extract_if(.., |(name, _)| gone(&joined(at, name)).is_some()) {
        found.insert(joined(at, &name), node);
    }
    for (name, node) in entries {
        let path = joined(at, name);
        let path = current(&path).map_or(path, |now| {
            now.rsplit('.').next().unwrap_or_default().clone_into(name);
            now.to_owned()
        });
        match &mut node.raw {
            Raw::Table(inner) => translate(&path, inner, found),
            Raw::Text(word) if path == KIND => {
                if let Some(now) = current(word) {
                    (*word, node.text) = (now.to_owned(), format!("{now:?}"));
                }
            }
            _ => {}
        }
    }
}

fn put_over(mut root: Vec<(String, Node)>, found: &mut NodesByKey, problems: &mut Vec<Problem>) {
    if let Some(i) = root.iter().position(|(key, _)| key == PRESET) {
        let (_, node) = root.remove(i);
        if let Some((name, text)) = preset_text(&node, problems) {
            overlay(text, &SettingOrigin::Preset { name, line: 0 }, found, problems);
        }
    }
    collect("", root, found, problems);
}

/// Checks the values and builds the settings; `None` exactly when a problem was pushed.
pub(crate) fn settings(
    found: &NodesByKey,
    whole: &SettingOrigin,
    problems: &mut Vec<Problem>,
) -> Option<Settings> {
    Settings::read(&mut SectionReader { found, whole, problems }, "")
}

fn preset_text(node: &Node, problems: &mut Vec<Problem>) -> Option<(Arc<str>, &'static str)> {
    let value = match &node.raw {
        Raw::Text(name) => match presets::text(name) {
            Some(text) => return Some((Arc::from(name.as_str()), text)),
            None => name.chars().take(60).collect(),
        },
        _ => node.text.clone(),
    };
    let kind = ProblemKind::UnknownPreset { value, known: presets::names() };
    problems.push(Problem::new(&node.origin, kind));
    None
}

fn collect(at: &str, entries: Vec<(String, Node)>, found: &mut NodesByKey, problems: &mut Vec<Problem>) {
    for (name, node) in entries {
        let path = joined(at, &name);
        // A quoted name with a dot in it is one name: `"loop.rate_hz" = 500` is not the key of the section.
        let plain = !name.contains('.');
        if plain && table().find(&path).is_some() {
            found.insert(path, node);
        } else if plain && table().sections.iter().any(|(section, _)| *section == path) {
            match node.raw {
                Raw::Table(inner) => collect(&path, inner, found, problems),
                _ => {
                    let wanted = format!("a section: write [{path}] with keys under it");
                    let flaw = ValueFlaw::WrongType { found: node.raw.kind(), wanted };
                    problems.push(node.flawed(&path, flaw));
                }
            }
        } else if let Raw::Table(_) = node.raw {
            let hint = nearest_section(&path).map_or_else(
                || format!(": the sections are {}", top_sections()),
                |section| format!(": did you mean `[{section}]`?"),
            );
            let kind = ProblemKind::UnknownSection { section: shortened(&path), hint };
            problems.push(Problem::new(&node.origin, kind));
        } else {
            let kind = ProblemKind::UnknownKey { key: shortened(&path), hint: hint(at, &name) };
            problems.push(Problem::new(&node.origin, kind));
        }
    }
}

/// Suggests the key that may have been meant.
fn hint(at: &str, name: &str) -> String {
    if let Some(why) = gone(&joined(at, name)) {
        return format!(": it is gone: {why}");
    }
    let here = table().keys.iter().filter(|key| key.section == at);
    let bare = |path: &str| path.rsplit('.').next().unwrap_or_default().to_owned();
    if let Some(key) = here.clone().find(|key| without_unit(&bare(&key.path)) == without_unit(name)) {
        let unit = if key.unit.is_empty() { "no unit".to_owned() } else { format!("the unit {}", key.unit) };
        return format!(": did you mean `{}`? It takes {unit}; convert the value", key.path);
    }
    let names: Vec<String> = here.map(|key| bare(&key.path)).collect();
    if let Some(near) = nearest(name, names.iter().map(String::as_str)) {
        return format!(": did you mean `{}`?", joined(at, near));
    }
    if let Some(key) = table().keys.iter().find(|key| bare(&key.path) == name) {
        return format!(": the key of that name is `{}`", key.path);
    }
    if at.is_empty() {
        return format!(": at the top level only `{PRESET}` and the sections {} stand", top_sections());
    }
    format!(": [{at}] has {}", if names.is_empty() { "only sections".to_owned() } else { names.join(", ") })
}

fn nearest_section(path: &str) -> Option<&'static str> {
    let sections = table().sections.iter().map(|(section, _)| section.as_str());
    nearest(path, sections.clone()).or_else(|| {
        // `[limits.x]` for `[mpc.limits.x]`.
        sections
            .into_iter()
            .find(|section| section.strip_suffix(path).is_some_and(|rest| rest.ends_with('.')))
    })
}

fn top_sections() -> String {
    let top: Vec<String> = table()
        .sections
        .iter()
        .filter(|(name, _)| !name.contains('.'))
        .map(|(name, _)| format!("[{name}]"))
        .collect();
    top.join(" ")
}

fn shortened(name: &str) -> String {
    if name.chars().count() <= 80 {
        name.to_owned()
    } else {
        name.chars().take(77).chain("...".chars()).collect()
    }
}
