//! The calls to the operating system that the standard library lacks. The only file of this program with
//! `unsafe`.

use std::io;
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::time::Duration;

/// Sleeps until CLOCK_MONOTONIC reaches `instant_ns`; a signal ends the sleep early.
pub(crate) fn sleep_until(instant_ns: u64) {
    let until = libc::timespec {
        tv_sec: (instant_ns / 1_000_000_000) as libc::time_t,
        tv_nsec: (instant_ns % 1_000_000_000) as libc::c_long,
    };
    // SAFETY: `until` is a valid timespec that outlives the call; no remaining time is asked for.
    unsafe {
        libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &until, std::ptr::null_mut());
    }
}

/// Lets the kernel end this process (SIGXCPU) once a real-time thread of it has computed for `longest`
/// without a pause (RLIMIT_RTTIME; a lower limit stays).
pub(crate) fn limit_spin(longest: Duration) -> io::Result<()> {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is valid for writing.
    if unsafe { libc::getrlimit(libc::RLIMIT_RTTIME, &raw mut limit) } != 0 {
        return Err(io::Error::last_os_error());
    }
    let micros = libc::rlim_t::try_from(longest.as_micros()).unwrap_or(libc::rlim_t::MAX);
    limit.rlim_cur = limit.rlim_cur.min(micros);
    // SAFETY: `limit` is valid for reading.
    match unsafe { libc::setrlimit(libc::RLIMIT_RTTIME, &raw const limit) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Asks process `pid` to end (SIGTERM).
pub(crate) fn terminate(pid: u32) {
    // SAFETY: kill touches no memory; the pid is a child of ours that has not been waited for, so it is not
    // reused.
    unsafe {
        libc::kill(pid as libc::pid_t, libc::SIGTERM);
    }
}

/// Lets the child end with this process, however that ends, and keeps the terminal's Ctrl-C from it: its
/// parent ends it in order.
pub(crate) fn tie_to_parent(command: &mut Command) -> &mut Command {
    let parent = std::process::id();
    command.process_group(0);
    let in_child = move || {
        // SAFETY: prctl with PR_SET_PDEATHSIG takes a signal number and touches no memory; allowed after
        // fork.
        let done = unsafe { libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGTERM) };
        if done != 0 {
            return Err(io::Error::last_os_error());
        }
        // The parent may have ended before the call.
        if std::os::unix::process::parent_id() != parent {
            return Err(io::Error::from(io::ErrorKind::BrokenPipe));
        }
        Ok(())
    };
    // SAFETY: the closure makes two system calls and allocates nothing, so it is sound between fork and exec.
    unsafe { command.pre_exec(in_child) }
}
