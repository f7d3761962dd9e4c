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
