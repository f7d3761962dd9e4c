//! The stop that needs no middleware, shared memory or free slot: a datagram socket beside the lock file, and
//! a signal to the process that holds that lock.
//!
//! Contract: frames have fixed lengths and are validated as a whole. The run directory (0700) decides who may
//! send: its user and root. A signal goes only to the holder of the lock, even if process numbers are reused.

use std::fs;
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;

use super::occupancy::DaemonMark;
use super::root::Instance;
use crate::wire::clock::host_boot_id;
use crate::wire::vocabulary::Mode;

/// Bytes of a [`StopFrame`].
pub const STOP_FRAME_BYTES: usize = 32;
/// Bytes of a [`StopAnswer`].
pub const STOP_ANSWER_BYTES: usize = 40;

/// Name of the daemon's thread that runs the loop, as the system shows it.
pub const LOOP: &str = "foretrace-rt";

const FRAME_MAGIC: u64 = u64::from_le_bytes(*b"ftSTOP_1");
const ANSWER_MAGIC: u64 = u64::from_le_bytes(*b"ftSTOPa1");

/// "Stop smoothly and stay stopped until armed again", as sent on the socket: little-endian words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StopFrame {
    /// Random; returned in the answer.
    pub token: u64,
    /// Sender's process number, as it claims; for the log only.
    pub pid: u32,
}

/// Why a frame was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum StopFrameError {
    /// Not a frame of this version.
    #[error("not a stop frame of {expected} bytes")]
    Malformed {
        /// Length of a valid frame.
        expected: usize,
    },
    /// Made before this boot of the host, or on another host.
    #[error("a stop frame of another boot")]
    ForeignBoot,
}

/// Progress of a stop, sent twice: when the daemon has received it, and when a tick has taken it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StopAnswer {
    /// The frame's token.
    pub token: u64,
    /// The mode after the tick that took it; `None`: received, not yet taken by a tick.
    pub taken: Option<Mode>,
    /// Trust in that tick.
    pub trust: f64,
}

impl StopFrame {
    /// The frame as bytes.
    #[must_use]
    pub fn encode(&self) -> [u8; STOP_FRAME_BYTES] {
        words([FRAME_MAGIC, host_boot_id(), self.token, u64::from(self.pid)])
    }

    /// Validates a received frame.
    ///
    /// # Errors
    /// Length, kind or boot is wrong.
    pub fn decode(bytes: &[u8]) -> Result<Self, StopFrameError> {
        let malformed = StopFrameError::Malformed { expected: STOP_FRAME_BYTES };
        let [magic, boot, token, pid] = read_words::<4>(bytes).ok_or(malformed)?;
        if magic != FRAME_MAGIC {
            return Err(malformed);
        }
        if boot != host_boot_id() {
            return Err(StopFrameError::ForeignBoot);
        }
        Ok(Self { token, pid: u32::try_from(pid).map_err(|_| malformed)? })
    }
}

impl StopAnswer {
    /// The answer as bytes.
    #[must_use]
    pub fn encode(&self) -> [u8; STOP_ANSWER_BYTES] {
        let mode = self.taken.map_or(u64::MAX, |mode| u64::from(u32::from(mode)));
        words([ANSWER_MAGIC, host_boot_id(), self.token, mode, self.trust.to_bits()])
    }

    /// Validates a received answer; `None` if it is not an answer of this boot.
    #[must_use]
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let [magic, boot, token, mode, trust] = read_words::<5>(bytes)?;
        let trust = f64::from_bits(trust);
        if magic != ANSWER_MAGIC || boot != host_boot_id() || !(0.0..=1.0).contains(&trust) {
            return None;
        }
        let taken = match mode {
            u64::MAX => None,
            mode => Some(Mode::try_from(u32::try_from(mode).ok()?).ok()?),
        };
        Some(Self { token, taken, trust })
    }
}

fn words<const N: usize, const BYTES: usize>(words: [u64; N]) -> [u8; BYTES] {
    let mut bytes = [0; BYTES];
    for (slot, word) in bytes.chunks_exact_mut(8).zip(words) {
        slot.copy_from_slice(&word.to_le_bytes());
    }
    bytes
}

fn read_words<const N: usize>(bytes: &[u8]) -> Option<[u64; N]> {
    let mut words = [0; N];
    if bytes.len() != N * 8 {
        return None;
    }
    for (word, slot) in words.iter_mut().zip(bytes.chunks_exact(8)) {
        *word = u64::from_le_bytes(slot.try_into().ok()?);
    }
    Some(words)
}

