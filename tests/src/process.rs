//! Processes of a test, and waiting for them with a bound.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output};
use std::time::{Duration, Instant};

use serde_json::Value;

/// A busy machine takes seconds for what usually takes milliseconds; only a hang lasts longer than this.
const PATIENCE: Duration = Duration::from_secs(60);

/// A running program; dropping it kills it.
#[derive(Debug)]
pub struct Process {
    child: Child,
    words: String,
    /// Where an arm reports the commands that it got.
    report: Option<PathBuf>,
}

impl Process {
    pub(crate) const fn new(child: Child, words: String) -> Self {
        Self { child, words, report: None }
    }

    /// The same, an arm that reports to `file`: no command that it got may have broken a rule.
    pub(crate) fn reporting_to(mut self, file: PathBuf) -> Self {
        self.report = Some(file);
        self
    }

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
    /// It does not end, or badly; an arm of [`crate::World::armed_arm`] got a command that broke a rule.
    pub fn end(mut self) -> Output {
        let (words, report) = (self.words.clone(), self.report.take());
        self.signal("-INT");
        let output = self.output();
        assert!(output.status.success(), "`foretrace {words}`: {}", told(&output));
        if let Some(report) = report.map(|file| json(&file)) {
            assert_eq!(report["commands"]["limit_violations"], 0, "{report}");
        }
        output
    }

    /// Whether it has ended, and what it said then.
    ///
    /// # Panics
    /// It cannot be waited for.
    pub fn ended(&mut self) -> Option<(ExitStatus, String)> {
        let status = self.child.try_wait().expect("own child")?;
        let mut text = String::new();
        if let Some(stderr) = &mut self.child.stderr {
            let _ = stderr.read_to_string(&mut text);
        }
        Some((status, text))
    }

    /// Diagnosis for a failed test: where its threads wait, or how it ended, and all its output. Kills it.
    ///
    /// # Panics
    /// It cannot be waited for.
    #[must_use]
    pub fn testify(mut self) -> String {
        let mut told = format!("`foretrace {}` (process {})", self.words, self.pid());
        match self.child.try_wait().expect("own child") {
            Some(status) => told += &format!(" had ended: {status}"),
            None => {
                told += " was alive; its threads:";
                for thread in
                    std::fs::read_dir(format!("/proc/{}/task", self.pid())).into_iter().flatten().flatten()
                {
                    let read = |name: &str| {
                        let text = std::fs::read_to_string(thread.path().join(name)).unwrap_or_default();
                        text.trim().to_owned()
                    };
                    let stack = read("stack").lines().take(3).collect::<Vec<_>>().join(" ");
                    told += &format!(
                        "\n  {}: {} syscall [{}] {stack}",
                        read("comm"),
                        read("wchan"),
                        read("syscall")
                    );
                }
            }
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
        for pipe in [
            self.child.stdout.take().map(|pipe| Box::new(pipe) as Box<dyn Read>),
            self.child.stderr.take().map(|pipe| Box::new(pipe) as _),
        ]
        .into_iter()
        .flatten()
        {
            // A process that inherited the pipe must not block the test: reads no more than a pipe holds.
            let mut bytes = Vec::new();
            let _ = pipe.take(1 << 16).read_to_end(&mut bytes);
            told += &format!("\n{}", String::from_utf8_lossy(&bytes));
        }
        told
    }

    /// Its stdout, to be read while it runs.
    pub fn take_stdout(&mut self) -> Option<std::process::ChildStdout> {
        self.child.stdout.take()
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
        // Pipes hold 64 KiB: reader threads keep the child from blocking.
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
/// No answer within a minute.
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

/// Asserts that the program failed with `code` and one sentence that holds all `words`, and did not panic.
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
/// No report.
#[must_use]
pub fn json(file: &Path) -> Value {
    let text = std::fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}\n{text}", file.display()))
}
