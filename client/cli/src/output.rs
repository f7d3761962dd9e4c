//! Output for people (stdout) and for machines (the JSON file).
//!
//! Contract: with `--json -` stdout carries the JSON and nothing else, and all text goes to stderr. A reader
//! who closes the pipe ends the program quietly; no write ever panics.

use std::borrow::Cow;
use std::fmt::Arguments;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use foretrace_config::{plain, plain_lines};
use serde::Serialize;

use crate::failure::Failure;

/// A line for people, on stdout unless the JSON has it.
macro_rules! say {
    ($($arg:tt)*) => { $crate::output::say_line(format_args!($($arg)*)) };
}

/// A line for people, on stderr in any case.
macro_rules! note {
    ($($arg:tt)*) => { $crate::output::note_line(format_args!($($arg)*)) };
}

static WORDS_TO_STDERR: AtomicBool = AtomicBool::new(false);

/// `--json FILE`, common to every command with a result.
#[derive(Debug, Clone, Default, clap::Args)]
pub(crate) struct JsonArgs {
    /// Also write the result as JSON to FILE; without one, or with '-', to stdout, which then carries JSON
    /// only
    #[arg(long, value_name = "FILE", global = true, num_args = 0..=1, default_missing_value = "-")]
    pub(crate) json: Option<PathBuf>,
}

impl JsonArgs {
    /// Before any work: sends all words to stderr from now on if stdout belongs to the JSON, and refuses a
    /// file whose folder does not exist.
    pub(crate) fn claim(&self) -> Result<(), Failure> {
        self.claim_with(None)
    }

    /// The same, where the work makes the folder `made` in which the file may lie.
    pub(crate) fn claim_beside(&self, made: &Path) -> Result<(), Failure> {
        self.claim_in(made)?;
        note_results(made);
        Ok(())
    }

    /// The same, where it is not known yet whether anything of an earlier run is replaced.
    pub(crate) fn claim_in(&self, made: &Path) -> Result<(), Failure> {
        self.claim_with(Some(made))
    }

    fn claim_with(&self, made: Option<&Path>) -> Result<(), Failure> {
        if self.is_stdout() {
            WORDS_TO_STDERR.store(true, Ordering::Relaxed);
        }
        self.check(made)
    }

    fn is_stdout(&self) -> bool {
        self.json.as_deref() == Some(Path::new("-"))
    }

    fn check(&self, made: Option<&Path>) -> Result<(), Failure> {
        let Some(path) = self.json.as_deref().filter(|_| !self.is_stdout()) else { return Ok(()) };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let same = |made: &Path| std::path::absolute(made).ok() == std::path::absolute(folder).ok();
        let there = folder.is_dir() || made.is_some_and(same);
        let why = match (there, path.is_dir()) {
            (true, false) => return Ok(()),
            (true, true) => "it is a folder".to_owned(),
            (false, _) => format!("there is no folder {}", folder.display()),
        };
        let what = format!("cannot write {}: {why}", path.display());
        Err(Failure::bad_input(what, "give a writable --json FILE"))
    }

    /// Writes `result` as one line of JSON on stdout.
    pub(crate) fn line<T: Serialize>(&self, result: &T) -> Result<(), Failure> {
        let mut text = serde_json::to_string(result).map_err(|error| {
            Failure::failed(format_args!("the result cannot be written as JSON: {error}"), "")
        })?;
        text.push('\n');
        put(&text);
        Ok(())
    }

    /// Writes `result` where it was asked for, if it was.
    pub(crate) fn write<T: Serialize>(&self, result: &T) -> Result<(), Failure> {
        self.put(serde_json::to_string_pretty(result))
    }

    /// The same in one line of at most `most` bytes: for parts of results, which only programs read.
    #[cfg(feature = "lab")]
    pub(crate) fn write_dense<T: Serialize>(&self, result: &T, most: u64) -> Result<(), Failure> {
        let text = serde_json::to_string(result);
        match &text {
            // With the end of the line.
            Ok(text) if text.len() as u64 >= most => {
                let what =
                    format_args!("this part has {} bytes, {most} are the most that are read", text.len());
                Err(Failure::bad_input(what, "cut the run into more shards (--shard I/N)"))
            }
            _ => self.put(text),
        }
    }

    fn put(&self, json: serde_json::Result<String>) -> Result<(), Failure> {
        let Some(path) = &self.json else { return Ok(()) };
        let mut text = json.map_err(|error| {
            Failure::failed(format_args!("the result cannot be written as JSON: {error}"), "")
        })?;
        text.push('\n');
        if self.is_stdout() {
            put(&text);
            return Ok(());
        }
        write_file(path, &text, "--json")
    }
}

