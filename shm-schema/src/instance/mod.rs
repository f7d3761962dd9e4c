//! An instance: the files of one daemon and its peers, its occupants, who holds pen and dead-man switch,
//! leftovers of dead processes, and the stop that needs no middleware.

pub(crate) mod root;
pub(crate) mod occupancy;
pub(crate) mod holder;
pub(crate) mod place;
pub(crate) mod leftovers;
pub(crate) mod stop_path;

/// Folder of the middleware's segments.
pub const SHARED_MEMORY: &str = "/dev/shm";
