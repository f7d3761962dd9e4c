//! Children that end with this process. The only file of this program with `unsafe`.

use std::io;
use std::os::unix::process::{CommandExt, parent_id};
use std::process::Command;

use rustix::process::{Signal, set_parent_process_death_signal};

/// Lets the child end with this process, however that ends, and keeps the terminal's Ctrl-C from it: its
/// parent ends it in order. It ends with the thread that starts it, too.
pub(crate) fn tie_to_parent(command: &mut Command) -> &mut Command {
    let parent = std::process::id();
    command.process_group(0);
    let in_child = move || {
        set_parent_process_death_signal(Some(Signal::TERM))?;
        // The parent may have ended before the call.
        if parent_id() == parent { Ok(()) } else { Err(io::Error::from(io::ErrorKind::BrokenPipe)) }
    };
    // SAFETY: the closure makes two system calls and allocates nothing, so it is sound between fork and exec.
    unsafe { command.pre_exec(in_child) }
}
