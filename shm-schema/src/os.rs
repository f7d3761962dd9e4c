//! The two calls to the C library this crate needs. The only file here with `unsafe`.

/// CLOCK_MONOTONIC as nanoseconds since boot.
pub(crate) fn clock_monotonic_ns() -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid, exclusively borrowed timespec for the duration of the call.
    let status = unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut time) };
    // The call cannot fail with this clock and pointer (clock_gettime(2)); zero would make every stamp stale.
    if status != 0 {
        return 0;
    }
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}

/// Effective user of this process.
pub fn effective_user() -> u32 {
    // SAFETY: geteuid takes nothing, touches no memory of ours and cannot fail.
    unsafe { libc::geteuid() }
}
