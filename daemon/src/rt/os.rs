//! System calls of the daemon, and what to report when one is refused.
//!
//! Contract: with `alloc_count.rs` the only file of the daemon with `unsafe`. Every request for a right
//! returns `Ok` or a [`Missing`] that names the right, the limit that prevents it and the remedy; none is
//! fatal, the loop runs without. Only [`monotonic_ns`], [`sleep_until_ns`] and [`page_faults`] are called
//! while ticks run, and they neither allocate nor fail.

use std::fmt;
use std::io;
use std::mem::MaybeUninit;
use std::os::fd::AsRawFd;
use std::path::Path;
use std::ptr;

/// A right of the real-time thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Right {
    /// SCHED_FIFO: no thread of lower priority can delay the thread.
    Fifo,
    /// The thread stays on its CPU.
    Affinity,
    /// No page of the process is fetched from disk or zeroed inside a tick.
    MemoryLock,
    /// Sleeps without SCHED_FIFO end within a microsecond rather than within 50.
    TimerSlack,
    /// The pages of the shared segments are reserved, so that none can fail with SIGBUS.
    SharedMemory,
}

/// A refused right: which, why, and the remedy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    /// What was refused.
    pub right: Right,
    /// One line for the operator, remedy included.
    pub text: String,
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// CLOCK_MONOTONIC now \[ns\].
#[must_use]
pub fn monotonic_ns() -> u64 {
    clock_ns(libc::CLOCK_MONOTONIC)
}

/// Processor time of the calling thread so far \[ns\].
#[must_use]
pub fn thread_cpu_ns() -> u64 {
    clock_ns(libc::CLOCK_THREAD_CPUTIME_ID)
}

/// A clock that every Linux has.
#[inline]
fn clock_ns(clock: libc::clockid_t) -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is valid for writing; the call cannot fail for a clock that exists.
    unsafe { libc::clock_gettime(clock, &raw mut time) };
    (time.tv_sec as u64).saturating_mul(1_000_000_000).saturating_add(time.tv_nsec as u64)
}

/// Sleeps until CLOCK_MONOTONIC shows `instant_ns`; returns early when a signal interrupts. The time is
/// absolute, so that a caller who sleeps on to the same instant loses nothing.
pub fn sleep_until_ns(instant_ns: u64) {
    let time = libc::timespec {
        tv_sec: (instant_ns / 1_000_000_000) as libc::time_t,
        tv_nsec: (instant_ns % 1_000_000_000) as libc::c_long,
    };
    // SAFETY: `time` is a valid timespec; with an absolute time the remainder pointer may be null.
    unsafe {
        libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &raw const time, ptr::null_mut())
    };
}

/// Puts the calling thread under SCHED_FIFO at `priority` (1..=99).
///
/// # Errors
/// The right is missing, or `priority` is out of range.
pub fn set_fifo(priority: u32) -> Result<(), Missing> {
    let parameters = libc::sched_param { sched_priority: i32::try_from(priority).unwrap_or(i32::MAX) };
    // SAFETY: 0 is the calling thread; `parameters` is valid for reading.
    let answer = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) };
    if answer == 0 {
        return Ok(());
    }
    Err(fifo_refused(priority, &io::Error::last_os_error(), soft_limit(libc::RLIMIT_RTPRIO)))
}

/// Keeps the calling thread on `cpu`.
///
/// # Errors
/// The CPU does not exist or lies outside the set allowed to this process.
pub fn pin_to(cpu: usize) -> Result<(), Missing> {
    // SAFETY: an all-zero cpu_set_t is the empty set.
    let mut set: libc::cpu_set_t = unsafe { MaybeUninit::zeroed().assume_init() };
    let words = size_of::<libc::cpu_set_t>() * 8;
    if cpu < words {
        // SAFETY: `cpu` lies inside the set, checked above.
        unsafe { libc::CPU_SET(cpu, &mut set) };
    }
    // SAFETY: 0 is the calling thread; `set` is valid for reading and its size is given.
    let answer = unsafe { libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &raw const set) };
    if answer == 0 {
        return Ok(());
    }
    Err(affinity_refused(cpu, &io::Error::last_os_error(), &allowed_cpus()))
}

