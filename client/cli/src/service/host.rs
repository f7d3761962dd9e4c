//! The machine's side: where units lie, who may write them, and systemctl.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::unit::MARK;
use crate::failure::{Cause, Failure};
use crate::output::write_file;

const NAME: &str = "foretraced.service";
/// Where packages put their units.
const PACKAGED: [&str; 2] = ["/usr/lib/systemd/system", "/lib/systemd/system"];
/// Folders that the system unit does not see (ProtectHome=, PrivateTmp=).
const HIDDEN: [&str; 5] = ["/home", "/root", "/run/user", "/tmp", "/var/tmp"];

/// A command that is run, word for word.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ServiceStep(Vec<String>);

impl ServiceStep {
    pub(super) fn words(&self) -> String {
        self.0.join(" ")
    }
}

/// Where the service is to be.
#[derive(Debug)]
pub(super) struct Host {
    /// A service of the user, and not of the system.
    pub(super) user: bool,
    units: PathBuf,
}

impl Host {
    /// # Errors
    /// A user without a home.
    pub(super) fn of_this_machine(user: bool) -> Result<Self, Failure> {
        if !user {
            return Ok(Self { user, units: PathBuf::from("/etc/systemd/system") });
        }
        let named =
            |variable: &str| std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute());
        let settings = named("XDG_CONFIG_HOME").or_else(|| Some(named("HOME")?.join(".config")));
        let settings = settings.ok_or_else(|| {
            Failure::failed(
                "neither XDG_CONFIG_HOME nor HOME names a folder",
                "set HOME, or leave --user out",
            )
        })?;
        Ok(Self { user, units: settings.join("systemd/user") })
    }

    pub(super) fn unit_file(&self) -> PathBuf {
        self.units.join(NAME)
    }

    /// The file of this program.
    pub(super) fn program(&self) -> Result<PathBuf, Failure> {
        let told = std::env::current_exe().and_then(fs::canonicalize);
        told.map_err(|error| {
            Failure::failed(format_args!("where this program lies is not told: {error}"), "")
        })
    }

    /// Refuses a file that the system unit cannot read.
    pub(super) fn reachable(&self, file: &Path) -> Result<(), Failure> {
        if self.user || !HIDDEN.iter().any(|home| file.starts_with(home)) {
            return Ok(());
        }
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let what = format_args!("{} lies where the service does not see it", file.display());
        let remedy = if file.extension().is_some_and(|ending| ending == "toml") {
            format!("sudo install -D -m 644 {} /etc/foretrace/{name}, and give that", file.display())
        } else {
            format!("sudo install -m 755 {} /usr/local/bin/, and run that; or give --user", file.display())
        };
        Err(Failure::bad_input(what, remedy))
    }

    /// Refuses where the service cannot be changed.
    pub(super) fn ready(&self) -> Result<(), Failure> {
        let refused = |what: &str, remedy: &str| Err(Failure::new(Cause::Refused, what, remedy));
        if !Path::new("/run/systemd/system").is_dir() {
            return refused(
                "systemd does not run on this machine",
                "start `foretrace daemon` by what starts services here",
            );
        }
        if self.user {
            return self.replaceable();
        }
        if !rustix::process::geteuid().is_root() {
            return refused("a service of the system needs root", "run it with sudo, or give --user");
        }
        if PACKAGED.iter().any(|folder| Path::new(folder).join(NAME).exists()) {
            return refused(
                "a package has brought the unit foretraced.service already",
                "sudo systemctl enable --now foretraced",
            );
        }
        if !has_user(&fs::read_to_string("/etc/passwd").unwrap_or_default()) {
            return refused(
                "there is no system user foretrace for the service to run as",
                "sudo useradd --system --no-create-home --shell /usr/sbin/nologin foretrace",
            );
        }
        self.replaceable()
    }

    /// The file may be written: there is none, or one that this program wrote.
    fn replaceable(&self) -> Result<(), Failure> {
        if self.unit_file().symlink_metadata().is_err_and(|error| error.kind() == ErrorKind::NotFound) {
            return Ok(());
        }
        self.ours()
    }

    /// The file was written by this program.
    pub(super) fn ours(&self) -> Result<(), Failure> {
        let file = self.unit_file();
        let text = foretrace_config::files::read_text(&file, 1 << 20).map_err(|error| {
            let remedy = "foretrace service install writes it; with --user, or without, as it was installed";
            Failure::new(Cause::Refused, format_args!("{}: {error}", file.display()), remedy)
        })?;
        if text.starts_with(MARK) {
            return Ok(());
        }
        let what = format_args!("{} was not written by foretrace service install", file.display());
        Err(Failure::new(Cause::Refused, what, "change or remove it yourself"))
    }

    pub(super) fn write(&self, text: &str) -> Result<(), Failure> {
        fs::create_dir_all(&self.units).map_err(|error| {
            Failure::failed(format_args!("cannot make {}: {error}", self.units.display()), "")
        })?;
        write_file(&self.unit_file(), text, "unit")
    }

    pub(super) fn delete(&self) -> Result<(), Failure> {
        self.ours()?;
        let file = self.unit_file();
        fs::remove_file(&file)
            .map_err(|error| Failure::failed(format_args!("cannot remove {}: {error}", file.display()), ""))
    }

    pub(super) fn install_steps(&self) -> Vec<ServiceStep> {
        vec![self.systemctl(&["daemon-reload"]), self.systemctl(&["enable", "--now", NAME])]
    }

    /// Before and after the file is removed.
    pub(super) fn remove_steps(&self) -> (Vec<ServiceStep>, Vec<ServiceStep>) {
        (vec![self.systemctl(&["disable", "--now", NAME])], vec![self.systemctl(&["daemon-reload"])])
    }

    pub(super) fn status_command(&self) -> &'static str {
        if self.user {
            return "foretrace status --watch";
        }
        "sudo -u foretrace XDG_RUNTIME_DIR=/run/foretrace foretrace status --watch"
    }

    fn systemctl(&self, words: &[&str]) -> ServiceStep {
        let user = self.user.then_some("--user");
        ServiceStep(
            ["systemctl"].into_iter().chain(user).chain(words.iter().copied()).map(str::to_owned).collect(),
        )
    }

    /// Runs the steps in turn.
    pub(super) fn run(&self, steps: &[ServiceStep]) -> Result<(), Failure> {
        for step in steps {
            let Some((program, words)) = step.0.split_first() else { continue };
            let ended = Command::new(program).args(words).status();
            let why = match ended {
                Ok(status) if status.success() => continue,
                Ok(status) => status.to_string(),
                Err(error) => error.to_string(),
            };
            let what = format_args!("{}: {why}", step.words());
            return Err(Failure::failed(what, "see journalctl -u foretraced -e, correct it, then again"));
        }
        Ok(())
    }
}

