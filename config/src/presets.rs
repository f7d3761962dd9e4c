//! Presets and robots that are part of the program.

/// Name and text of every preset.
const PRESETS: &[(&str, &str)] =
    &[("ur5", include_str!("../presets/ur5.toml")), ("ur5e", include_str!("../presets/ur5e.toml"))];

/// The text of a preset, with its comments.
#[must_use]
pub fn text(name: &str) -> Option<&'static str> {
    PRESETS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// The names of all presets, for a message.
#[must_use]
pub fn names() -> String {
    PRESETS.iter().map(|(name, _)| format!("{name:?}")).collect::<Vec<_>>().join(", ")
}