/// Why no signal was sent.
#[derive(Debug, thiserror::Error)]
pub enum SignalError {
    /// The lock is free.
    #[error("no daemon holds the lock of this instance")]
    NoDaemon,
    /// The holder of the lock cannot be determined; another process may have its number.
    #[error("process {pid} cannot be identified as the daemon ({why}), so it was sent no signal")]
    Uncertain {
        /// Content of the lock file.
        pid: u32,
        /// The missing evidence.
        why: &'static str,
    },
    /// The system refused.
    #[error("signal to process {pid}: {source}")]
    Refused {
        /// The daemon.
        pid: u32,
        /// The system's error.
        source: io::Error,
    },
}

impl Instance {
    /// Path of the daemon's socket for [`StopFrame`]s.
    #[must_use]
    pub fn stop_socket(&self) -> PathBuf {
        self.root().join("stop")
    }

    /// Sends the daemon SIGUSR1: stop smoothly and stay stopped. Safe against reused process numbers, also
    /// those of another container: the descriptor is opened first, and its process must then be the one that
    /// still holds the lock and handles the signal.
    ///
    /// # Errors
    /// See [`SignalError`]; then no signal was sent.
    pub fn signal_stop(&self) -> Result<SignalledStop, SignalError> {
        let mark = self.daemon().ok_or(SignalError::NoDaemon)?;
        let pid = mark.pid;
        let refused = |source| SignalError::Refused { pid, source };
        let uncertain = |why| SignalError::Uncertain { pid, why };
        let process = crate::os::open_process(pid).map_err(refused)?;
        // The descriptor's process is fixed from here on; all following checks concern that process, as long
        // as its number still refers to it.
        if self.daemon() != Some(mark) {
            return Err(SignalError::NoDaemon);
        }
        let lock = self.root().join("lock");
        match holds_lock(pid, &fs::metadata(lock).map_err(refused)?) {
            Some(true) => {}
            Some(false) => return Err(uncertain("it does not hold the lock file")),
            None => return Err(uncertain("neither /proc/locks nor its open files can be read")),
        }
        if !catches_stop(pid) {
            return Err(uncertain("it does not catch SIGUSR1"));
        }
        crate::os::signal_process(process.as_fd(), libc::SIGUSR1).map_err(refused)?;
        Ok(SignalledStop { instance: self.clone(), mark, slept: None })
    }
}

/// A stop that was sent as a signal, and what the kernel tells of it.
#[derive(Debug)]
pub struct SignalledStop {
    instance: Instance,
    mark: DaemonMark,
    /// How often the loop had gone to sleep when the signal was first seen to be taken.
    slept: Option<u64>,
}

impl SignalledStop {
    /// The daemon's process.
    #[must_use]
    pub const fn pid(&self) -> u32 {
        self.mark.pid
    }

    /// Whether a thread has taken the signal and the loop has run a whole tick since, by the kernel's account
    /// of the process. Ask again and again: it compares with what it saw before.
    pub fn is_taken(&mut self) -> bool {
        let pid = self.mark.pid;
        if is_pending(pid) != Some(false) {
            return false;
        }
        let Some(slept) = loop_has_slept(pid) else { return false };
        // The first sleep may be the one that the signal interrupted; between two more lies a tick.
        slept >= self.slept.get_or_insert(slept).saturating_add(2)
            && self.instance.daemon() == Some(self.mark)
    }
}

/// Whether SIGUSR1 still waits for a thread of the process that takes it.
fn is_pending(pid: u32) -> Option<bool> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let mask = u64::from_str_radix(line_of(&status, "ShdPnd:")?, 16).ok()?;
    Some(mask >> (libc::SIGUSR1 - 1) & 1 == 1)
}

/// How often the loop's thread has gone to sleep by itself, which it does once per period.
fn loop_has_slept(pid: u32) -> Option<u64> {
    let threads = fs::read_dir(format!("/proc/{pid}/task")).ok()?.flatten().map(|entry| entry.path());
    let named = |path: &PathBuf| fs::read_to_string(path.join("comm")).is_ok_and(|name| name.trim() == LOOP);
    let status = fs::read_to_string(threads.into_iter().find(named)?.join("status")).ok()?;
    line_of(&status, "voluntary_ctxt_switches:")?.parse().ok()
}

/// What follows `name` in a file of lines such as `/proc/PID/status`.
fn line_of<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    text.lines().find_map(|line| line.strip_prefix(name)).map(str::trim)
}

