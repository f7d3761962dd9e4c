//! An instance: where one daemon and its peers keep their files, who is in it, what the dead left behind, and
//! how its daemon is stopped without any middleware.

pub(crate) mod root;
pub(crate) mod occupancy;
pub(crate) mod leftovers;
pub(crate) mod stop_path;

/// Where the middleware keeps its segments.
pub const SHARED_MEMORY: &str = "/dev/shm";
