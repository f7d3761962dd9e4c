//! One thread of a child, held by the kernel as a hanging loop would be, or watched at each of its system
//! calls. The only `unsafe` of these tests and, by this same file, of the daemon's.

use std::collections::BTreeMap;

/// A thread that stands still until this is dropped, in the thread that made it.
#[derive(Debug)]
pub struct Frozen(libc::pid_t);

impl Frozen {
    /// Stops the thread called `name` of process `pid`; `None` where tracing is forbidden.
    ///
    /// # Panics
    /// There is no such thread.
    #[must_use]
    pub fn thread_of(pid: u32, name: &str) -> Option<Self> {
        let thread = threads(pid).into_iter().find(|(_, comm)| comm == name);
        Self::hold(thread.expect(name).0)
    }

    /// Stops every thread of process `pid` but the one called `name`; `None` where tracing is forbidden.
    ///
    /// # Panics
    /// There is no such process.
    #[must_use]
    pub fn all_but(pid: u32, name: &str) -> Option<Vec<Self>> {
        threads(pid).into_iter().filter(|(_, comm)| comm != name).map(|(id, _)| Self::hold(id)).collect()
    }

    fn hold(id: libc::pid_t) -> Option<Self> {
        let none = std::ptr::null_mut::<libc::c_void>();
        // SAFETY: PTRACE_SEIZE reads and writes no memory of this process; its last argument is a set of
        // options.
        if unsafe { libc::ptrace(libc::PTRACE_SEIZE, id, none, libc::PTRACE_O_TRACESYSGOOD) } != 0 {
            return None;
        }
        let frozen = Self(id);
        // SAFETY: as above; the thread is traced by this one.
        assert_eq!(unsafe { libc::ptrace(libc::PTRACE_INTERRUPT, id, none, none) }, 0);
        frozen.wait();
        Some(frozen)
    }

    /// Lets the thread run until it has made `count` system calls; how often each, by number. `None` where
    /// the kernel does not tell (before 5.3).
    ///
    /// # Panics
    /// The thread ends meanwhile.
    #[must_use]
    pub fn system_calls(&self, count: usize) -> Option<BTreeMap<libc::c_long, usize>> {
        let mut calls = BTreeMap::new();
        let (mut seen, mut signal) = (0, 0);
        while seen < count {
            let none = std::ptr::null_mut::<libc::c_void>();
            // SAFETY: the thread is stopped and traced by this one; no memory is touched, and only its own
            // signal delivered.
            assert_eq!(unsafe { libc::ptrace(libc::PTRACE_SYSCALL, self.0, none, signal) }, 0);
            let stop = self.wait();
            assert!(libc::WIFSTOPPED(stop), "the thread has ended");
            signal = 0;
            if libc::WSTOPSIG(stop) != libc::SIGTRAP | 0x80 {
                let of_tracing = stop >> 16 != 0 || libc::WSTOPSIG(stop) == libc::SIGTRAP;
                signal = if of_tracing { 0 } else { libc::WSTOPSIG(stop) };
                continue;
            }
            // SAFETY: plain numbers, for which zero is a value.
            let mut info: libc::ptrace_syscall_info = unsafe { std::mem::zeroed() };
            let size = std::mem::size_of_val(&info);
            // SAFETY: at most `size` bytes are written to `info`.
            let written = unsafe { libc::ptrace(libc::PTRACE_GET_SYSCALL_INFO, self.0, size, &raw mut info) };
            if written <= 0 {
                return None;
            }
            if info.op == libc::PTRACE_SYSCALL_INFO_ENTRY {
                // SAFETY: `op` says that the entry is what was written.
                let number = unsafe { info.u.entry.nr };
                *calls.entry(number as libc::c_long).or_default() += 1;
                seen += 1;
            }
        }
        Some(calls)
    }

    /// Until the thread stops.
    fn wait(&self) -> libc::c_int {
        let mut status = 0;
        // SAFETY: `status` is valid for writing.
        assert_eq!(unsafe { libc::waitpid(self.0, &raw mut status, libc::__WALL) }, self.0);
        status
    }
}

/// The threads of `pid`, and their names.
fn threads(pid: u32) -> Vec<(libc::pid_t, String)> {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).expect("a living process").flatten();
    let named = threads.filter_map(|entry| {
        let comm = std::fs::read_to_string(entry.path().join("comm")).ok()?;
        Some((entry.file_name().to_str()?.parse().ok()?, comm.trim().to_owned()))
    });
    named.collect()
}

impl Drop for Frozen {
    fn drop(&mut self) {
        let none = std::ptr::null_mut::<libc::c_void>();
        // SAFETY: PTRACE_DETACH without a signal touches no memory of this process.
        unsafe { libc::ptrace(libc::PTRACE_DETACH, self.0, none, none) };
    }
}