/// Whether `pid`, in this process's namespace, holds a write lock on the file; `None` if unknown.
fn holds_lock(pid: u32, file: &fs::Metadata) -> Option<bool> {
    let inode = format!(":{}", file.ino());
    let names_it = |text: &str| {
        text.lines().any(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            let at = words.iter().position(|word| *word == "FLOCK");
            let word = |place: usize| at.and_then(|at| words.get(at + place)).copied().unwrap_or_default();
            word(2) == "WRITE" && word(3) == pid.to_string() && word(4).ends_with(&inode)
        })
    };
    let locks = fs::read_to_string("/proc/locks").ok();
    if locks.as_deref().is_some_and(names_it) {
        return Some(true);
    }
    // Some kernels in containers list no locks; open files show the same, since only a daemon keeps this one
    // open.
    match fs::read_dir(format!("/proc/{pid}/fd")) {
        Ok(files) => Some(files.flatten().any(|entry| {
            fs::metadata(entry.path()).is_ok_and(|open| (open.dev(), open.ino()) == (file.dev(), file.ino()))
        })),
        Err(_) => locks.map(|_| false),
    }
}

/// Whether the process handles SIGUSR1, which would kill it otherwise.
fn catches_stop(pid: u32) -> bool {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let caught = line_of(&status, "SigCgt:");
    let caught = caught.and_then(|mask| u64::from_str_radix(mask, 16).ok()).unwrap_or(0);
    caught >> (libc::SIGUSR1 - 1) & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_survive_the_codec_and_nothing_else_passes() {
        let frame = StopFrame { token: 0x0123_4567_89ab_cdef, pid: 77 };
        let bytes = frame.encode();
        assert_eq!(StopFrame::decode(&bytes), Ok(frame));
        for length in 0..STOP_FRAME_BYTES {
            assert!(StopFrame::decode(&bytes[..length]).is_err());
        }
        assert!(StopFrame::decode(&[&bytes[..], &[0]].concat()).is_err());
        // Every flipped bit outside token and process number is detected.
        for bit in (0..128).chain(224..256) {
            let mut damaged = bytes;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(StopFrame::decode(&damaged).is_err(), "{bit}");
        }
        let mut foreign = bytes;
        foreign[8] ^= 1;
        assert_eq!(StopFrame::decode(&foreign), Err(StopFrameError::ForeignBoot));
    }

    #[test]
    fn answers_survive_the_codec_and_nonsense_is_none() {
        for taken in [None, Some(Mode::Stopped), Some(Mode::Idle)] {
            let answer = StopAnswer { token: 9, taken, trust: 0.5 };
            assert_eq!(StopAnswer::decode(&answer.encode()), Some(answer));
        }
        let answer = StopAnswer { token: 9, taken: Some(Mode::Idle), trust: 0.5 };
        for trust in [f64::NAN, f64::INFINITY, -0.1, 1.1] {
            assert_eq!(StopAnswer::decode(&StopAnswer { trust, ..answer }.encode()), None);
        }
        let mut mad = answer.encode();
        mad[24] = 99;
        assert_eq!(StopAnswer::decode(&mad), None);
        assert_eq!(StopAnswer::decode(&mad[..8]), None);
    }

    #[test]
    fn the_signal_goes_to_nobody_but_the_holder_of_the_lock_that_catches_it() {
        let folder = tempfile::tempdir_in("/tmp").unwrap();
        let instance = Instance::at(3, folder.path().join("i")).unwrap();
        assert!(matches!(instance.signal_stop(), Err(SignalError::NoDaemon)));
        let mut lock = instance.lock().unwrap();
        lock.announce().unwrap();
        // This process holds the lock and has no handler: the signal would kill it, and this test with it.
        let error = instance.signal_stop().unwrap_err();
        assert!(error.to_string().contains("does not catch SIGUSR1"), "{error}");
        // The lock file names a process that does not hold it: its number was reused.
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let stamp = crate::wire::clock::monotonic_now_ns();
        fs::write(instance.root().join("lock"), format!("{} {stamp}\n", child.id())).unwrap();
        let error = instance.signal_stop().unwrap_err();
        assert!(error.to_string().contains("does not hold the lock"), "{error}");
        assert_eq!(child.try_wait().unwrap(), None, "it must live on");
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(matches!(instance.signal_stop(), Err(SignalError::Refused { .. })));
    }
}
