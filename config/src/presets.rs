//! Presets and robots that are part of the program.

/// Name and text of every preset.
const PRESETS: &[(&str, &str)] = &[
    ("ur5", include_str!("../presets/ur5.toml")),
    ("ur5e", include_str!("../presets/ur5e.toml")),
    ("ur5-first-run", include_str!("../presets/ur5-first-run.toml")),
];

/// Name and text of every robot.
const ROBOTS: &[(&str, &str)] =
    &[("ur5", include_str!("../robots/ur5.urdf")), ("ur5e", include_str!("../robots/ur5e.urdf"))];

/// The text of a preset, with its comments, as it stands; it may name another preset that it is put over.
#[must_use]
pub fn text(name: &str) -> Option<&'static str> {
    PRESETS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// The names of all presets, for a message.
#[must_use]
pub fn names() -> String {
    PRESETS.iter().map(|(name, _)| format!("{name:?}")).collect::<Vec<_>>().join(", ")
}

/// The URDF of an embedded robot.
#[must_use]
pub fn robot(name: &str) -> Option<&'static str> {
    ROBOTS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// The names of all embedded robots, for a message.
#[must_use]
pub fn robot_names() -> String {
    ROBOTS.iter().map(|(name, _)| format!("{name:?}")).collect::<Vec<_>>().join(", ")
}
