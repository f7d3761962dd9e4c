//! The machine's side: where units lie, who may write them, and systemctl.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

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

/// What the service does with a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FileUse {
    Read,
    Run,
}

/// The numbers of a user and of all its groups.
#[derive(Debug, Clone, PartialEq, Eq)]
struct SystemUser {
    user: u32,
    groups: Vec<u32>,
}

/// What decides whether the service can be changed.
#[derive(Debug, Clone, Copy)]
struct ServiceMachine {
    systemd: bool,
    root: bool,
    /// A package's unit of the same name is there.
    packaged: bool,
    /// The system user is there.
    user: bool,
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

    /// Refuses a file that the system unit does not see, or that its user may not use so.
    pub(super) fn reachable(&self, file: &Path, wanted: FileUse) -> Result<(), Failure> {
        if self.user {
            return Ok(());
        }
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let remedy = match wanted {
            FileUse::Read => {
                format!("sudo install -D -m 644 {} /etc/foretrace/{name}, and give that", file.display())
            }
            FileUse::Run => {
                format!(
                    "sudo install -m 755 {} /usr/local/bin/, and run that; or give --user",
                    file.display()
                )
            }
        };
        if HIDDEN.iter().any(|home| file.starts_with(home)) {
            let what = format_args!("{} lies where the service does not see it", file.display());
            return Err(Failure::bad_input(what, remedy));
        }
        usable(file, wanted, the_system_user().as_ref()).map_err(|why| Failure::bad_input(why, remedy))
    }

    /// Refuses where the service cannot be changed.
    pub(super) fn ready(&self, installing: bool) -> Result<(), Failure> {
        self.judged(
            installing,
            ServiceMachine {
                systemd: Path::new("/run/systemd/system").is_dir(),
                root: rustix::process::geteuid().is_root(),
                packaged: PACKAGED.iter().any(|folder| Path::new(folder).join(NAME).exists()),
                user: the_system_user().is_some(),
            },
        )
    }

    /// What is there to be removed goes also where it could not be installed now.
    fn judged(&self, installing: bool, machine: ServiceMachine) -> Result<(), Failure> {
        let refused = |what: &str, remedy: &str| Err(Failure::new(Cause::Refused, what, remedy));
        if !machine.systemd {
            return refused(
                "systemd does not run on this machine",
                "start `foretrace daemon` by what starts services here",
            );
        }
        if !self.user && !machine.root {
            return refused("a service of the system needs root", "run it with sudo, or give --user");
        }
        if !installing {
            return self.ours();
        }
        if !self.user && machine.packaged {
            return refused(
                "a package has brought the unit foretraced.service already",
                "sudo systemctl enable --now foretraced",
            );
        }
        if !self.user && !machine.user {
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

    /// Whether the daemon of the unit runs now.
    pub(super) fn active(&self) -> bool {
        succeeds(&self.systemctl(&["is-active", "--quiet", NAME]))
    }

    /// A daemon that is `active` may move an arm at this moment: it is left alone.
    pub(super) fn install_steps(&self, active: bool) -> Vec<ServiceStep> {
        let enable = if active { self.systemctl(&["enable", NAME]) } else { self.start() };
        vec![self.systemctl(&["daemon-reload"]), enable]
    }

    fn start(&self) -> ServiceStep {
        self.systemctl(&["enable", "--now", NAME])
    }

    /// What is said of the daemon once the unit is installed.
    pub(super) fn outcome(&self, active: bool) -> String {
        if !active {
            return format!("The daemon runs, idle. Look at it: {}", self.status_command());
        }
        format!(
            "The daemon of before goes on, with its old program and settings. For the new ones disarm first \
             (foretrace request disarm), then: {}{}",
            if self.user { "" } else { "sudo " },
            self.systemctl(&["restart", NAME]).words()
        )
    }

    /// Before and after the file is removed.
    pub(super) fn remove_steps(&self) -> (Vec<ServiceStep>, Vec<ServiceStep>) {
        (vec![self.systemctl(&["disable", "--now", NAME])], vec![self.systemctl(&["daemon-reload"])])
    }

    fn status_command(&self) -> &'static str {
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
            let journal = if self.user { "journalctl --user" } else { "journalctl" };
            let remedy = format_args!("see {journal} -u foretraced -e, correct it, then again");
            return Err(Failure::failed(what, remedy));
        }
        Ok(())
    }
}

