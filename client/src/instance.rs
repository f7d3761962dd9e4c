//! What methods of [`Instance`](crate::Instance) take and return that only daemons and their doctors need.

#[doc(inline)]
pub use foretrace_shm::{Claim, Cleaned, InstanceLock, Leftovers, Purge, SharedMemory, SignalledStop};
