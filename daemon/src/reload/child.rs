//! The other side: a process that reads settings for the daemon, sends what it read, and ends.
//!
//! Contract: begins before anything else of the program. It holds nothing of the daemon's, dies with it, and
//! has less stack and less memory than the daemon itself, so that what it survives the daemon does.

use std::ffi::OsString;
use std::io::Write as _;
use std::process::ExitCode;

use foretrace_config::files::Files;

use super::answer::CheckAnswer;
use crate::options::{Base, Source};
use crate::rt::os;

/// The first argument of such a process.
pub(super) const WORD: &str = "check-settings";
/// Most memory \[bytes of address space\]: the largest files and what becomes of them, with margin.
pub(super) const MOST_MEMORY: u64 = 512 << 20;
/// Most processor time \[s\].
pub(super) const LONGEST_CPU_S: u64 = 3;
/// Stack of the thread that reads \[bytes\]: half of the least that the daemon runs with.
const STACK_BYTES: usize = 2 << 20;
/// Lower priority than everything that moves the arm.
const NICE: i32 = 5;

/// Does the work of such a process, if this is one: the first thing in `main`.
#[must_use]
pub fn child() -> Option<ExitCode> {
    let (memory, source) = asked(std::env::args_os().skip(1))?;
    os::confine(memory.unwrap_or(MOST_MEMORY).min(MOST_MEMORY), LONGEST_CPU_S, NICE);
    let work = move || {
        let files = Files::kept();
        match source.load_from(&files) {
            Ok(_) => CheckAnswer::Good(files.taken()),
            Err(error) => CheckAnswer::Refused(error.to_string()),
        }
    };
    let thread = std::thread::Builder::new().stack_size(STACK_BYTES).spawn(work);
    let sent = thread.map(std::thread::JoinHandle::join).is_ok_and(|answer| {
        answer.is_ok_and(|answer| std::io::stdout().write_all(&answer.to_bytes()).is_ok())
    });
    let sent = sent && std::io::stdout().flush().is_ok();
    Some(if sent { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Memory and source that the arguments name; `None`: they are those of another process.
pub(super) fn asked(mut words: impl Iterator<Item = OsString>) -> Option<(Option<u64>, Source)> {
    if words.next()? != WORD {
        return None;
    }
    let number = |word: OsString| word.to_str()?.parse::<u64>().ok();
    let memory = number(words.next()?)?;
    let (kind, name) = (words.next()?, words.next()?);
    let base = match kind.to_str()? {
        "file" => Base::File(name.into()),
        "preset" => Base::Preset(name.into_string().ok()?),
        _ => return None,
    };
    let rate_hz = u32::try_from(number(words.next()?)?).ok()?;
    let mut overrides = Vec::new();
    while let Some(key) = words.next() {
        overrides.push((key.into_string().ok()?, words.next()?.into_string().ok()?));
    }
    let source = Source { base, rate_hz: (rate_hz > 0).then_some(rate_hz), overrides };
    Some(((memory > 0).then_some(memory), source))
}