/// Whether a command can be run, and ends well; its words are lost.
fn succeeds(step: &ServiceStep) -> bool {
    let Some((program, words)) = step.0.split_first() else { return false };
    let mut command = Command::new(program);
    command.args(words).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

fn the_system_user() -> Option<SystemUser> {
    let read = |file: &str| fs::read(file).unwrap_or_default();
    let (passwd, group) = (read("/etc/passwd"), read("/etc/group"));
    system_user(&String::from_utf8_lossy(&passwd), &String::from_utf8_lossy(&group))
}

/// The user of the service, as `/etc/passwd` and `/etc/group` have it.
fn system_user(passwd: &str, group: &str) -> Option<SystemUser> {
    let (user, own) = passwd.lines().find_map(|line| {
        let mut fields = line.split(':');
        (fields.next() == Some("foretrace")).then_some(())?;
        Some((fields.nth(1)?.parse().ok()?, fields.next()?.parse().ok()?))
    })?;
    let further = group.lines().filter_map(|line| {
        let mut fields = line.split(':').skip(2);
        let number = fields.next()?.parse().ok()?;
        fields.next()?.split(',').any(|member| member == "foretrace").then_some(number)
    });
    Some(SystemUser { user, groups: [own].into_iter().chain(further).collect() })
}

/// Whether `user`, or everybody where there is none yet, may use `file` so, and get through its folders, as
/// far as modes tell: access lists may say otherwise.
fn usable(file: &Path, wanted: FileUse, user: Option<&SystemUser>) -> Result<(), String> {
    let may = |path: &Path, bit: u32| {
        let about = fs::metadata(path).map_err(|error| format!("{}: {error}", path.display()))?;
        let shift = match user {
            Some(SystemUser { user, .. }) if about.uid() == *user => 6,
            Some(SystemUser { groups, .. }) if groups.contains(&about.gid()) => 3,
            _ => 0,
        };
        if (about.mode() >> shift) & bit == bit {
            return Ok(());
        }
        let mode = about.mode() & 0o7777;
        let what = match (about.is_dir(), wanted) {
            (true, _) => "does not let the user foretrace through",
            (false, FileUse::Read) => "may not be read by the user foretrace",
            (false, FileUse::Run) => "may not be run by the user foretrace",
        };
        Err(format!("{} (mode {mode:03o}) {what}, as far as modes tell", path.display()))
    };
    file.ancestors().skip(1).filter(|folder| !folder.as_os_str().is_empty()).try_for_each(|f| may(f, 1))?;
    may(file, if wanted == FileUse::Run { 1 } else { 4 })
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
        assert_eq!(user.install_steps(false)[1].words(), "systemctl --user enable --now foretraced.service");
        assert_eq!(system.remove_steps().0[0].words(), "systemctl disable --now foretraced.service");
        let wrong = ServiceStep(["false", "x"].map(str::to_owned).to_vec());
        let said = user.run(std::slice::from_ref(&wrong)).unwrap_err().to_string();
        assert!(said.starts_with("false x: exit status: 1"), "{said}");
        assert!(said.contains("journalctl --user -u foretraced"), "{said}");
        let said = system.run(&[wrong]).unwrap_err().to_string();
        assert!(said.contains("journalctl -u foretraced"), "{said}");
    }

    #[test]
    fn a_daemon_that_runs_is_left_alone_and_told_of() {
        let (user, system) = (host(Path::new("/x")), Host { user: false, units: "/x".into() });
        for (host, prefix) in [(&user, "systemctl --user "), (&system, "systemctl ")] {
            let words: Vec<_> = host.install_steps(true).iter().map(ServiceStep::words).collect();
            assert_eq!(
                words,
                [format!("{prefix}daemon-reload"), format!("{prefix}enable foretraced.service")]
            );
            assert!(host.outcome(false).starts_with("The daemon runs, idle."));
            let said = host.outcome(true);
            assert!(said.contains("old program and settings") && !said.contains("runs, idle"), "{said}");
            assert!(said.find("disarm") < said.find(&format!("{prefix}restart")), "{said}");
        }
        let step = |words: &[&str]| ServiceStep(words.iter().map(|word| (*word).to_owned()).collect());
        assert!(succeeds(&step(&["true"])));
        assert!(!succeeds(&step(&["false"])) && !succeeds(&step(&["/nowhere/systemctl"])));
    }

    #[test]
    fn reasons_against_an_installation_do_not_keep_one_from_going() {
        let folder = tempfile::tempdir().unwrap();
        let system = Host { user: false, units: folder.path().to_owned() };
        let good = ServiceMachine { systemd: true, root: true, packaged: false, user: true };
        assert!(system.judged(true, good).is_ok());
        // There is nothing to remove yet.
        assert!(system.judged(false, good).is_err());
        system.write(&format!("{MARK} (0)\n[Unit]\n")).unwrap();
        for (bad, word) in [
            (ServiceMachine { packaged: true, ..good }, "package"),
            (ServiceMachine { user: false, ..good }, "no system user"),
        ] {
            let said = system.judged(true, bad).unwrap_err().to_string();
            assert!(said.contains(word), "{said}");
            assert!(system.judged(false, bad).is_ok(), "{word}");
        }
        for bad in [ServiceMachine { systemd: false, ..good }, ServiceMachine { root: false, ..good }] {
            assert!(system.judged(true, bad).is_err() && system.judged(false, bad).is_err(), "{bad:?}");
        }
        let user = host(folder.path());
        assert!(
            user.judged(true, ServiceMachine { root: false, packaged: true, user: false, ..good }).is_ok()
        );
    }

    #[test]
    fn what_lies_where_the_service_does_not_look_is_refused() {
        let system = Host { user: false, units: "/x".into() };
        for folder in HIDDEN {
            let program = Path::new(folder).join("cargo/bin/foretrace");
            let said = system.reachable(&program, FileUse::Run).unwrap_err().to_string();
            assert!(said.contains("does not see it"), "{said}");
            assert!(said.contains("/usr/local/bin") && said.contains("--user"), "{said}");
            let settings = Path::new(folder).join("a/table.toml");
            let said = system.reachable(&settings, FileUse::Read).unwrap_err().to_string();
            assert!(said.contains("/etc/foretrace/table.toml"), "{said}");
            assert!(host(Path::new("/x")).reachable(&program, FileUse::Run).is_ok());
        }
        // A name that begins alike is another folder.
        let said = system.reachable(Path::new("/homework/foretrace"), FileUse::Run).unwrap_err().to_string();
        assert!(!said.contains("does not see it"), "{said}");
        assert!(system.reachable(Path::new("/bin/sh"), FileUse::Run).is_ok());
    }

    #[test]
    fn the_service_s_user_must_be_able_to_use_a_file_and_pass_its_folders() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("table.toml");
        fs::write(&file, "").unwrap();
        let set = |path: &Path, mode| fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
        let about = fs::metadata(&file).unwrap();
        let other = SystemUser { user: about.uid() + 1, groups: vec![about.gid() + 1] };
        let owner = SystemUser { user: about.uid(), ..other.clone() };
        let group = SystemUser { groups: vec![about.gid()], ..other.clone() };
        let further = SystemUser { groups: vec![about.gid() + 1, about.gid()], ..other.clone() };
        set(folder.path(), 0o755);
        for (mode, user, wanted, may) in [
            (0o644, Some(&other), FileUse::Read, true),
            (0o600, Some(&other), FileUse::Read, false),
            (0o600, None, FileUse::Read, false),
            (0o600, Some(&owner), FileUse::Read, true),
            (0o640, Some(&group), FileUse::Read, true),
            (0o604, Some(&group), FileUse::Read, false),
            (0o640, Some(&further), FileUse::Read, true),
            (0o604, Some(&further), FileUse::Read, false),
            (0o644, Some(&other), FileUse::Run, false),
            (0o711, Some(&other), FileUse::Run, true),
            (0o700, Some(&other), FileUse::Run, false),
        ] {
            set(&file, mode);
            let found = usable(&file, wanted, user);
            assert_eq!(found.is_ok(), may, "{mode:o} {user:?} {wanted:?}: {found:?}");
        }
        set(&file, 0o644);
        set(folder.path(), 0o700);
        let said = usable(&file, FileUse::Read, Some(&other)).unwrap_err();
        assert!(said.contains("mode 700") && said.contains("through"), "{said}");
        assert!(said.ends_with("as far as modes tell"), "{said}");
        set(folder.path(), 0o755);
        assert!(usable(Path::new("/nowhere/table.toml"), FileUse::Read, None).is_err());
        let passwd = "root:x:0:0\nforetracer:x:1:1:\nforetrace:x:998:997::/:/usr/sbin/nologin";
        let group = "foretrace:x:997:\nvideo:x:44:ann,foretrace\nforetracers:x:45:foretracer\nbroken\n\
                     x:y:z:foretrace";
        assert_eq!(system_user(passwd, group), Some(SystemUser { user: 998, groups: vec![997, 44] }));
        assert_eq!(system_user(passwd, ""), Some(SystemUser { user: 998, groups: vec![997] }));
        assert_eq!(system_user("foretracer:x:1:1:", group), None);
    }
}
