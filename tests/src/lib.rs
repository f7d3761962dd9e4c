//! Helpers of the process-level tests: a world of its own per test, and processes that never outlive it.
//!
//! Contract: one test at a time on this machine (file lock), each with its own root, number and names in /dev/shm. All
//! processes are killed and everything is removed when the [`World`] goes. Started as root, the processes run as `nobody`
//! where that user can run the program at all. Nothing here asks for real-time rights unless FORETRACE_RT_TESTS=1.

pub mod observer;
mod stranger;
pub use stranger::*;
pub mod trespass;

use std::fs::{File, Permissions};
use std::io::{Read, Write as _};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use foretrace_client::Instance;
use serde_json::Value;

/// A busy machine takes seconds for what usually takes milliseconds; only a hang lasts longer than this.
const PATIENCE: Duration = Duration::from_secs(60);
const NOBODY: u32 = 65534;

/// A place for one test, and the processes in it.
pub struct World {
    _turn: File,
    program: PathBuf,
    folder: PathBuf,
    number: u32,
    user: Option<u32>,
}

impl World {
    /// Waits for this test's turn. `program`: path of the program under test.
    ///
    /// # Panics
    /// No folder can be made below /tmp.
    #[must_use]
    pub fn new(program: &str) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let user = own_user();
        let lock = std::env::temp_dir().join(format!("foretrace-tests-{user}.lock"));
        let turn = File::create(lock).expect("a lock file in the temporary directory");
        turn.lock().expect("a file lock");
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let folder = PathBuf::from(format!("/tmp/ftt-{}-{count}", std::process::id()));
        std::fs::create_dir(&folder).expect("a folder below /tmp");
        std::fs::set_permissions(&folder, Permissions::from_mode(0o700)).expect("own folder");
        let program = PathBuf::from(program);
        let user = (user == 0 && runs_as(&program, NOBODY)).then_some(NOBODY);
        if let Some(user) = user {
            chown(&folder, Some(user), Some(user)).expect("root may give folders away");
        }
        Self { _turn: turn, program, folder, number: count % 50, user }
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

    /// This test's instance, for [`World::state`] and others that look into it.
    ///
    /// # Panics
    /// The path is illegal, which it is not.
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

    /// Starts the daemon and waits until it can be attached to.
    #[must_use]
    pub fn daemon(&self, other: u32) -> Process {
        let rights = std::env::var_os("FORETRACE_RT_TESTS").is_some_and(|value| value == "1");
        let mut daemon = if rights {
            self.start(other, &["daemon"])
        } else {
            self.start(other, &["daemon", "--no-rights"])
        };
        until("the daemon comes up", || {
            daemon.expect_alive();
            let asked = self.run(other, &["status"]);
            assert!(matches!(asked.status.code(), Some(0 | 1 | 3)), "{}", told(&asked));
            asked.status.success().then_some(())
        });
        daemon
    }

    /// Starts a simulated arm and waits until the daemon can be armed, then arms it.
    #[must_use]
    pub fn armed_arm(&self, other: u32, options: &[&str]) -> Process {
        let mut arm = self.start(other, &[&["arm", "sim"], options].concat());
        self.arm(other, &mut arm);
        arm
    }

