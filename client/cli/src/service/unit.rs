//! The text of the unit.

use std::path::Path;

use foretrace_config::Draft;
use foretrace_config::files::Files;

use super::host::{FileUse, Host};
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
        host.reachable(&program, FileUse::Run)?;
        let settings = settings_words(host, config, preset)?;
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

/// The words of the command line that name the settings.
fn settings_words(host: &Host, config: Option<&Path>, preset: &str) -> Result<String, Failure> {
    let Some(file) = config else { return Ok(format!("--preset {preset}")) };
    let file = std::fs::canonicalize(file).map_err(|error| {
        Failure::bad_input(format_args!("{}: {error}", file.display()), "give a settings file")
    })?;
    let files = Files::kept();
    Draft::file_of(&file, files.clone()).finish().map_err(|error| crate::settings::wrong(&error))?;
    // The robot and the networks that they name are read by the service, too.
    let named = files.taken().into_keys();
    [file.clone()].into_iter().chain(named).try_for_each(|file| seen(host, &file))?;
    Ok(format!("--config {}", argument(&file)?))
}

/// Refuses what the service could not read, where it lies and where its links lead.
fn seen(host: &Host, file: &Path) -> Result<(), Failure> {
    let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    host.reachable(&file, FileUse::Read)?;
    let whole = std::fs::canonicalize(&file).unwrap_or(file);
    host.reachable(&whole, FileUse::Read)
}

/// A path as the first word of ExecStart=, where quotes, `\` and `%` mean something.
fn word(path: &Path) -> Result<String, Failure> {
    let text = path.to_str().filter(|text| !text.chars().any(char::is_control)).ok_or_else(|| {
        Failure::bad_input(format_args!("{path:?} has signs that no unit can name"), "give another path")
    })?;
    let escaped = text.replace('\\', "\\\\").replace('"', "\\\"").replace('%', "%%");
    Ok(if escaped.contains([' ', '\'', '"', '\\', ';']) { format!("\"{escaped}\"") } else { escaped })
}

/// A path as a word behind it, where `$` means something as well.
fn argument(path: &Path) -> Result<String, Failure> {
    word(path).map(|word| word.replace('$', "$$"))
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
        assert_eq!(argument(Path::new("/a b/100%$x\".toml")).unwrap(), "\"/a b/100%%$$x\\\".toml\"");
        // No variable stands in the name of a program, so that its `$` is one.
        assert_eq!(word(Path::new("/opt/$x/100%")).unwrap(), "/opt/$x/100%%");
        assert!(word(Path::new("/a\nExecStartPre=/bin/sh")).is_err());
    }

    #[test]
    fn files_that_the_settings_name_must_be_seen_by_the_service() {
        use std::os::unix::fs::PermissionsExt as _;
        // One that a service sees, and one that it does not.
        let [open, hidden] = ["/dev/shm", "/tmp"].map(|place| tempfile::tempdir_in(place).unwrap());
        std::fs::set_permissions(open.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
        let urdf = foretrace_config::presets::robot("ur5").unwrap();
        let [own, other] = [&open, &hidden].map(|folder| folder.path().join("robot.urdf"));
        let table = open.path().join("table.toml");
        let readable = |file: &Path, text: &str| {
            std::fs::write(file, text).unwrap();
            std::fs::set_permissions(file, std::fs::Permissions::from_mode(0o644)).unwrap();
        };
        readable(&own, urdf);
        readable(&other, urdf);
        let words = |user: bool, robot: &Path| {
            readable(
                &table,
                &format!("preset = \"ur5\"\n[robot]\nurdf = {robot:?}\ntool_m = [0, 0, 0.15]\n"),
            );
            settings_words(&Host::of_this_machine(user).unwrap(), Some(&table), "ur5")
        };
        assert_eq!(words(false, &own).unwrap(), format!("--config {}", table.display()));
        let said = words(false, &other).unwrap_err().to_string();
        assert!(said.contains(&other.display().to_string()) && said.contains("does not see it"), "{said}");
        assert!(words(true, &other).is_ok());
        std::fs::set_permissions(&own, std::fs::Permissions::from_mode(0o600)).unwrap();
        let said = words(false, &own).unwrap_err().to_string();
        assert!(said.contains("robot.urdf (mode 600)"), "{said}");
        // A link is no way out.
        let link = open.path().join("link.urdf");
        std::os::unix::fs::symlink(&other, &link).unwrap();
        assert!(words(false, &link).is_err());
    }
}
