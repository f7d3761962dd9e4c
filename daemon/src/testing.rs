//! Shared by the tests of this crate.

use foretrace_config::Config;

use crate::alloc_count::CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// The preset of the UR5.
pub(crate) fn config() -> Config {
    Config::preset("ur5").unwrap()
}
