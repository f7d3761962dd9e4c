//! A second user beside the one that a world's processes run as, to test what other users may do.

use crate::{Process, World, runs_as, skipped};

/// A user that owns nothing, neither the daemon's nor root.
pub const STRANGER: u32 = 65533;

/// A user who has nothing to do with a world's processes.
#[derive(Clone, Copy)]
pub struct Stranger<'a>(&'a World);

impl Stranger<'_> {
    /// Starts `foretrace ARGUMENTS...` as this user.
    #[must_use]
    pub fn start(&self, arguments: &[String]) -> Process {
        self.0.start_as(Some(STRANGER), arguments)
    }
}

impl World {
    /// Another user on this machine, where the tests may run programs as one; says so if not.
    #[must_use]
    pub fn stranger(&self) -> Option<Stranger<'_>> {
        if self.user.is_none() || !runs_as(&self.program, STRANGER) {
            skipped("only root can try what another user may do (and the program must be open to all)");
            return None;
        }
        Some(Stranger(self))
    }
}
