//! The terminal: its size, and keys as they are pressed.
//!
//! Contract: keys arrive one by one and are not echoed while a [`TypedKeys`] lives; the terminal is as it was
//! once that is dropped. Ctrl-C stays a signal: who has keys looks at the flag often, since a second
//! one ends the program at once.

use std::fs::File;
use std::io::{self, BufRead, IsTerminal, Read, Write};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::termios::{LocalModes, OptionalActions, Termios, tcgetattr, tcgetwinsize, tcsetattr};

use crate::failure::Failure;

/// Columns and lines of the terminal behind stdout; `None` where it is none, or does not say.
pub(crate) fn size() -> Option<(usize, usize)> {
    let size = io::stdout().is_terminal().then(|| tcgetwinsize(io::stdout()).ok()).flatten()?;
    (size.ws_col > 0 && size.ws_row > 0).then_some((size.ws_col.into(), size.ws_row.into()))
}

/// Whether words on stdout may be coloured (<https://no-color.org>).
pub(crate) fn has_colour() -> bool {
    let refused = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let dumb = std::env::var_os("TERM").is_none_or(|term| term == "dumb");
    io::stdout().is_terminal() && !refused && !dumb
}

/// Bytes of an answer that are read: a line without an end is no yes.
const LONGEST_ANSWER: u64 = 64;

/// Asks on the terminal; only `yes` is a yes.
pub(crate) fn agreed(question: &str) -> Result<bool, Failure> {
    // The reader may be gone; then there is no answer.
    let _ = write!(io::stderr(), "{question} Type yes: ");
    let mut answer = Vec::new();
    Read::take(io::stdin().lock(), LONGEST_ANSWER)
        .read_until(b'\n', &mut answer)
        .map_err(|error| Failure::failed(format_args!("reading from the terminal: {error}"), "give --yes"))?;
    Ok(String::from_utf8_lossy(&answer).trim().eq_ignore_ascii_case("yes"))
}

/// Bytes of the longest line that is read as one.
const LINE_BYTES: u64 = 256;

/// Gives what is typed to `take`, line by line, until that is false; a longer line comes in chunks. The
/// thread, called `name`, ends with its input.
pub(crate) fn read_lines(
    name: &str,
    mut take: impl FnMut(&str) -> bool + Send + 'static,
) -> Result<(), Failure> {
    let reads = move || {
        let mut input = io::stdin().lock();
        loop {
            let mut bytes = Vec::new();
            match Read::take(&mut input, LINE_BYTES).read_until(b'\n', &mut bytes) {
                Ok(0) | Err(_) => return,
                Ok(_) if take(&String::from_utf8_lossy(&bytes)) => {}
                Ok(_) => return,
            }
        }
    };
    let started = std::thread::Builder::new().name(name.to_owned()).spawn(reads);
    started.map(drop).map_err(|error| {
        Failure::failed(format_args!("no thread can be started: {error}"), "raise `ulimit -u`")
    })
}

/// Keys of the terminal behind stdin.
pub(crate) struct TypedKeys {
    input: File,
    before: Termios,
}

impl TypedKeys {
    /// `None` where stdin is no terminal.
    pub(crate) fn listen() -> Option<Self> {
        use std::os::fd::AsFd;
        if !io::stdin().is_terminal() {
            return None;
        }
        // A handle of its own: the one of the standard library is buffered.
        let input = File::from(io::stdin().as_fd().try_clone_to_owned().ok()?);
        let before = tcgetattr(&input).ok()?;
        let mut single = before.clone();
        single.local_modes.remove(LocalModes::ICANON | LocalModes::ECHO);
        tcsetattr(&input, OptionalActions::Now, &single).ok()?;
        Some(Self { input, before })
    }

    /// The newest key that was pressed since the last look; does not wait.
    pub(crate) fn pressed(&mut self) -> Option<u8> {
        self.typed().last().copied()
    }

    /// What was typed since the last look, in its order; does not wait.
    pub(crate) fn typed(&mut self) -> Vec<u8> {
        let mut typed = Vec::new();
        let mut waiting = [0; 64];
        // A held key fills less than this between two looks.
        for _ in 0..16 {
            let mut looked = [PollFd::new(&self.input, PollFlags::IN)];
            let now = Timespec { tv_sec: 0, tv_nsec: 0 };
            let readable = poll(&mut looked, Some(&now)).is_ok_and(|ready| ready > 0);
            let count = if readable { self.input.read(&mut waiting).unwrap_or(0) } else { 0 };
            if count == 0 {
                break;
            }
            typed.extend(waiting.iter().take(count));
        }
        typed
    }
}

impl Drop for TypedKeys {
    fn drop(&mut self) {
        let _ = tcsetattr(&self.input, OptionalActions::Now, &self.before);
    }
}