fn has_user(passwd: &str) -> bool {
    passwd.lines().any(|line| line.split(':').next() == Some("foretrace"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn host(units: &Path) -> Host {
        Host { user: true, units: units.to_owned() }
    }

    #[test]
    fn only_a_file_with_the_mark_is_replaced_or_removed() {
        let folder = tempfile::tempdir().unwrap();
        let units = folder.path().join("systemd/user");
        let host = host(&units);
        assert!(host.replaceable().is_ok());
        assert!(host.ours().unwrap_err().to_string().contains("foretrace service install writes it"));
        host.write(&format!("{MARK} (0)\n[Unit]\n")).unwrap();
        assert!(host.replaceable().is_ok());
        host.delete().unwrap();
        assert!(!host.unit_file().exists());
        fs::write(host.unit_file(), "[Unit]\nDescription=mine\n").unwrap();
        for refused in [host.replaceable(), host.delete()] {
            let failure = refused.unwrap_err();
            assert_eq!(failure.cause, Cause::Refused);
            assert!(failure.to_string().contains("not written by"), "{failure}");
        }
        assert!(host.unit_file().exists());
        fs::remove_file(host.unit_file()).unwrap();
        // A link into nowhere is a file of somebody else, too.
        std::os::unix::fs::symlink("/nowhere", host.unit_file()).unwrap();
        assert!(host.replaceable().is_err());
    }

    #[test]
    fn the_steps_name_the_right_manager_and_a_failing_step_is_named() {
        let (user, system) = (host(Path::new("/x")), Host { user: false, units: "/x".into() });
        assert_eq!(user.install_steps()[1].words(), "systemctl --user enable --now foretraced.service");
        assert_eq!(system.remove_steps().0[0].words(), "systemctl disable --now foretraced.service");
        let wrong = ServiceStep(["false", "x"].map(str::to_owned).to_vec());
        assert!(user.run(&[wrong]).unwrap_err().to_string().starts_with("false x: exit status: 1"));
    }

    #[test]
    fn what_lies_in_a_home_is_no_program_of_the_system() {
        let system = Host { user: false, units: "/x".into() };
        let said = system.reachable(Path::new("/root/.cargo/bin/foretrace")).unwrap_err().to_string();
        assert!(said.contains("/usr/local/bin") && said.contains("--user"), "{said}");
        let said = system.reachable(Path::new("/home/a/table.toml")).unwrap_err().to_string();
        assert!(said.contains("/etc/foretrace/table.toml"), "{said}");
        assert!(system.reachable(Path::new("/usr/bin/foretrace")).is_ok());
        assert!(host(Path::new("/x")).reachable(Path::new("/root/.cargo/bin/foretrace")).is_ok());
        assert!(
            has_user("root:x:0:\nforetrace:x:998:998::/:/usr/sbin/nologin") && !has_user("foretracer:x:1:")
        );
    }
}