/// Locks every page the process has mapped by now into memory (MCL_CURRENT).
///
/// Call after all ports and threads exist. Later mappings (a peer's segments) stay unlocked, because
/// MCL_FUTURE would make every later connection fail at a small RLIMIT_MEMLOCK.
///
/// # Errors
/// The process maps more than RLIMIT_MEMLOCK allows.
pub fn lock_memory() -> Result<(), Missing> {
    // SAFETY: no argument is a pointer.
    let answer = unsafe { libc::mlockall(libc::MCL_CURRENT) };
    if answer == 0 {
        return Ok(());
    }
    Err(lock_refused(&io::Error::last_os_error(), soft_limit(libc::RLIMIT_MEMLOCK)))
}

/// Leaves every signal but the stop, SIGUSR1, to the other threads. A stop is taken here, whatever state the
/// other threads are in: its handler sets a flag, and the sleep that it interrupts is taken up again.
pub fn hear_stops_only() {
    let mut signals = MaybeUninit::<libc::sigset_t>::zeroed();
    // SAFETY: `signals` is valid for writing.
    unsafe { libc::sigfillset(signals.as_mut_ptr()) };
    // SAFETY: `signals` was filled above.
    unsafe { libc::sigdelset(signals.as_mut_ptr(), libc::SIGUSR1) };
    // SAFETY: `signals` is valid for reading; the old mask is not asked for. None of the three calls can fail
    // with these arguments.
    unsafe { libc::pthread_sigmask(libc::SIG_SETMASK, signals.as_ptr(), ptr::null_mut()) };
}

/// Leaves the stop, SIGUSR1, to the real-time thread: the calling thread, and those that it starts from here
/// on, do not take it. The kernel may choose any thread that would, also one that gets no processor.
pub fn leave_stops_to_the_loop() {
    let mut stop = MaybeUninit::<libc::sigset_t>::zeroed();
    // SAFETY: `stop` is valid for writing.
    unsafe { libc::sigemptyset(stop.as_mut_ptr()) };
    // SAFETY: `stop` was emptied above.
    unsafe { libc::sigaddset(stop.as_mut_ptr(), libc::SIGUSR1) };
    // SAFETY: as in `hear_stops_only`.
    unsafe { libc::pthread_sigmask(libc::SIG_BLOCK, stop.as_ptr(), ptr::null_mut()) };
}

/// Makes sleeps of the calling thread end within `ns` of their time; has an effect outside SCHED_FIFO only.
///
/// # Errors
/// The kernel refuses the request.
pub fn set_timer_slack(ns: u32) -> Result<(), Missing> {
    // SAFETY: PR_SET_TIMERSLACK takes one number and no pointer.
    let answer = unsafe { libc::prctl(libc::PR_SET_TIMERSLACK, libc::c_ulong::from(ns)) };
    if answer == 0 {
        return Ok(());
    }
    let error = io::Error::last_os_error();
    let text =
        format!("timer slack of {ns} ns refused ({error}): wake-ups may come 50 us late; no remedy known");
    Err(Missing { right: Right::TimerSlack, text })
}

/// Bytes of stack touched by [`prefault_stack`].
pub const PREFAULTED_STACK: usize = 256 * 1024;

/// Touches the next [`PREFAULTED_STACK`] bytes of the calling thread's stack, so that no tick is the first to
/// do so.
#[inline(never)]
pub fn prefault_stack() {
    let mut stack = [0_u8; PREFAULTED_STACK];
    std::hint::black_box(&mut stack);
}

/// Page faults of the calling thread since it started: without and with reading from disk.
#[must_use]
pub fn page_faults() -> (u64, u64) {
    let mut usage = MaybeUninit::<libc::rusage>::zeroed();
    // SAFETY: `usage` is valid for writing; RUSAGE_THREAD is known to every Linux since 2.6.26.
    unsafe { libc::getrusage(libc::RUSAGE_THREAD, usage.as_mut_ptr()) };
    // SAFETY: rusage is plain numbers, zeroed above and perhaps overwritten by the call.
    let usage = unsafe { usage.assume_init() };
    (usage.ru_minflt as u64, usage.ru_majflt as u64)
}

/// Size of a file system \[bytes\].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// Free for this user.
    pub free: u64,
    /// Total; 0 if unlimited.
    pub total: u64,
}

/// Free bytes of the file system that holds `path`.
///
/// # Errors
/// The path does not exist or cannot be asked.
pub fn free_space(path: &Path) -> io::Result<u64> {
    space(path).map(|space| space.free)
}

