//! The clock of all stamps, and the number that identifies its boot.

use std::sync::OnceLock;

use super::layout::fnv1a;

/// Now on CLOCK_MONOTONIC \[ns\]. No system call on common machines (vDSO), no allocation.
pub fn monotonic_now_ns() -> u64 {
    crate::os::clock_monotonic_ns()
}

/// Hash of the kernel's boot id: equal for all processes of this boot of this host, never zero.
///
/// The first call reads a file; call it once before real-time work. If the file is missing the result is the
/// same constant in every process.
pub fn host_boot_id() -> u64 {
    static BOOT_ID: OnceLock<u64> = OnceLock::new();
    *BOOT_ID.get_or_init(|| {
        let text = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
        fnv1a(text.trim().as_bytes()).max(1)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_runs_forward() {
        let first = monotonic_now_ns();
        std::thread::sleep(std::time::Duration::from_millis(2));
        assert!(monotonic_now_ns() >= first + 2_000_000);
    }

    #[test]
    fn the_boot_id_is_stable_and_not_zero() {
        assert_ne!(host_boot_id(), 0);
        assert_eq!(host_boot_id(), host_boot_id());
    }

    #[test]
    fn the_boot_id_is_the_hash_of_the_kernels() {
        let text = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
        assert_eq!(host_boot_id(), fnv1a(text.trim().as_bytes()).max(1));
    }
}
