//! Other programs that this one runs: each in a process group of its own, which ends with its handle, so that
//! nothing that it started is left.
//!
//! Contract: a terminal's signals reach this program alone, which has to end by [`end_all`] on all of them.
//! Where this program is killed (SIGKILL), nothing here runs: then what [`tie_with`] was given ends each
//! child itself, and what a child started is left to find out by the end of its input. A tied child also ends
//! with the thread that started it.

use std::collections::BTreeSet;
use std::io;
use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, ExitStatus};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};

/// Groups of processes that run.
static RUNNING: Mutex<BTreeSet<u32>> = Mutex::new(BTreeSet::new());

/// What ties a child to this process.
static TIE: OnceLock<fn(&mut Command)> = OnceLock::new();

/// Every child is started with what `tie` adds to its command, so that the system ends it with this process.
/// That takes a call between fork and exec, for which safe Rust has no words. The first one given stays.
pub fn tie_with(tie: fn(&mut Command)) {
    let _ = TIE.set(tie);
}

/// For a program that is about to end without unwinding: kills all that it runs. Whoever starts or ends one
/// later blocks until the program ends.
pub fn end_all() {
    let groups = running();
    groups.iter().for_each(|group| kill(*group));
    std::mem::forget(groups);
}

fn running() -> MutexGuard<'static, BTreeSet<u32>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn kill(group: u32) {
    // One that is gone already is what is wanted.
    if let Some(group) = i32::try_from(group).ok().and_then(Pid::from_raw) {
        let _ = kill_process_group(group, Signal::KILL);
    }
}

/// A program with all that it starts.
#[derive(Debug)]
pub struct GroupChild(Child);

impl GroupChild {
    /// Starts it.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn start(command: &mut Command) -> io::Result<Self> {
        // Held, so that none is started behind the back of `end_all`.
        let mut groups = running();
        if let Some(tie) = TIE.get() {
            tie(command);
        }
        let child = command.process_group(0).spawn()?;
        groups.insert(child.id());
        Ok(Self(child))
    }

    /// Whether it has ended within `patience`, with a look at it every `pause`; it is not reaped, so that its
    /// number stays its own.
    #[must_use]
    pub fn has_ended(&self, patience: Duration, pause: Duration) -> bool {
        let Some(pid) = i32::try_from(self.0.id()).ok().and_then(Pid::from_raw) else { return true };
        let began = Instant::now();
        let look = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT | WaitIdOptions::NOHANG;
        while matches!(waitid(WaitId::Pid(pid), look), Ok(None)) {
            if began.elapsed() >= patience {
                return false;
            }
            std::thread::sleep(pause.min(patience.saturating_sub(began.elapsed())));
        }
        true
    }

    /// Ends what is left of its group, and takes its status; none the second time.
    pub fn end(&mut self) -> Option<ExitStatus> {
        let group = self.0.id();
        // Held over the kill: `end_all` in between would find it neither in the list nor ended.
        let mut groups = running();
        if !groups.remove(&group) {
            return None;
        }
        // Its number is still its own: nobody has waited for it.
        kill(group);
        drop(groups);
        self.0.wait().ok()
    }
}

impl Drop for GroupChild {
    fn drop(&mut self) {
        let _ = self.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn alive(pid: &str) -> bool {
        // One that nobody has waited for yet is a zombie.
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat"));
        stat.is_ok_and(|stat| !stat.contains(") Z "))
    }

    #[test]
    fn what_a_program_started_ends_with_it_and_its_status_is_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("pid");
        let script = format!("sleep 600 & echo $! > '{}'; exit 7", file.display());
        let mut child = GroupChild::start(Command::new("/bin/sh").args(["-c", &script])).unwrap();
        assert!(child.has_ended(Duration::from_secs(20), Duration::from_millis(1)));
        let pid = std::fs::read_to_string(&file).unwrap().trim().to_owned();
        assert!(alive(&pid));
        assert_eq!(child.end().unwrap().code(), Some(7));
        assert!(child.end().is_none());
        let began = Instant::now();
        while alive(&pid) {
            assert!(began.elapsed().as_secs() < 20, "{pid} is left");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn one_that_runs_ends_with_its_handle() {
        let child = GroupChild::start(Command::new("/bin/sleep").arg("600")).unwrap();
        let pid = child.0.id().to_string();
        assert!(!child.has_ended(Duration::from_millis(10), Duration::from_millis(1)) && alive(&pid));
        drop(child);
        assert!(!alive(&pid));
    }
}