/// Size and free space of the file system that holds `path`.
///
/// # Errors
/// The path does not exist or cannot be asked.
pub fn space(path: &Path) -> io::Result<Space> {
    let path = std::ffi::CString::new(path.as_os_str().as_encoded_bytes())?;
    let mut answer = MaybeUninit::<libc::statvfs>::zeroed();
    // SAFETY: `path` is a valid C string and `answer` is valid for writing.
    if unsafe { libc::statvfs(path.as_ptr(), answer.as_mut_ptr()) } != 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: statvfs is plain numbers, and the call succeeded.
    let answer = unsafe { answer.assume_init() };
    Ok(Space {
        free: answer.f_bavail.saturating_mul(answer.f_frsize),
        total: answer.f_blocks.saturating_mul(answer.f_frsize),
    })
}

/// Reserves the first `bytes` of `file`, so that no later touch of a mapped page can fail for lack of space.
///
/// # Errors
/// The file system is full or cannot reserve.
pub fn reserve(file: &std::fs::File, bytes: u64) -> io::Result<()> {
    let bytes = libc::off_t::try_from(bytes).unwrap_or(libc::off_t::MAX);
    // SAFETY: the descriptor is open for as long as `file` is borrowed.
    if unsafe { libc::fallocate(file.as_raw_fd(), 0, 0, bytes) } == 0 {
        return Ok(());
    }
    Err(io::Error::last_os_error())
}

/// Confines this process, which is to do some work for the daemon: at most `memory` \[bytes\] of address
/// space and `cpu_s` \[s\] of processor time, lower priority, no core file, no inherited descriptor but the
/// first three, and its end with the thread that started it. What the kernel refuses is left as it is.
pub fn confine(memory: u64, cpu_s: u64, nice: i32) {
    // SAFETY: takes numbers only; nothing of this process has opened a descriptor yet.
    unsafe { libc::syscall(libc::SYS_close_range, 3 as libc::c_uint, libc::c_uint::MAX, 0 as libc::c_uint) };
    // SAFETY: PR_SET_PDEATHSIG takes one number and no pointer.
    unsafe { libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL as libc::c_ulong) };
    // SAFETY: takes numbers only.
    unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, nice) };
    for (resource, most) in [(libc::RLIMIT_AS, memory), (libc::RLIMIT_CPU, cpu_s), (libc::RLIMIT_CORE, 0)] {
        let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
        // SAFETY: `limit` is valid for writing.
        unsafe { libc::getrlimit(resource, &raw mut limit) };
        // The hard limit stays: at that of processor time the kernel kills, and hides why.
        limit.rlim_cur = limit.rlim_cur.min(most);
        // SAFETY: `limit` is valid for reading.
        unsafe { libc::setrlimit(resource, &raw const limit) };
    }
}

/// The effective user of this process.
#[must_use]
pub fn user_id() -> u32 {
    // SAFETY: takes nothing and cannot fail.
    unsafe { libc::geteuid() }
}

/// The soft limit of a resource; `None` = unlimited or unknown.
fn soft_limit(resource: libc::__rlimit_resource_t) -> Option<u64> {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is valid for writing.
    let answer = unsafe { libc::getrlimit(resource, &raw mut limit) };
    (answer == 0 && limit.rlim_cur != libc::RLIM_INFINITY).then_some(limit.rlim_cur)
}

/// The CPUs this thread may run on, in the kernel's notation ("0-1").
fn allowed_cpus() -> String {
    std::fs::read_to_string("/proc/thread-self/status")
        .ok()
        .and_then(|status| {
            let line = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:"))?;
            Some(line.trim().to_owned())
        })
        .unwrap_or_else(|| "unknown".to_owned())
}

fn limit_text(limit: Option<u64>) -> String {
    limit.map_or_else(|| "unlimited".to_owned(), |limit| limit.to_string())
}

/// The user name for limits.conf.
fn user_name() -> String {
    std::env::var("USER").unwrap_or_else(|_| format!("#{}", user_id()))
}

/// Remedy for missing SCHED_FIFO at `priority`.
#[must_use]
pub fn fifo_remedy(priority: u32) -> String {
    let (user, wanted) = (user_name(), priority.max(90));
    format!(
        "add `{user} - rtprio {wanted}` to /etc/security/limits.conf and log in again, or \
         LimitRTPRIO={wanted} to the \
         systemd unit"
    )
}

