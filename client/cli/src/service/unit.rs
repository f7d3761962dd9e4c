//! The text of the unit.

use std::path::Path;

use foretrace_config::Config;

use super::host::Host;
use crate::failure::Failure;
use crate::version;

/// What the shipped unit starts.
const SHIPPED_START: &str = "ExecStart=/usr/local/bin/foretraced --preset ur5";
const SYSTEM: &str = include_str!("../../../../daemon/systemd/foretraced.service");
const USER: &str = include_str!("user.service");
/// First line of a file that this program wrote.
pub(super) const MARK: &str = "# Written by `foretrace service install`";

/// A unit for this program with these settings.
#[derive(Debug)]
pub(super) struct ServiceUnit(String);

impl ServiceUnit {
    /// # Errors
    /// Settings that are wrong, or a program or file that the service could not read.
    pub(super) fn new(host: &Host, config: Option<&Path>, preset: &str) -> Result<Self, Failure> {
        let program = host.program()?;
        host.reachable(&program)?;
        let settings = match config {
            None => format!("--preset {preset}"),
            Some(file) => {
                Config::load(file).map_err(|error| crate::settings::wrong(&error))?;
                let file = std::fs::canonicalize(file).map_err(|error| {
                    Failure::bad_input(format_args!("{}: {error}", file.display()), "give a settings file")
                })?;
                host.reachable(&file)?;
                format!("--config {}", word(&file)?)
            }
        };
        let start = format!("{} daemon {settings}", word(&program)?);
        Ok(Self::text_of(host.user, &start))
    }

    fn text_of(user: bool, start: &str) -> Self {
        let mark = format!("{MARK} ({}); `foretrace service remove` removes it.\n", version::program());
        let (comments, text) = if user {
            (0, USER.replace("@ExecStart@", start))
        } else {
            // The shipped unit begins with how to install it by hand.
            let comments = SYSTEM.find("[Unit]").unwrap_or(0);
            (comments, SYSTEM.replace(SHIPPED_START, &format!("ExecStart={start}")))
        };
        Self(mark + text.get(comments..).unwrap_or_default())
    }

    pub(super) fn text(&self) -> &str {
        &self.0
    }
}

/// A path as one word of ExecStart=, where quotes, `\`, `%` and `$` mean something.
fn word(path: &Path) -> Result<String, Failure> {
    let text = path.to_str().filter(|text| !text.chars().any(char::is_control)).ok_or_else(|| {
        Failure::bad_input(format_args!("{path:?} has signs that no unit can name"), "give another path")
    })?;
    let escaped = text.replace('\\', "\\\\").replace('"', "\\\"").replace('%', "%%").replace('$', "$$");
    Ok(if escaped.contains([' ', '\'', '"', '\\', ';']) { format!("\"{escaped}\"") } else { escaped })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_unit_is_the_shipped_one_with_another_start() {
        let ServiceUnit(text) = ServiceUnit::text_of(false, "/opt/foretrace daemon --preset ur5e");
        assert!(text.starts_with(MARK) && text.contains("\nExecStart=/opt/foretrace daemon --preset ur5e\n"));
        assert!(
            !text.contains("/usr/local/bin")
                && text.contains("User=foretrace")
                && text.contains("ProtectHome=yes")
        );
        let of = |text: &str| text.lines().filter(|line| line.contains('=')).count();
        assert_eq!(of(&text), of(&SYSTEM[SYSTEM.find("[Unit]").unwrap()..]));
    }

    #[test]
    fn the_users_unit_needs_no_rights_of_the_system() {
        let ServiceUnit(text) = ServiceUnit::text_of(true, "/opt/foretrace daemon --preset ur5");
        assert!(text.contains("WantedBy=default.target") && text.contains("WatchdogSec=2"));
        assert!(!text.contains("User=") && !text.contains("CapabilityBoundingSet") && !text.contains('@'));
    }

    #[test]
    fn signs_that_mean_something_to_systemd_are_escaped() {
        assert_eq!(word(Path::new("/a/b.toml")).unwrap(), "/a/b.toml");
        assert_eq!(word(Path::new("/a b/100%$x\".toml")).unwrap(), "\"/a b/100%%$$x\\\".toml\"");
        assert!(word(Path::new("/a\nExecStartPre=/bin/sh")).is_err());
    }
}
