//! Helpers of the process-level tests: an isolated world per test, whose processes never outlive it.
//!
//! Contract: two tests at a time on this machine, or one that asks to be alone ([`turn`]), each with its own
//! root, number and names in /dev/shm. All processes are killed and everything is removed when the [`World`]
//! goes. Started as root, the processes run as `nobody` where that user can run the program at all; with
//! FORETRACE_TESTS_AS_ROOT=1 they stay root. Real-time rights are asked for with FORETRACE_RT_TESTS=1 only,
//! and by tests that say so.

pub mod forger;
pub mod frozen;
pub mod holder;
pub mod judge;
pub mod leftovers;
pub mod observer;
pub mod page;
mod process;
pub use process::*;
pub mod recorder;
mod stranger;
pub use stranger::*;
pub mod tool;
pub mod trespass;
pub mod turn;

use std::fs::Permissions;
use std::io::Write as _;
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

use foretrace_client::Instance;
use serde_json::Value;

use turn::Turn;

/// A busy machine starves the simulated arm, which has no rights, for longer than the preset's 50 ms. The
/// stop that this rightly latches is not what most tests are about.
pub const PATIENT: [&str; 2] = ["--set", "safety.joint_state_timeout_ms=500"];

const NOBODY: u32 = 65534;

/// A place for one test, and the processes in it.
pub struct World {
    _turn: Turn,
    program: PathBuf,
    folder: PathBuf,
    number: u32,
    user: Option<u32>,
    /// Words before the program's own, for example to run it in another mount namespace.
    through: Vec<String>,
}

impl World {
    /// Waits for this test's turn. `program`: path of the program under test.
    ///
    /// # Panics
    /// No folder can be made below /tmp.
    #[must_use]
    pub fn new(program: &str) -> Self {
        Self::made(program, is_set("FORETRACE_TESTS_AS_ROOT"), Turn::beside_another())
    }

    /// The same with no other test beside it: for tests that measure or need all cores.
    ///
    /// # Panics
    /// As above.
    #[must_use]
    pub fn alone(program: &str) -> Self {
        Self::made(program, is_set("FORETRACE_TESTS_AS_ROOT"), Turn::alone())
    }

    /// Alone, with processes that keep the user of this one, root or not.
    ///
    /// # Panics
    /// As above.
    #[must_use]
    pub fn with_rights_kept(program: &str) -> Self {
        Self::made(program, true, Turn::alone())
    }

