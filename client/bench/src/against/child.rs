//! One of the two programs: its greeting, and a bench of it in a process of its own.

use std::fs::File;
use std::io::Write as _;
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use foretrace_failure::Failure;
use foretrace_host::children::GroupChild;
use foretrace_host::sha256::sha256_of_file;
use foretrace_host::whole;

use crate::BenchPart;

/// For `--version` and `--help`.
const GREETING: Duration = Duration::from_secs(20);
/// Between looks at a process; long enough to cost it nothing.
const LOOK: Duration = Duration::from_millis(20);
/// More than any bench prints \[bytes\].
const MOST_BYTES: u64 = 1 << 20;
const FORETRACE: &str = "give the path of a foretrace program (--against BINARY)";

/// A program that said that it is foretrace.
#[derive(Debug)]
pub(super) struct BenchProgram {
    /// Of the file itself: nothing else is looked for, and a link that is turned elsewhere changes nothing.
    path: PathBuf,
    sha256: String,
    version: String,
    knows_parts: bool,
}

impl BenchProgram {
    /// Asks it for its version and its options.
    pub(super) fn greeted(path: &Path) -> Result<Self, Failure> {
        let path = &path.canonicalize().map_err(|error| unstarted(path, &error))?;
        let sha256 = sha256_of_file(path).map_err(|error| {
            let what = format!("{} cannot be read, for its sum: {error}", path.display());
            Failure::bad_input(what, FORETRACE)
        })?;
        let version = asked(path, &["--version"])?;
        let version = version.lines().next().unwrap_or_default();
        let Some(version) = version.strip_prefix("foretrace ").filter(|rest| !rest.is_empty()) else {
            let what = format!("{} is not foretrace: --version says {:?}", path.display(), cut(version));
            return Err(Failure::bad_input(what, FORETRACE));
        };
        let version = version.split(',').next().unwrap_or(version).to_owned();
        let knows_parts = asked(path, &["bench", "--help"])?.contains("--part ");
        Ok(Self { path: path.clone(), sha256, version, knows_parts })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn sha256(&self) -> &str {
        &self.sha256
    }

    pub(super) fn version(&self) -> &str {
        &self.version
    }

    pub(super) const fn knows_parts(&self) -> bool {
        self.knows_parts
    }

    /// Refuses a program that was built anew or replaced in the meantime: its cells are of two programs.
    pub(super) fn unchanged(&self) -> Result<(), Failure> {
        if sha256_of_file(&self.path).is_ok_and(|sum| sum == self.sha256) {
            return Ok(());
        }
        let what = format!("{} changed while it was measured", self.path.display());
        Err(Failure::failed(what, "compare copies that nothing builds anew"))
    }

    /// Runs one bench in a fresh process; what it printed, which `file` then has, too.
    pub(super) fn bench(
        &self,
        options: &[String],
        part: Option<BenchPart>,
        patience: Duration,
        file: &Path,
        place: &str,
    ) -> Result<String, Failure> {
        let mut words = vec!["bench".to_owned()];
        words.extend(options.iter().cloned());
        words.extend(part.into_iter().flat_map(|part| ["--part".to_owned(), part.name().to_owned()]));
        words.extend(["--json".to_owned(), "-".to_owned()]);
        let placed = |failure: Failure| Failure { what: format!("{place}: {}", failure.what), ..failure };
        let (status, printed, complaint) = finished(&self.path, &words, patience).map_err(placed)?;
        if !status.success() {
            let last = complaint.trim_end().lines().last().map_or_else(String::new, said);
            let what = format!("{place}: it ended with {status}{last}");
            return Err(Failure::failed(what, "run that bench alone to see why"));
        }
        let kept = whole::write(file, |out| out.write_all(printed.as_bytes()));
        kept.map_err(|error| placed(unwritable(file, "--out DIR", &error)))?;
        Ok(printed)
    }
}

fn said(line: &str) -> String {
    format!(": {}", cut(line))
}

/// What a program prints in answer to a question about itself.
fn asked(path: &Path, words: &[&str]) -> Result<String, Failure> {
    let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
    let (status, printed, _) = finished(path, &words, GREETING).map_err(|failure| {
        let what = format!("{} {}: {}", path.display(), words.join(" "), failure.what);
        Failure { what, remedy: FORETRACE.to_owned(), ..failure }
    })?;
    if !status.success() {
        let what = format!("{} is not foretrace: {} ended with {status}", path.display(), words.join(" "));
        return Err(Failure::bad_input(what, FORETRACE));
    }
    Ok(printed)
}

/// Runs a program to its end: how it ended, what it printed, what it complained about.
///
/// Files instead of pipes: a process that outlives it cannot keep anyone waiting.
fn finished(
    path: &Path,
    words: &[String],
    patience: Duration,
) -> Result<(ExitStatus, String, String), Failure> {
    let (out, err) = (Printed::new()?, Printed::new()?);
    let mut command = Command::new(path);
    command.args(words).stdin(Stdio::null()).stdout(out.writer()?).stderr(err.writer()?);
    let mut child = GroupChild::start(&mut command).map_err(|error| unstarted(path, &error))?;
    let began = Instant::now();
    while !child.has_ended(LOOK, LOOK) {
        if out.overflows() || err.overflows() {
            return Err(too_much());
        }
        if began.elapsed() >= patience {
            let what = format!("no end within {:.1} s, so it was killed", patience.as_secs_f64());
            return Err(Failure::failed(what, "raise --cell-limit, or see why it hangs"));
        }
    }
    let status = child.end().ok_or_else(|| Failure::failed("it cannot be waited for", ""))?;
    if out.overflows() || err.overflows() {
        return Err(too_much());
    }
    Ok((status, out.text()?, err.text()?))
}

fn too_much() -> Failure {
    let what = format!("it prints more than {MOST_BYTES} bytes, so it was killed");
    Failure::bad_input(what, "compare with a foretrace whose `bench --json -` prints a result")
}

/// Where a process prints to: a file without a name, which goes with the last process that has it.
struct Printed(File);

impl Printed {
    fn new() -> Result<Self, Failure> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("foretrace-against-{}-{count}", std::process::id()));
        let file = File::options().read(true).write(true).create_new(true).open(&path);
        let file = file.and_then(|file| std::fs::remove_file(&path).map(|()| file));
        file.map(Self).map_err(|error| unwritable(&path, "TMPDIR", &error))
    }

    fn writer(&self) -> Result<Stdio, Failure> {
        let unshared = |error| Failure::failed(format_args!("no more files can be open: {error}"), "");
        Ok(Stdio::from(self.0.try_clone().map_err(unshared)?))
    }

    fn overflows(&self) -> bool {
        self.0.metadata().is_ok_and(|about| about.len() > MOST_BYTES)
    }

    fn text(&self) -> Result<String, Failure> {
        let unread = |error| Failure::failed(format_args!("what it printed cannot be read: {error}"), "");
        let length = self.0.metadata().map_err(unread)?.len().min(MOST_BYTES);
        let mut bytes = vec![0; length as usize];
        self.0.read_exact_at(&mut bytes, 0).map_err(unread)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }
}

fn unstarted(path: &Path, error: &std::io::Error) -> Failure {
    Failure::bad_input(format!("{} cannot be started: {error}", path.display()), FORETRACE)
}

/// `what` names the folder for it.
fn unwritable(file: &Path, what: &str, error: &std::io::Error) -> Failure {
    let remedy = format!("give a writable folder ({what})");
    Failure::failed(format!("{} cannot be written: {error}", file.display()), remedy)
}

/// The beginning of a line, for a message.
pub(super) fn cut(line: &str) -> String {
    let short: String = line.chars().take(200).collect();
    if short.len() < line.len() { format!("{short}…") } else { short }
}