/// Writes a text whole, or not at all, into the file of `option`.
pub(crate) fn write_file(file: &Path, text: &str, option: &str) -> Result<(), Failure> {
    foretrace_host::whole::write(file, |out| out.write_all(text.as_bytes())).map_err(|error| {
        let what = format_args!("cannot write {}: {error}", file.display());
        Failure::failed(what, format_args!("give a writable {option} FILE"))
    })
}

/// Says that reports or pictures in the folder are replaced, if it has any.
pub(crate) fn note_results(made: &Path) {
    if holds_results(made) {
        note!(
            "{} has files of an earlier run: those of the same name are replaced (--out DIR keeps them)",
            made.display()
        );
    }
}

/// Whether a folder has reports or pictures, which a run would replace.
fn holds_results(folder: &Path) -> bool {
    let ours = |file: &Path| {
        file.extension().is_some_and(|end| ["html", "json", "svg"].iter().any(|known| end == *known))
    };
    std::fs::read_dir(folder)
        .is_ok_and(|mut files| files.any(|file| file.is_ok_and(|file| ours(&file.path()))))
}

/// Says that `file` is replaced, if it is there.
pub(crate) fn note_replaced(file: &Path, option: &str) {
    if file.exists() {
        note!("{} of an earlier run is replaced ({option} keeps it)", file.display());
    }
}

/// Bytes of ours on stdout as they are, for other programs.
pub(crate) fn print(bytes: &[u8]) -> Result<(), Failure> {
    quietly(io::stdout().write_all(bytes).and_then(|()| io::stdout().flush()));
    Ok(())
}

/// JSON on stdout. It may be a terminal, so control characters are escaped, which means the same in JSON.
fn put(json: &str) {
    quietly(io::stdout().write_all(plain_lines(json).as_bytes()).and_then(|()| io::stdout().flush()));
}

/// Prints lines for people; see `say!`.
pub(crate) fn say_lines(lines: Vec<String>) {
    lines.iter().for_each(|line| say!("{line}"));
}

/// Prints a line of a library on stderr; see `note!`.
pub(crate) fn tell(line: &str) {
    note!("{line}");
}

/// Prints a line for people; see `say!`.
pub(crate) fn say_line(line: Arguments<'_>) {
    if WORDS_TO_STDERR.load(Ordering::Relaxed) {
        note_line(line);
    } else {
        let line = line.to_string();
        quietly(writeln!(io::stdout(), "{}", plain_lines(&line)));
    }
}

/// Prints lines for people in a colour of the terminal (SGR, ECMA-48 8.3.117), if one is given.
pub(crate) fn paint(lines: &str, colour: Option<u8>) {
    match colour.filter(|_| !WORDS_TO_STDERR.load(Ordering::Relaxed)) {
        Some(colour) => {
            quietly(writeln!(io::stdout(), "\x1b[1;{colour}m{}\x1b[0m", plain_lines(lines)));
        }
        None => say_line(format_args!("{lines}")),
    }
}

/// Begins a new page where stdout is a terminal that shows words.
pub(crate) fn clear_screen() {
    if io::stdout().is_terminal() && !WORDS_TO_STDERR.load(Ordering::Relaxed) {
        quietly(io::stdout().write_all(b"\x1b[H\x1b[2J"));
    }
}

/// Prints a line on stderr, lost if stderr is closed.
pub(crate) fn note_line(line: Arguments<'_>) {
    let line = line.to_string();
    let _ = writeln!(io::stderr(), "{}", plain_lines(&line));
}

/// What the command line was answered: help and version on stdout, complaints on stderr, in colour unless the
/// words that it repeats would do something to a terminal.
pub(crate) fn command_line(answer: &clap::Error) -> ExitCode {
    let hostile = std::env::args_os().any(|word| matches!(plain(&word.to_string_lossy()), Cow::Owned(_)));
    if answer.use_stderr() && hostile {
        let words =
            std::env::args_os().map(|word| plain(&word.to_string_lossy()).into_owned()).collect::<Vec<_>>();
        note_line(format_args!("{}\nThe words were: {}", answer.render(), words.join(" ")));
    } else if answer.use_stderr() {
        // The reader may be gone.
        let _ = answer.print();
    } else {
        quietly(answer.print().and_then(|()| io::stdout().flush()));
    }
    ExitCode::from(u8::try_from(answer.exit_code()).unwrap_or(2))
}

/// Stderr is a terminal, so that progress may be drawn.
pub(crate) fn may_draw() -> bool {
    io::stderr().is_terminal()
}

pub(crate) use {note, say};

/// A closed pipe means that the reader has seen enough.
fn quietly(written: io::Result<()>) {
    if let Err(error) = written {
        if error.kind() == io::ErrorKind::BrokenPipe {
            std::process::exit(0);
        }
        // A full disk or device: reported where it can still be read, for stdout cannot.
        let _ = writeln!(
            io::stderr(),
            "foretrace: stdout cannot be written: {error}; make room there, or write elsewhere"
        );
        std::process::exit(1);
    }
}
