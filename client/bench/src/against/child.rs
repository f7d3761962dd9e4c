//! One of the two programs: its greeting, and a bench of it in a process of its own.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use foretrace_failure::Failure;

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
    path: PathBuf,
    version: String,
    knows_parts: bool,
}

impl BenchProgram {
    /// Asks it for its version and its options.
    pub(super) fn greeted(path: &Path) -> Result<Self, Failure> {
        let version = asked(path, &["--version"])?;
        let version = version.lines().next().unwrap_or_default();
        let Some(version) = version.strip_prefix("foretrace ").filter(|rest| !rest.is_empty()) else {
            let what = format!("{} is not foretrace: --version says {:?}", path.display(), cut(version));
            return Err(Failure::bad_input(what, FORETRACE));
        };
        let version = version.split(',').next().unwrap_or(version).to_owned();
        let knows_parts = asked(path, &["bench", "--help"])?.contains("--part ");
        Ok(Self { path: path.to_owned(), version, knows_parts })
    }

    pub(super) fn path(&self) -> impl std::fmt::Display {
        self.path.display()
    }

    pub(super) fn version(&self) -> &str {
        &self.version
    }

    pub(super) const fn knows_parts(&self) -> bool {
        self.knows_parts
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
        // Only whole results get the name.
        let [out, err] = ["out.part", "err.part"].map(|end| file.with_extension(end));
        let printed = finished(&self.path, &words, patience, [&out, &err]);
        let kept = printed.and_then(|(status, words, complaint)| {
            if !status.success() {
                let last = complaint.trim_end().lines().last().map_or_else(String::new, said);
                let what = format!("{place}: it ended with {status}{last}");
                return Err(Failure::failed(what, "run that bench alone to see why"));
            }
            std::fs::rename(&out, file).map_err(|error| unwritable(file, &error))?;
            Ok(words)
        });
        for rest in [&out, &err] {
            // Gone already where it was renamed.
            let _ = std::fs::remove_file(rest);
        }
        kept.map_err(|failure| match failure.what.starts_with(place) {
            true => failure,
            false => Failure { what: format!("{place}: {}", failure.what), ..failure },
        })
    }
}

fn said(line: &str) -> String {
    format!(": {}", cut(line))
}

/// What a program prints in answer to a question about itself.
fn asked(path: &Path, words: &[&str]) -> Result<String, Failure> {
    let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
    let scratch = GreetingFolder::new()?;
    let files = [scratch.0.join("out"), scratch.0.join("err")];
    let (status, printed, _) =
        finished(path, &words, GREETING, [&files[0], &files[1]]).map_err(|failure| {
            let what = format!("{} {}: {}", path.display(), words.join(" "), failure.what);
            Failure { what, remedy: FORETRACE.to_owned(), ..failure }
        })?;
    if !status.success() {
        let what = format!("{} is not foretrace: {} ended with {status}", path.display(), words.join(" "));
        return Err(Failure::bad_input(what, FORETRACE));
    }
    Ok(printed)
}

/// A folder of this process, removed with its handle.
struct GreetingFolder(PathBuf);

impl GreetingFolder {
    fn new() -> Result<Self, Failure> {
        static COUNT: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        let count = COUNT.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let folder = std::env::temp_dir().join(format!("foretrace-against-{}-{count}", std::process::id()));
        std::fs::create_dir(&folder).map_err(|error| unwritable(&folder, &error))?;
        Ok(Self(folder))
    }
}

impl Drop for GreetingFolder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Runs a program to its end: how it ended, what it printed, what it complained about.
///
/// Files instead of pipes: a process that outlives it cannot keep anyone waiting.
fn finished(
    path: &Path,
    words: &[String],
    patience: Duration,
    [out, err]: [&Path; 2],
) -> Result<(ExitStatus, String, String), Failure> {
    let open = |file: &Path| File::create(file).map_err(|error| unwritable(file, &error));
    let (stdout, stderr) = (open(out)?, open(err)?);
    let child = Command::new(path)
        .args(words)
        .stdin(Stdio::null())
        .stdout(Stdio::from(stdout))
        .stderr(Stdio::from(stderr))
        .spawn()
        .map_err(|error| {
            Failure::bad_input(format!("{} cannot be started: {error}", path.display()), FORETRACE)
        })?;
    let status = ended(child, patience)?;
    Ok((status, read(out)?, read(err)?))
}

fn ended(mut child: Child, patience: Duration) -> Result<ExitStatus, Failure> {
    let began = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return Ok(status),
            Ok(None) if began.elapsed() < patience => std::thread::sleep(LOOK),
            Ok(None) => {
                // It may have ended this moment, which is as good.
                let _ = child.kill();
                let _ = child.wait();
                let what = format!("no end within {:.1} s, so it was killed", patience.as_secs_f64());
                return Err(Failure::failed(what, "raise --cell-limit, or see why it hangs"));
            }
            Err(error) => return Err(Failure::failed(format!("it cannot be waited for: {error}"), "")),
        }
    }
}

fn read(file: &Path) -> Result<String, Failure> {
    let mut bytes = Vec::new();
    let read = File::open(file).and_then(|file| file.take(MOST_BYTES).read_to_end(&mut bytes));
    read.map_err(|error| Failure::failed(format!("{} cannot be read: {error}", file.display()), ""))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

fn unwritable(file: &Path, error: &std::io::Error) -> Failure {
    Failure::failed(
        format!("{} cannot be written: {error}", file.display()),
        "give a writable folder (--out DIR)",
    )
}

/// The beginning of a line, for a message.
pub(super) fn cut(line: &str) -> String {
    let short: String = line.chars().take(200).collect();
    if short.len() < line.len() { format!("{short}…") } else { short }
}