/// Remedy for a refused memory lock.
#[must_use]
pub fn lock_remedy() -> String {
    let user = user_name();
    format!(
        "add `{user} - memlock unlimited` to /etc/security/limits.conf and log in again, or \
         LimitMEMLOCK=infinity to the \
         systemd unit"
    )
}

fn fifo_refused(priority: u32, error: &io::Error, limit: Option<u64>) -> Missing {
    let text = if (1..=99).contains(&priority) {
        format!(
            "SCHED_FIFO {priority} refused ({error}): RLIMIT_RTPRIO is {limit}; {remedy}. Until then other \
             programs can \
             delay ticks",
            limit = limit_text(limit),
            remedy = fifo_remedy(priority),
        )
    } else {
        format!("SCHED_FIFO {priority} refused ({error}): priorities reach from 1 to 99")
    };
    Missing { right: Right::Fifo, text }
}

fn affinity_refused(cpu: usize, error: &io::Error, allowed: &str) -> Missing {
    let text = format!("CPU {cpu} refused ({error}): this process may run on {allowed}; choose one of these");
    Missing { right: Right::Affinity, text }
}

fn lock_refused(error: &io::Error, limit: Option<u64>) -> Missing {
    let text = format!(
        "memory lock refused ({error}): RLIMIT_MEMLOCK is {limit} bytes; {remedy}. Until then a page fault \
         can delay a tick",
        limit = limit_text(limit),
        remedy = lock_remedy(),
    );
    Missing { right: Right::MemoryLock, text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_advances_and_sleeps_reach_their_instant() {
        let before = monotonic_ns();
        sleep_until_ns(before + 2_000_000);
        assert!(monotonic_ns() >= before + 2_000_000);
    }

    #[test]
    fn a_priority_out_of_range_is_refused_with_the_range() {
        let missing = set_fifo(1000).unwrap_err();
        assert_eq!(missing.right, Right::Fifo);
        assert!(missing.text.contains("from 1 to 99"), "{missing}");
    }

    #[test]
    fn a_cpu_that_does_not_exist_is_refused_with_those_that_do() {
        for cpu in [1000, 100_000] {
            let missing = pin_to(cpu).unwrap_err();
            assert_eq!(missing.right, Right::Affinity);
            assert!(missing.text.contains(&format!("CPU {cpu}")), "{missing}");
            assert!(missing.text.contains(&allowed_cpus()), "{missing}");
        }
    }

    #[test]
    fn a_missing_priority_names_limit_and_remedy() {
        let error = io::Error::from_raw_os_error(libc::EPERM);
        let text = fifo_refused(80, &error, Some(0)).text;
        for part in ["SCHED_FIFO 80", "RLIMIT_RTPRIO is 0", "rtprio 90", "limits.conf", "LimitRTPRIO=90"] {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn a_missing_memory_lock_names_limit_and_remedy() {
        let error = io::Error::from_raw_os_error(libc::ENOMEM);
        let text = lock_refused(&error, Some(8192 * 1024)).text;
        for part in ["RLIMIT_MEMLOCK is 8388608 bytes", "memlock unlimited", "LimitMEMLOCK=infinity"] {
            assert!(text.contains(part), "{text}");
        }
    }

    #[test]
    fn touching_new_memory_is_counted_as_a_page_fault() {
        let before = page_faults().0;
        // More than the allocator keeps for reuse.
        let pages: Vec<u8> = std::hint::black_box(vec![1; 40 << 20]);
        assert!(page_faults().0 > before);
        drop(pages);
    }

    #[test]
    fn space_is_reported_and_can_be_reserved() {
        let directory = tempfile::tempdir().unwrap();
        assert!(free_space(directory.path()).unwrap() > 0);
        let space = space(directory.path()).unwrap();
        assert!(space.total >= space.free, "{space:?}");
        let file = std::fs::File::create(directory.path().join("segment")).unwrap();
        match reserve(&file, 8192) {
            Ok(()) => assert_eq!(file.metadata().unwrap().len(), 8192),
            Err(error) => assert_eq!(error.raw_os_error(), Some(libc::EOPNOTSUPP)),
        }
        assert!(free_space(Path::new("/no/such/place")).is_err());
    }
}
