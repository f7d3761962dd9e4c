//! One thread of a child, held by the kernel as a hanging loop would be. The only `unsafe` of these tests and, by this same file, of the daemon's.

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
        let threads = std::fs::read_dir(format!("/proc/{pid}/task")).expect("a living process").flatten();
        let thread = threads
            .map(|entry| entry.path())
            .find(|path| std::fs::read_to_string(path.join("comm")).is_ok_and(|comm| comm.trim() == name));
        let id: libc::pid_t = thread.expect(name).file_name()?.to_str()?.parse().ok()?;
        let none = std::ptr::null_mut::<libc::c_void>();
        // SAFETY: PTRACE_SEIZE with no options reads and writes no memory of this process.
        if unsafe { libc::ptrace(libc::PTRACE_SEIZE, id, none, none) } != 0 {
            return None;
        }
        let frozen = Self(id);
        // SAFETY: as above; the thread is traced by this one.
        assert_eq!(unsafe { libc::ptrace(libc::PTRACE_INTERRUPT, id, none, none) }, 0);
        let mut status = 0;
        // SAFETY: `status` is valid for writing.
        assert_eq!(unsafe { libc::waitpid(id, &raw mut status, libc::__WALL) }, id);
        Some(frozen)
    }
}

impl Drop for Frozen {
    fn drop(&mut self) {
        let none = std::ptr::null_mut::<libc::c_void>();
        // SAFETY: PTRACE_DETACH without a signal touches no memory of this process.
        unsafe { libc::ptrace(libc::PTRACE_DETACH, self.0, none, none) };
    }
}
