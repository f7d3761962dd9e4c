//! The system calls of this crate. The only file here with `unsafe`.

use std::io;
use std::os::fd::{AsRawFd, BorrowedFd, FromRawFd, OwnedFd, RawFd};
use std::os::unix::net::UnixStream;

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

/// Bytes still free in /dev/shm; `None` if unknown. With a full /dev/shm the first touch of a page kills.
pub fn shared_memory_free_bytes() -> Option<u64> {
    let mut found = std::mem::MaybeUninit::<libc::statvfs>::zeroed();
    // SAFETY: the path is a terminated string and `found` has room for one statvfs.
    let status = unsafe { libc::statvfs(c"/dev/shm".as_ptr(), found.as_mut_ptr()) };
    // SAFETY: all-zero bytes are a valid statvfs, whether or not the call filled it.
    let found = unsafe { found.assume_init() };
    (status == 0).then(|| found.f_bavail.saturating_mul(found.f_frsize))
}

/// The user of the process at the other end, as it was when it connected (SO_PEERCRED); the kernel says it,
/// not the process.
///
/// # Errors
///
/// The system does not say.
pub fn peer_user(stream: &UnixStream) -> io::Result<u32> {
    let mut peer = libc::ucred { pid: 0, uid: u32::MAX, gid: u32::MAX };
    let mut bytes = size_of::<libc::ucred>() as libc::socklen_t;
    // SAFETY: the descriptor is open while `stream` is borrowed, `peer` has room for `bytes` bytes, and both
    // are valid for writing.
    let answer = unsafe {
        libc::getsockopt(
            stream.as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_PEERCRED,
            (&raw mut peer).cast(),
            &raw mut bytes,
        )
    };
    match answer {
        0 if bytes as usize == size_of::<libc::ucred>() => Ok(peer.uid),
        0 => Err(io::Error::from(io::ErrorKind::InvalidData)),
        _ => Err(io::Error::last_os_error()),
    }
}

/// A descriptor of process `pid` (pidfd_open): it never refers to another process.
pub(crate) fn open_process(pid: u32) -> io::Result<OwnedFd> {
    // SAFETY: takes two numbers and no pointer.
    let answer = unsafe { libc::syscall(libc::SYS_pidfd_open, libc::c_long::from(pid), 0) };
    match RawFd::try_from(answer) {
        // SAFETY: the call has just made this descriptor, and nobody else knows of it.
        Ok(descriptor) if descriptor >= 0 => Ok(unsafe { OwnedFd::from_raw_fd(descriptor) }),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Sends `signal` to the process of the descriptor (pidfd_send_signal).
pub(crate) fn signal_process(process: BorrowedFd<'_>, signal: libc::c_int) -> io::Result<()> {
    let none = std::ptr::null_mut::<libc::siginfo_t>();
    // SAFETY: the descriptor is open while it is borrowed; without a siginfo no memory is read.
    let answer = unsafe { libc::syscall(libc::SYS_pidfd_send_signal, process.as_raw_fd(), signal, none, 0) };
    if answer == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_names_the_user_at_the_other_end() {
        let (one, _other) = UnixStream::pair().unwrap();
        assert_eq!(peer_user(&one).unwrap(), effective_user());
    }

    #[test]
    fn there_is_room_in_shared_memory() {
        assert!(shared_memory_free_bytes().unwrap() > 0);
    }
}