    fn made(program: &str, keeps_rights: bool, turn: Turn) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let user = own_user();
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let folder = PathBuf::from(format!("/tmp/ftt-{}-{count}", std::process::id()));
        std::fs::create_dir(&folder).expect("a folder below /tmp");
        std::fs::set_permissions(&folder, Permissions::from_mode(0o700)).expect("own folder");
        let program = PathBuf::from(program);
        let drops = user == 0 && !keeps_rights && runs_as(&program, NOBODY);
        let user = drops.then_some(NOBODY);
        if let Some(user) = user {
            chown(&folder, Some(user), Some(user)).expect("root may give folders away");
        }
        Self { _turn: turn, program, folder, number: count % 50, user, through: Vec::new() }
    }

    /// The processes of this world have no special rights.
    #[must_use]
    pub fn is_unprivileged(&self) -> bool {
        self.user.is_some() || own_user() != 0
    }

    /// The user that the processes run as.
    #[must_use]
    pub fn user(&self) -> u32 {
        self.user.unwrap_or_else(own_user)
    }

    /// From here on, starts everything through `words`, which must run what follows them as this world's
    /// user.
    pub fn go_through(&mut self, words: Vec<String>) {
        self.through = words;
    }

    /// The folder of this test; files in it belong to the user that the processes run as.
    #[must_use]
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes a file for the processes to read.
    ///
    /// # Panics
    /// It cannot be written.
    pub fn write(&self, name: &str, text: &str) -> String {
        let path = self.file(name);
        std::fs::write(&path, text).expect("own folder");
        std::fs::set_permissions(&path, Permissions::from_mode(0o644)).expect("own file");
        path.display().to_string()
    }

    /// The options that name this test's instance; `other` tells several instances of one test apart.
    #[must_use]
    pub fn instance_options(&self, other: u32) -> Vec<String> {
        let root = self.root(other);
        vec![format!("--instance={}", self.number + other), format!("--root={}", root.display())]
    }

    /// This test's instance, for `World::state` and others that look into it.
    ///
    /// # Panics
    /// The path is illegal, which cannot happen.
    #[must_use]
    pub fn instance(&self, other: u32) -> Instance {
        Instance::at(self.number + other, self.root(other)).expect("a short plain path")
    }

    /// Starts `foretrace COMMAND... --instance ... --root ...` and leaves it running.
    #[must_use]
    pub fn start(&self, other: u32, command: &[&str]) -> Process {
        let mut options: Vec<String> = command.iter().map(|word| (*word).to_owned()).collect();
        options.extend(self.instance_options(other));
        self.start_plain(&options)
    }

    /// Starts the daemon, patient with its arm, and waits until it can be attached to.
    #[must_use]
    pub fn daemon(&self, other: u32) -> Process {
        self.daemon_with(other, &PATIENT)
    }

    /// The same with these options instead of [`PATIENT`].
    #[must_use]
    pub fn daemon_with(&self, other: u32, options: &[&str]) -> Process {
        let words: &[&str] =
            if is_set("FORETRACE_RT_TESTS") { &["daemon"] } else { &["daemon", "--no-rights"] };
        let mut daemon = self.start(other, &[words, options].concat());
        until("the daemon comes up", || {
            daemon.expect_alive();
            let asked = self.run(other, &["status"]);
            assert!(matches!(asked.status.code(), Some(0 | 1 | 3)), "{}", told(&asked));
            asked.status.success().then_some(())
        });
        daemon
    }

    /// Starts a simulated arm and waits until the daemon can be armed, then arms it. When it ends, every
    /// command that it got must have been legal.
    #[must_use]
    pub fn armed_arm(&self, other: u32, options: &[&str]) -> Process {
        let wanted = options.iter().skip_while(|word| **word != "--json").nth(1).map(PathBuf::from);
        let report = wanted.unwrap_or_else(|| self.file(&format!("armed-{other}.json")));
        let file = report.display().to_string();
        let mut words = [&["arm", "sim"], options].concat();
        if !options.contains(&"--json") {
            words.extend(["--json", &file]);
        }
        let mut arm = self.start(other, &words).reporting_to(report);
        self.arm(other, &mut arm);
        arm
    }

    /// Asks to arm until the daemon does.
    pub fn arm(&self, other: u32, arm: &mut Process) {
        until("the daemon arms", || {
            arm.expect_alive();
            let asked = self.run(other, &["request", "arm"]);
            // A transient refusal, or no answer yet; other errors are final.
            assert!(matches!(asked.status.code(), Some(0 | 1 | 4)), "{}", told(&asked));
            asked.status.success().then_some(())
        });
    }

    /// Runs `foretrace COMMAND...` on this test's instance to its end.
    #[must_use]
    pub fn run(&self, other: u32, command: &[&str]) -> Output {
        self.start(other, command).output()
    }

    /// Runs `foretrace ARGUMENTS...` as they are to its end.
    #[must_use]
    pub fn run_plain(&self, arguments: &[&str]) -> Output {
        let words: Vec<String> = arguments.iter().map(|word| (*word).to_owned()).collect();
        self.start_plain(&words).output()
    }

    /// The output of `foretrace status --json -`.
    ///
    /// # Panics
    /// It says nothing.
    #[must_use]
    pub fn status(&self, other: u32) -> Value {
        let output = self.run(other, &["status", "--json", "-"]);
        assert!(output.status.success(), "{}", told(&output));
        serde_json::from_slice(&output.stdout).expect("stdout carries JSON only")
    }

    /// Waits until the daemon is in `mode`.
    pub fn wait_for_mode(&self, other: u32, mode: &str) {
        let mut seen = Value::Null;
        until(&format!("mode {mode}"), || {
            seen = self.status(other)["mode"].clone();
            (seen == mode).then_some(())
        });
    }

    /// Starts a command that belongs to no instance.
    ///
    /// # Panics
    /// The program cannot be started.
    #[must_use]
    pub fn start_plain(&self, arguments: &[String]) -> Process {
        self.start_as(self.user, arguments)
    }

    fn start_as(&self, user: Option<u32>, arguments: &[String]) -> Process {
        let mut command = match self.through.split_first() {
            Some((first, rest)) => {
                let mut command = Command::new(first);
                command.args(rest).arg(&self.program);
                command
            }
            None => Command::new(&self.program),
        };
        command.args(arguments).current_dir(&self.folder);
        command.env_remove("XDG_RUNTIME_DIR").env("HOME", &self.folder);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // With a prefix, the prefix changes the user.
        if let Some(user) = user
            && self.through.is_empty()
        {
            command.uid(user).gid(user);
        }
        let words = arguments.join(" ");
        Process::new(command.spawn().expect("the program under test starts"), words)
    }

    fn root(&self, other: u32) -> PathBuf {
        self.folder.join(format!("r{other}"))
    }
}

impl Drop for World {
    fn drop(&mut self) {
        for other in 0..2 {
            let prefix = self.instance(other).prefix().to_owned();
            for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
                if entry.file_name().to_string_lossy().starts_with(&prefix) {
                    let _ = std::fs::remove_file(entry.path());
                }
            }
        }
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// The shared data folder with recorded handwriting, if this machine has it; says so if not.
#[must_use]
pub fn shared_data(name: &str) -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared");
    let shared = std::env::var_os("FORETRACE_SHARED").map_or_else(|| PathBuf::from(beside), PathBuf::from);
    let folder = shared.join("data").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    skipped(&format!("{} is not there (set FORETRACE_SHARED)", folder.display()));
    None
}

/// Says that a test, or a part of it, was left out, past the test runner's capture: a skipped test must be
/// seen.
pub fn skipped(why: &str) {
    let _ = writeln!(std::io::stderr(), "skipped: {why}");
}

fn is_set(variable: &str) -> bool {
    std::env::var_os(variable).is_some_and(|value| value == "1")
}

fn own_user() -> u32 {
    std::fs::metadata("/proc/self").map_or(0, |found| found.uid())
}

/// This user can reach and run the program.
fn runs_as(program: &Path, user: u32) -> bool {
    let mut command = Command::new(program);
    command.arg("--version").uid(user).gid(user).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// The instance that a role's options `--instance=N --root=DIR` name.
fn instance_of(arguments: &[String]) -> Result<Instance, Box<dyn std::error::Error>> {
    let option = |name: &str| arguments.iter().find_map(|argument| argument.strip_prefix(name));
    let number = option("--instance=").ok_or("--instance is missing")?.parse()?;
    Ok(Instance::at(number, option("--root=").ok_or("--root is missing")?)?)
}
