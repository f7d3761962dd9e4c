//! `foretraced`: what systemd starts.

use foretraced::alloc_count::CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn main() {}
