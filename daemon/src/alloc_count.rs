//! A global allocator that counts allocations per thread.
//!
//! Contract: [`CountingAllocator`] passes every request on to the system's allocator unchanged and adds one
//! to a counter of the calling thread for each `alloc`, `alloc_zeroed` and `realloc`. Freeing is not counted:
//! every freed block was counted where it was allocated. Programs install it (`foretrace`, `foretraced`,
//! tests that count); this library does not. Besides `rt/os.rs` this is the only file of the daemon with
//! `unsafe`.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// The system's allocator with a counter per thread. Install with `#[global_allocator]`.
#[derive(Debug, Default, Clone, Copy)]
pub struct CountingAllocator;

thread_local! {
    // Const and without a destructor: reading it neither allocates nor fails in a thread that is ending.
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

fn count_one() {
    COUNT.with(|count| count.set(count.get().wrapping_add(1)));
}

/// Allocations of the calling thread since it started; always 0 without a [`CountingAllocator`].
#[must_use]
pub fn allocations() -> u64 {
    COUNT.with(Cell::get)
}

/// Whether the running program installed [`CountingAllocator`]; allocates once to find out.
#[must_use]
pub fn is_installed() -> bool {
    let before = allocations();
    drop(std::hint::black_box(Box::new(0_u8)));
    allocations() != before
}

/// Attributes the allocations of the calling thread: to the ports what runs inside [`Self::in_ports`], to the
/// law everything else.
#[derive(Debug)]
pub struct AllocationMeter {
    begun: u64,
    ports: u64,
}

impl AllocationMeter {
    /// Counts from here on.
    #[must_use]
    pub fn start() -> Self {
        Self { begun: allocations(), ports: 0 }
    }

    /// Runs `call`, whose allocations are those of the ports.
    pub fn in_ports<T>(&mut self, call: impl FnOnce() -> T) -> T {
        let before = allocations();
        let result = call();
        self.ports = self.ports.wrapping_add(allocations().wrapping_sub(before));
        result
    }

    /// Allocations of the ports and of the law since the start or the last lap.
    pub fn lap(&mut self) -> (u64, u64) {
        let lap = std::mem::replace(self, Self::start());
        (lap.ports, self.begun.wrapping_sub(lap.begun).wrapping_sub(lap.ports))
    }
}

// SAFETY: every method hands its arguments unchanged to `System` and returns its answer unchanged.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count_one();
        // SAFETY: the caller keeps the contract of `GlobalAlloc::alloc`, which is `System`'s.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: `pointer` came from `System` through this allocator, with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count_one();
        // SAFETY: the caller keeps the contract of `GlobalAlloc::alloc_zeroed`, which is `System`'s.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count_one();
        // SAFETY: `pointer` came from `System` with this layout; the caller vouches for `new_size`.
        unsafe { System.realloc(pointer, layout, new_size) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn allocate(count: usize) {
        (0..count).for_each(|_| drop(std::hint::black_box(Box::new(0_u64))));
    }

    #[test]
    fn every_way_to_get_memory_counts_once_and_freeing_does_not() {
        assert!(is_installed(), "in the tests of this crate it is");
        let counted = |act: &dyn Fn()| {
            let before = allocations();
            act();
            allocations() - before
        };
        assert_eq!(counted(&|| allocate(3)), 3);
        assert_eq!(counted(&|| drop(std::hint::black_box(vec![0_u8; 100]))), 1);
        assert_eq!(counted(&|| std::hint::black_box(Vec::<u64>::with_capacity(2)).reserve_exact(500)), 2);
    }

    #[test]
    fn a_lap_has_what_ran_in_the_ports_and_the_rest_since_the_lap_before() {
        let mut meter = AllocationMeter::start();
        allocate(2);
        meter.in_ports(|| allocate(5));
        allocate(1);
        meter.in_ports(|| allocate(1));
        assert_eq!(meter.lap(), (6, 3));
        allocate(4);
        assert_eq!(meter.lap(), (0, 4));
        assert_eq!(meter.lap(), (0, 0));
    }
}