    /// Asks to arm until the daemon does.
    pub fn arm(&self, other: u32, arm: &mut Process) {
        until("the daemon arms", || {
            arm.expect_alive();
            let asked = self.run(other, &["request", "arm"]);
            // Refused for the time being, or no answer yet; anything else will not change by waiting.
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

    /// What `foretrace status --json -` says.
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
        let mut command = Command::new(&self.program);
        command.args(arguments).current_dir(&self.folder);
        command.env_remove("XDG_RUNTIME_DIR").env("HOME", &self.folder);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        if let Some(user) = user {
            command.uid(user).gid(user);
        }
        let words = arguments.join(" ");
        let child = command.spawn().expect("the program under test starts");
        Process { child, words }
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

/// A running program; dropping it kills it.
#[derive(Debug)]
pub struct Process {
    child: Child,
    words: String,
}

impl Process {
    /// Number of the process.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Fails the test with its messages if it has ended.
    ///
    /// # Panics
    /// It has ended.
    pub fn expect_alive(&mut self) {
        if let Some(status) = self.child.try_wait().expect("own child") {
            let mut text = String::new();
            if let Some(stderr) = &mut self.child.stderr {
                let _ = stderr.read_to_string(&mut text);
            }
            panic!("`foretrace {}` ended early ({status}):\n{text}", self.words);
        }
    }

    /// Asks it to end as Ctrl-C does and waits.
    ///
    /// # Panics
    /// It does not end, or badly.
    pub fn end(self) -> Output {
        let words = self.words.clone();
        self.signal("-INT");
        let output = self.output();
        assert!(output.status.success(), "`foretrace {words}`: {}", told(&output));
        output
    }

    /// Stops listening to its stdout, as `| head` does.
    pub fn close_stdout(&mut self) {
        self.child.stdout = None;
    }

    /// Kills it without warning (SIGKILL).
    ///
    /// # Panics
    /// It cannot be waited for.
    pub fn kill(mut self) -> ExitStatus {
        self.child.kill().expect("own child");
        self.child.wait().expect("own child")
    }

    /// Sends it a signal, for example `-STOP`.
    ///
    /// # Panics
    /// There is no program called `kill`.
    pub fn signal(&self, signal: &str) {
        let sent = Command::new("kill").args([signal, &self.pid().to_string()]).status();
        assert!(sent.expect("kill exists everywhere").success());
    }

    /// Waits for its end and takes what it wrote.
    ///
    /// # Panics
    /// It hangs.
    #[must_use]
    pub fn output(mut self) -> Output {
        // Pipes hold 64 KiB: readers of their own keep the child from waiting for us.
        let read = |pipe: Option<Box<dyn Read + Send>>| {
            std::thread::spawn(move || {
                let mut bytes = Vec::new();
                if let Some(mut pipe) = pipe {
                    let _ = pipe.read_to_end(&mut bytes);
                }
                bytes
            })
        };
        let stdout = read(self.child.stdout.take().map(|pipe| Box::new(pipe) as _));
        let stderr = read(self.child.stderr.take().map(|pipe| Box::new(pipe) as _));
        let status =
            until(&format!("`foretrace {}` ends", self.words), || self.child.try_wait().expect("own child"));
        Output {
            status,
            stdout: stdout.join().expect("reading a pipe"),
            stderr: stderr.join().expect("reading a pipe"),
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Asks until there is an answer.
///
/// # Panics
/// There is none within a minute.
pub fn until<T>(what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
    let since = Instant::now();
    loop {
        if let Some(answer) = ask() {
            return answer;
        }
        assert!(since.elapsed() < PATIENCE, "{what}: not within {} s", PATIENCE.as_secs());
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Exit code and both outputs, for messages.
#[must_use]
pub fn told(output: &Output) -> String {
    format!(
        "{}\nstdout: {}\nstderr: {}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// Asserts that the program failed with `code`, said so in one sentence that holds all `words`, and did not panic.
///
/// # Panics
/// It did something else.
pub fn assert_refused(output: &Output, code: i32, words: &[&str]) {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{}", told(output));
    for word in words {
        assert!(stderr.contains(word), "{word:?} is missing in {}", told(output));
    }
    assert!(!stderr.contains("panicked") && !stderr.contains("RUST_BACKTRACE"), "{}", told(output));
}

/// A process' own JSON report.
///
/// # Panics
/// There is none.
#[must_use]
pub fn json(file: &Path) -> Value {
    let text = std::fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}\n{text}", file.display()))
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
    let _ = writeln!(std::io::stderr(), "skipped: {} is not there (set FORETRACE_SHARED)", folder.display());
    None
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
